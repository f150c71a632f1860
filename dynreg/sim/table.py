"""The base of every table of `robot.toml`."""

import math
import unicodedata
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationInfo, field_validator

MANY = 1000  # entries of a list or table: the largest packaged robot has 29 parameters
LARGEST = (
    1e15  # of a number: beyond it sums and squares of what stands in a file lose their digits or overflow
)
PROSE = ("title", "source")


class Table(BaseModel):
    """A table of the file: unknown keys are errors, numbers are finite, nothing changes after reading.

    Strings hold up to 1000 characters and no control characters, lists and tables up to `MANY` entries, numbers are
    at most `LARGEST` in size.
    """

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, strict=True, str_max_length=1000
    )

    @field_validator("*")
    @classmethod
    def _plain(cls, value: Any, field: ValidationInfo) -> Any:
        _check(value, "\n\t" if field.field_name in PROSE else "")
        return value


def _check(value: Any, allowed: str) -> None:
    if isinstance(value, str) and not value.isprintable():
        odd = next((c for c in value if unicodedata.category(c)[0] == "C" and c not in allowed), None)
        if odd is not None:
            raise ValueError(f"the control character {odd!r} in it: use letters that can be seen")
    elif isinstance(value, int | float):
        if LARGEST < abs(value) < math.inf:
            raise ValueError(f"a number should be within +-{LARGEST:g}")
    elif isinstance(value, list | tuple | dict):
        if len(value) > MANY:
            raise ValueError(f"{len(value)} entries, at most {MANY} should be there")
        for part in (*value, *value.values()) if isinstance(value, dict) else value:
            _check(part, allowed)
