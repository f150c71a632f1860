"""Gaits: families of joint commands, tasks, and the search for gaits on several simulators at once."""
