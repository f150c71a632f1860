"""One channel of a log of messages: how these are decoded, and how many could not be."""

from collections.abc import Callable
from functools import cached_property
from typing import Any

from dynreg.data.readers.ros_types import Decode
from dynreg.data.series import Finding


class Channel:
    """Decodes the messages of one topic.

    topic : its name. kind : the type of its messages, "" where the log does not tell. make : gives the decoder, None
    where its encoding is not read; called for the first message.
    """

    def __init__(self, topic: str, make: Callable[[], Decode | None], kind: str = ""):
        self.topic, self.kind = topic, kind
        self._make = make
        self._failed = 0
        self._problem = ""

    def decode(self, data: bytes | memoryview) -> Any:
        """A message, or None where it cannot be decoded."""
        if self._decoder is None:
            self._failed += 1
            return None
        try:
            return self._decoder(data)
        except Exception as error:  # the message comes from the file: its decoder may fail in any way
            self.leave_out(f"cannot be decoded: {error}")
            return None

    def leave_out(self, problem: str) -> None:
        """Count a message that is left out."""
        self._failed += 1
        self._problem = problem

    def findings(self, name: str) -> list[Finding]:
        """Findings about the data of the log `name` that were left out."""
        if not self._failed:
            return []
        text = f"{self._failed} messages left out: {' '.join(self._problem.split())}"
        return [Finding("warning", "decode", f"{name}, {self.topic}", text)]

    @cached_property
    def _decoder(self) -> Decode | None:
        try:
            decoder = self._make()
            self._problem = "" if decoder else "its encoding is not read"
            return decoder
        except Exception as error:  # so does its definition
            self._problem = f"its schema cannot be used: {error}"
            return None
