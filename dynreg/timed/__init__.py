"""Wheeled robots told speeds and for how long: what moves them by how much, command by command."""
