"""How long work tells what is under way."""

from collections.abc import Callable

Progress = Callable[[str, int, int], None]  # is called with (stage, done, total)
