"""Datasets to take out: rows of registered simulators and of real robots, streamed part by part."""
