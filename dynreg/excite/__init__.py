"""Excite: commands for the experiment that tells two causes apart."""
