"""TOML files checked against a pydantic model, with errors that name the line and the key."""

import json
import re
import tomllib
import types
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from dynreg.errors import DynregError
from dynreg.limits import limits, refuse

Model = TypeVar("Model", bound=BaseModel)
Location = tuple[str | int, ...]

DEEP = 100  # parts of a key a.b.c; `dynreg` has none of more than four
_PART = r"(?:\"[^\"]*\"|'[^']*'|[A-Za-z0-9_\-]+)"
_KEY = rf"{_PART}(?:\s*\.\s*{_PART})*"
_HEADER = re.compile(rf"^\s*(?P<open>\[\[?)\s*(?P<key>{_KEY})\s*\]")
_ENTRY = re.compile(rf"^\s*(?P<key>{_KEY})\s*=")
_KEY_LIKE = re.compile(rf"[\w\-.\"' \t]{{{2 * DEEP},}}")
_DOTTED = re.compile(r"\.\s*[\w\-\"']")
_PLAIN = {  # where pydantic's own words name Python classes
    "model_type": "this should be a table",
    "dict_type": "this should be a table",
    "union_tag_not_found": "this should be a table with a `type`",
}


def read_toml(path: Path, model: type[Model], error: type[DynregError]) -> Model:
    """The file at `path` as a `model`; raises `error` that names the file, the line and the key."""
    return parse_toml(read_text(path, error), path.name, model, error)


def read_text(path: Path, error: type[DynregError]) -> str:
    """The text of the TOML file at `path`; raises `error` where it cannot be read, as `toml_text` does."""
    try:
        with path.open("rb") as file:
            data = file.read(limits().toml_bytes + 1)
    except (OSError, ValueError) as problem:  # ValueError: a path with a NUL in it
        raise error(
            f"{str(path)!r} cannot be read: {getattr(problem, 'strerror', problem)}",
            expected="a readable TOML file in UTF-8",
            do="check the path and its permissions",
        ) from None
    return toml_text(data, str(path), error)


def toml_text(data: bytes, name: str, error: type[DynregError]) -> str:
    """The text of a TOML file with these bytes; raises `error` where it is none, or too long."""
    if len(data) > limits().toml_bytes:
        refuse(error, f"{name!r} is too long, in bytes", f"{len(data)} or more", "toml_bytes")
    try:
        return data.decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError:
        raise error(
            f"{name!r} cannot be read: it is no text in UTF-8",
            expected="a readable TOML file in UTF-8",
            do="save it as UTF-8",
        ) from None


def parse_toml(text: str, name: str, model: type[Model], error: type[DynregError]) -> Model:
    """TOML text as a `model`; `name` is what errors call the text. Raises `error` as `read_toml` does."""
    document = _document(text, name, error)
    try:
        return model.model_validate(document)
    except ValidationError as problem:
        found = problem.errors()
        # a misspelt key is also a missing one: what was written says more
        first = next((e for e in found if e["type"] == "extra_forbidden"), found[0])
        fault = fault_of(document, first, model)
        where = f"{name}, line {line_of(text, fault.location)}"
        raise error(f"{where}{fault.problem}", expected=fault.expected, do=fault.do) from None


def _document(text: str, name: str, error: type[DynregError]) -> dict[str, Any]:
    try:
        return toml_document(text)
    except RecursionError:
        raise error(
            f"{name}: tables or lists in each other too deep", expected="flat tables", do="take it apart"
        ) from None
    except ValueError as problem:  # of tomllib's own kind, and for numbers of thousands of digits
        raise error(f"{name}: {problem}", expected="valid TOML", do="mend that line") from None


def toml_document(text: str) -> dict[str, Any]:
    """TOML text as plain tables; ValueError where it is none, RecursionError where its tables lie too deep."""
    if any(len(_DOTTED.findall(run)) > DEEP for run in _KEY_LIKE.findall(text)):
        raise RecursionError  # tomllib takes the square of their number
    return tomllib.loads(text)


def literal(value: Any, digits: int = 17) -> str:
    r"""A value as TOML writes it, its numbers with so many digits.

    >>> literal(0.1), literal(True), literal(["a", "b"]), literal(2.0), literal('a "b"\n')
    ('0.1', 'true', '["a", "b"]', '2.0', '"a \\"b\\"\\n"')
    """
    if isinstance(value, str):
        # as JSON does, which leaves one control character as it is
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return repr(float(f"{value:.{digits}g}"))
    if isinstance(value, int):
        return str(value)
    return "[" + ", ".join(literal(item, digits) for item in value) + "]"


def line_of(text: str, location: Location) -> int:
    """The 1-based line of a key such as ("parameters", 2, "low"), or of the nearest table above it.

    tomllib keeps no positions, so headers and entries are found line by line. Parts of the location that the
    file does not have (a missing key, pydantic's name for the chosen kind of table) are passed over.
    """
    lines = _positions(text)
    found: Location = ()
    for part in location:
        if (*found, part) in lines:
            found = (*found, part)
    return lines.get(found, 1)


def _positions(text: str) -> dict[Location, int]:
    """The first line of every table and key; items of arrays of tables are numbered from 0."""
    lines: dict[Location, int] = {}
    counts: dict[Location, int] = {}
    table: Location = ()
    closing = None  # the quotes that end a string of several lines
    for number, line in enumerate(text.splitlines(), start=1):
        if closing is not None:
            closing = None if closing in line else closing
            continue
        header, entry = _HEADER.match(line), _ENTRY.match(line)
        if header:
            table = _inside(counts, _split(header["key"]))
            if header["open"] == "[[":
                lines.setdefault(table, number)
                counts[table] = counts.get(table, -1) + 1
                table = (*table, counts[table])
            _note(lines, table, number, 0)
        elif entry:
            _note(lines, table + _split(entry["key"]), number, len(table))
            closing = _left_open(line[entry.end() :])
    return lines


def _note(lines: dict[Location, int], key: Location, number: int, known: int) -> None:
    for length in range(known + 1, len(key) + 1):  # a.b = 1 also begins a
        lines.setdefault(key[:length], number)


def _inside(counts: dict[Location, int], key: Location) -> Location:
    """A header's key with the number of the array item that it continues: [[a]] then [a.b] is a, 0, b."""
    path: Location = ()
    for part in key[:-1]:
        path = (*path, part)
        if path in counts:
            path = (*path, counts[path])
    return (*path, key[-1])


def _split(key: str) -> Location:
    return tuple(part.strip("\"'") for part in re.findall(_PART, key))


def _left_open(value: str) -> str | None:
    for quotes in ('"""', "'''"):
        if value.lstrip().startswith(quotes) and value.count(quotes) == 1:
            return quotes
    return None


@dataclass(frozen=True)
class Fault:
    """What is wrong at one place of a TOML file, as an error says it; `problem` goes on after the place."""

    location: Location
    problem: str
    expected: str
    do: str


def fault_of(document: dict[str, Any], found: Mapping[str, Any], model: type[BaseModel]) -> Fault:
    """One of pydantic's errors about a document, at its place there."""
    location = in_document(document, found["loc"])
    key = _short(".".join(str(part) for part in location) or "file")
    if found["type"] == "extra_forbidden":
        keys = [*_fields(model, found["loc"][:-1])]
        return Fault(
            location,
            f": unknown key {key!r}",
            f"one of {keys}",
            "remove it or correct its spelling",
        )
    if found["type"] == "missing":
        field = _fields(model, found["loc"][:-1]).get(str(found["loc"][-1]))
        about = f": {field.description}" if field is not None and field.description else ""
        return Fault(location, f": {key!r} is missing", f"a value for {key!r}{about}".rstrip("."), "add it")
    message = _short(_PLAIN.get(found["type"], found["msg"].removeprefix("Value error, ")), 500)
    owner = _short(_name_at(document, location) or "")
    value = found.get("input")
    shown = f" = {_short(repr(value))}" if isinstance(value, str | int | float) and not _huge(value) else ""
    problem = f"{f', {owner!r}' if owner else ''}: {key!r}{shown}: {message}"
    return Fault(location, problem, "a value that fits", "correct that line")


def _short(text: str, most: int = 100) -> str:
    return text if len(text) <= most else f"{text[: most - 3]}..."


def _huge(value: object) -> bool:
    """Whether Python refuses to write a whole number out."""
    return isinstance(value, int) and abs(value) > 10**100


def _name_at(document: dict[str, Any], location: Location) -> str | None:
    """The `name` of the innermost item of a list on the way to a location, so that "parameters.3" has a face."""
    here: Any = document
    found = None
    for part in location:
        inside = (
            part in here
            if isinstance(here, dict)
            else isinstance(here, list) and isinstance(part, int) and part < len(here)
        )
        here = here[part] if inside else None
        if isinstance(part, int) and isinstance(here, dict) and isinstance(here.get("name"), str):
            found = here["name"]
    return found


def in_document(document: dict[str, Any], location: Location) -> Location:
    """The location without the names that pydantic gives to the chosen members of a union."""
    kept: list[str | int] = []
    here: Any = document
    for i, part in enumerate(location):
        inside = (
            part in here
            if isinstance(here, dict)
            else isinstance(here, list) and isinstance(part, int) and part < len(here)
        )
        if inside or i == len(location) - 1:
            kept.append(part)
            here = here[part] if inside else None
    return tuple(kept)


def _fields(model: type[BaseModel], location: Location) -> dict[str, FieldInfo]:
    """The keys that the table at a location may have, and what is said of each."""
    here: Any = model
    for part in location:
        if isinstance(here, type) and issubclass(here, BaseModel):
            here = here.model_fields[str(part)].annotation if str(part) in here.model_fields else here
        options = [m for m in _models(here) if isinstance(part, str) and _tag(m) == part]
        if options:
            here = options[0]
        elif isinstance(part, int) or get_origin(here) is dict:
            here = get_args(here)[-1] if get_args(here) else here
    found = _models(here)
    return dict(found[0].model_fields) if found else {}


def _models(annotation: Any) -> list[type[BaseModel]]:
    """The pydantic models in an annotation such as list[Annotated[A | B, ...]]."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    if get_origin(annotation) in (Union, types.UnionType, list, dict, tuple, Annotated):
        return [m for part in get_args(annotation) for m in _models(part)]
    return []


def _tag(model: type[BaseModel]) -> str | None:
    field = model.model_fields.get("type")
    return get_args(field.annotation)[0] if field and get_origin(field.annotation) is Literal else None
