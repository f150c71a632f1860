"""What is wrong with a robot folder, or will be in the way later: one finding, with its line."""

from dataclasses import dataclass
from typing import Literal

from dynreg.tomlfile import Location

# What a check says: where it stands in robot.toml, and what it is. In a location, an item of an array of tables may be
# named in place of its number: ("channels", "arm/position").
Said = tuple[Location, str]


@dataclass(frozen=True)
class Finding:
    """One thing that a check of a robot folder found.

    severity : an "error" keeps the folder from being used; a "warning" does not. message : one line with what to do.
    line : of robot.toml; None where it is about the folder as a whole.
    """

    severity: Literal["error", "warning"]
    message: str
    line: int | None = None

    def __str__(self) -> str:
        return self.message if self.line is None else f"robot.toml, line {self.line}: {self.message}"


def in_one_order(found: list[Finding]) -> list[Finding]:
    """Each finding once: errors before warnings, then by their lines."""
    by_line = sorted(dict.fromkeys(found), key=lambda f: (f.severity != "error", f.line or 0))
    return by_line
