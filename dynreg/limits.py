"""What foreign files may ask of this machine: a limit each, high enough for a real log of several GB, and settable.

A limit is set by an environment variable: DYNREG_MAX_ROWS=200000000 sets `rows`.
"""

import os
from dataclasses import dataclass, fields
from typing import NoReturn

from dynreg.errors import DynregError, UsageError

PREFIX = "DYNREG_MAX_"


@dataclass(frozen=True)
class Limits:
    """The limits in force. Each field is one limit, with its unit in its comment."""

    rows: int = 100_000_000  # samples of one signal, rows of one table
    columns: int = 100_000  # columns of one table, signals of one log
    numbers: int = 250_000_000  # numbers kept of one log, one recording or one shard, 8 to 16 bytes each
    messages: int = 100_000_000  # messages of one log
    types: int = 1000  # kinds of messages of one log, for each of which a decoder is made
    items: int = 4_000_000  # items of all lists in one message
    episodes: int = 100_000  # episodes of one log
    log_files: int = 100_000  # files of one log: of a LeRobot dataset, of a rosbag2 folder
    chunk_bytes: int = 256 << 20  # bytes that are unpacked at once: a chunk, a record, a variable, a line
    unpacked_bytes: int = 64 << 30  # bytes that are unpacked of one log, one after the other
    whole_bytes: int = 1 << 30  # bytes of a log that is held whole: a .mat or .npz file
    json_bytes: int = 64 << 20  # bytes of one JSON document, which takes many times as much when it is read
    pattern_seconds: int = 5  # seconds that a map's `filename` may take with one log's name
    settings_bytes: int = 1 << 20  # bytes of a metadata.yaml, an info.json, a definition of messages
    entries: int = 1_000_000  # entries of one population of a registry
    robot_files: int = 10_000  # files in a robot's folder
    robot_bytes: int = 1_000_000_000  # bytes of a robot's folder: its model, its meshes
    xml_bytes: int = 20_000_000  # bytes of one XML file of a model
    toml_bytes: int = 1_000_000  # bytes of a robot.toml, a log map, a file of settings
    bodies: int = 10_000  # of a compiled model
    model_bytes: int = 1_000_000_000  # of a compiled model and the memory that one simulation of it needs
    robot_memory: int = 4_000_000_000  # bytes, of the process in which a foreign robot's folder is tried
    compile_seconds: int = 60  # of processor time, in which its model is compiled
    check_seconds: int = 600  # of processor time, in which `robots check` simulates it


def limits() -> Limits:
    """The limits, with those that the environment sets; UsageError where one is no whole number above 0."""
    told = {f.name: os.environ.get(variable(f.name)) for f in fields(Limits)}
    return Limits(**{name: _number(name, text) for name, text in told.items() if text is not None})


def variable(name: str) -> str:
    """The environment variable that sets a limit.

    >>> variable("rows")
    'DYNREG_MAX_ROWS'
    """
    return PREFIX + name.upper()


def refuse(error: type[DynregError], what: str, asked: float | str, name: str) -> NoReturn:
    """Raise `error`: `what` asks for more than the limit `name` allows, and how to raise it."""
    allowed = getattr(limits(), name)
    raise error(
        f"{what}: {asked}",
        expected=f"at most {allowed} ({name.replace('_', ' ')})",
        do=f"if you trust it, set {variable(name)} higher",
    )


def _number(name: str, text: str) -> int:
    if not text.isdecimal() or not text.isascii() or len(text) > 18 or int(text) < 1:
        raise UsageError(
            f"{variable(name)} = {text!r}", expected="a whole number above 0", do="correct or unset it"
        )
    return int(text)
