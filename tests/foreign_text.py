"""A name that a stranger chose, what of a text a terminal would obey, and results full of such names."""

import unicodedata
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel

OBEYED = ("Cc", "Cf", "Cs", "Zl", "Zp")
HOSTILE = '[red]\x1b[31m\x1b]0;t\x07\x9b\u202e\u200b\x00\r\n\t\x7f\u2028\udcff:smile:$\\frac{$<b onclick="x">\'{{7*7}}'
# words by which rooms look something up
OWN = {"fit", "select", "test", "validation", "dx", "dy", "dtheta", "m", "rad", "weak", "medium", "strong"}
OWN |= {"left wheel", "right wheel", "all speeds", "turns only", "before", "after"}


def obeyed(text: str, keep: str = "\n") -> str:
    """What a terminal would obey in a text, but for the layout's own characters."""
    return "".join(c for c in text if c not in keep and unicodedata.category(c) in OBEYED)


def poisoned(value: Any) -> Any:
    """A result with the hostile text at the end of every free text in it, keys of tables included."""
    if isinstance(value, str):
        return value if value in OWN else value + HOSTILE
    if isinstance(value, BaseModel):
        fields = type(value).model_fields
        free = [name for name, field in fields.items() if not _fixed(field.annotation)]
        return value.model_copy(update={name: poisoned(getattr(value, name)) for name in free})
    if isinstance(value, dict):
        return {poisoned(key): poisoned(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return type(value)(map(poisoned, value))
    return value


def _fixed(kind: Any) -> bool:
    return get_origin(kind) is Literal or any(map(_fixed, get_args(kind)))
