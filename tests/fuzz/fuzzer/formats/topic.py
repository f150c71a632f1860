"""One topic of a log of messages: its type, as the log itself tells it, and its messages as bytes."""

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Topic:
    """A topic with the definition of its type and its messages."""

    topic: str
    schema_name: str
    schema_encoding: str
    schema: bytes
    encoding: str
    messages: tuple[bytes, ...]

    def named(self, topic: str) -> "Topic":
        """The same messages under another topic."""
        return replace(self, topic=topic)
