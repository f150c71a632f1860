"""Recordings, and the logs that they are read from."""
