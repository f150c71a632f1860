"""The command line: one file per verb; what they share is in `call`, `settings` and `output`."""
