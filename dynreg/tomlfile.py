"""TOML files checked against a pydantic model, with errors that name the line."""

import re
import tomllib
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ValidationError

from dynreg.errors import DynregError

Model = TypeVar("Model", bound=BaseModel)


def read_toml(path: Path, model: type[Model], error: type[DynregError]) -> Model:
    """The file at `path` as a `model`; raises `error` that names the file, the line and the key."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as problem:
        raise error(
            f"{path}: {problem.__class__.__name__}: {problem}",
            expected="a readable TOML file in UTF-8",
            do="check the path and its permissions",
        ) from None
    try:
        return model.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as problem:
        raise error(f"{path.name}: {problem}", expected="valid TOML", do="mend that line") from None
    except ValidationError as problem:
        raise _one_error(path, text, problem, error) from None


def line_of(text: str, location: tuple[str | int, ...]) -> int:
    """The 1-based line of a key such as ("parameters", 2, "low"); 1 where it cannot be found.

    tomllib keeps no positions, so the table's header is found first and the key after it.
    """
    keys = [part for part in location if isinstance(part, str)]
    numbers = [part for part in location if isinstance(part, int)]
    lines = text.splitlines()
    start, end = 0, len(lines)
    if keys:
        header = re.compile(rf"^\s*\[\[?\s*{re.escape(keys[0])}\b")
        starts = [i for i, line in enumerate(lines) if header.match(line)]
        nth = numbers[0] if numbers else 0
        if nth < len(starts):
            start = starts[nth]
            end = starts[nth + 1] if numbers and nth + 1 < len(starts) else len(lines)
    for key in reversed(keys):
        pattern = re.compile(rf"^\s*(\[+.*[.\"\s])?[\"']?{re.escape(key)}[\"']?\s*(=|\.|\])")
        for i in range(start, end):
            if pattern.match(lines[i]):
                return i + 1
    return start + 1


def _one_error(path: Path, text: str, problem: ValidationError, error: type[DynregError]) -> DynregError:
    first = problem.errors()[0]
    location = tuple(first["loc"])
    # pydantic puts the tag of a chosen union member into the location: it is no key of the file
    key = ".".join(str(part) for part in location) or "file"
    where = f"{path.name}, line {line_of(text, location)}"
    if first["type"] == "extra_forbidden":
        return error(
            f"{where}: unknown key {key!r}", expected=_known(problem), do="remove it or correct its spelling"
        )
    if first["type"] == "missing":
        return error(f"{where}: {key!r} is missing", expected=f"a value for {key!r}", do="add it")
    message = first["msg"].removeprefix("Value error, ")
    value = first.get("input")
    shown = f" = {value!r}" if isinstance(value, str | int | float | bool) else ""
    return error(f"{where}: {key!r}{shown}: {message}", expected="a value that fits", do="correct that line")


def _known(problem: ValidationError) -> str:
    return f"only the documented keys of {problem.title}"
