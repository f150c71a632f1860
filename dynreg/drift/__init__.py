"""Whether a registered recording of a wheeled robot is still true of it: from two recordings to a result."""
