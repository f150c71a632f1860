"""Algorithms that adapt a simulator to a robot, over plain functions: they know no recording, gait or query."""
