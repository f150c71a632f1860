"""Models and simulators of a wheeled robot, compared on a recording of it."""
