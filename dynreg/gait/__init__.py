"""Gaits: sinusoidal joint commands as data, tasks, and the search for gaits on several simulators at once."""
