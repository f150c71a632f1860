"""Replay: a recording's own commands in candidate simulators."""
