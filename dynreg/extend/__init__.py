"""Extend: a simulator with its effects as a robot folder of its own."""
