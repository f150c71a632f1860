"""References of robot.toml and of maps, from the pydantic models that read them."""

import inspect
import math
from collections.abc import Iterator
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from dynreg.adapt.plan import StageTable
from dynreg.data.maps import LogMap
from dynreg.methods.table import METHODS
from dynreg.sim.spec import RobotFile

_PLAIN = {str: "text", float: "number", int: "whole number", bool: "true or false", NoneType: ""}
_SIGNS = {"ge": "≥", "gt": ">", "le": "≤", "lt": "<", "min_length": "length ≥", "max_length": "length ≤"}


def robot_file() -> str:
    """Every table of robot.toml with its keys."""
    return _file(RobotFile)


def map_file() -> str:
    """Every table of a map with its keys."""
    return _file(LogMap)


def methods() -> str:
    """The methods of `calibrate`: what each is for, and what it needs."""
    rows = [f"| `{k.name}` | {', '.join(k.needs)} | {k.about} |" for k in METHODS.values()]
    return "\n".join(["| `--method` | needs | what it finds, and when to use it |", "|---|---|---|", *rows])


def plan_file() -> str:
    """The keys of a stage of a staged calibration."""
    return _keys(StageTable)


def _file(kind: type[BaseModel]) -> str:
    rows = [(name, field, list(_tables(field.annotation))) for name, field in kind.model_fields.items()]
    listed = "\n".join(
        f"| {_link(name, field, tables)} | {_many(field)} | {field.description} |"
        for name, field, tables in rows
    )
    sections = [_section(name, field, table) for name, field, tables in rows for table in tables]
    return "\n\n".join(["| table | how many | meaning |\n|---|---|---|\n" + listed, *sections])


def _section(name: str, field: FieldInfo, kind: type[BaseModel], above: str = "") -> str:
    title = f"`{_header(above + name, field)}`"
    if "type" in kind.model_fields and len(list(_tables(field.annotation))) > 1:
        (choice,) = get_args(kind.model_fields["type"].annotation)
        title += f' with `type = "{choice}"`'
    said = _escaped(
        inspect.cleandoc(kind.__doc__ or "").partition(": ")[2] or inspect.cleandoc(kind.__doc__ or "")
    )
    parts = [
        f"## {title}",
        said[0].upper() + said[1:] if said[0] in "tw" and " = " not in said else said,
        _keys(kind),
    ]
    for inner, one in kind.model_fields.items():
        parts += [_section(inner, one, table, f"{above}{name}.") for table in _tables(one.annotation)]
    return "\n\n".join(parts)


def _keys(kind: type[BaseModel]) -> str:
    rows = [
        f"| `{name}` | {_type(field.annotation)} | {_default(field)} | {_range(field)} | {_cell(field.description)} |"
        for name, field in kind.model_fields.items()
        if not list(_tables(field.annotation))
    ]
    return "| key | type | default | range | meaning |\n|---|---|---|---|---|\n" + "\n".join(rows)


def _tables(annotation: Any) -> Iterator[type[BaseModel]]:
    """The tables that a type names, at whatever depth."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from _tables(part)


def _header(name: str, field: FieldInfo) -> str:
    kind = get_origin(field.annotation)
    return f"[[{name}]]" if kind is list else f"[{name}.NAME]" if kind is dict else f"[{name}]"


def _link(name: str, field: FieldInfo, tables: list) -> str:
    return f"`{_header(name, field)}`" if tables else f"`[{name}]`"


def _many(field: FieldInfo) -> str:
    many = {list: "any number", dict: "any number, by name"}.get(get_origin(field.annotation), "one")
    return many if not field.is_required() else f"{many}, required"


def _type(annotation: Any) -> str:
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _type(parts[0])
    if origin is Literal:
        return ", ".join(f"`{choice}`" for choice in parts)
    if origin in (Union, UnionType):
        return " or ".join(filter(None, map(_type, parts)))
    if origin is list:
        return f"list of {_type(parts[0])}"
    if origin is tuple:
        return f"{len(parts)} numbers"
    if origin is dict:
        return f"table of {_type(parts[1])}"
    return _PLAIN[annotation]


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    value = field.get_default(call_default_factory=True)
    if value is None:
        return "none"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, float):
        return f"`{value:g}`"
    return f"`{value!r}`".replace("'", '"')


def _range(field: FieldInfo) -> str:
    bounds = [
        f"{sign} {getattr(rule, key):g}"
        for rule in field.metadata
        for key, sign in _SIGNS.items()
        if getattr(rule, key, None) is not None and math.isfinite(getattr(rule, key))
    ]
    return ", ".join(bounds)


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _escaped(text: str) -> str:
    """Formulas of a docstring as they stand: a star or an underline is no emphasis, a bracket no tag."""
    return text.replace("*", "\\*").replace("_", "\\_").replace("<", "&lt;")
