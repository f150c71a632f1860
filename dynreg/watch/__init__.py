"""A recording and a simulator side by side: poses over time, for a viewer, a log for Foxglove, or one for Rerun."""
