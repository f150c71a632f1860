"""A robot folder inspected: a foreign one is read here, and compiled and simulated in a process of its own."""

from pathlib import Path

from dynreg.errors import DynregError, RobotError
from dynreg.folder import TOML, Folder
from dynreg.sim.child import NotTried, in_child
from dynreg.sim.closed import check_closed
from dynreg.sim.finding import Finding, in_one_order
from dynreg.sim.mjcf import model_files, try_model
from dynreg.sim.reading import read_all
from dynreg.sim.robot import hidden_by_name, is_packaged_folder, packaged_robots, robot_files
from dynreg.tomlfile import toml_text

CHECK = "dynreg.sim.check:check_files"  # engines and effects, which only the child process has to load


def check_robot(ref: str | Path) -> list[str]:
    """The errors of a robot folder, one line each; empty when it can be used. `inspect_robot` gives warnings too."""
    return [str(finding) for finding in inspect_robot(ref) if finding.severity == "error"]


def inspect_robot(ref: str | Path) -> list[Finding]:
    """All that is wrong with a robot folder, errors first, and what will be in the way later (warnings).

    Goes further than `load_robot`: compiles the model, resolves every name against it and simulates the
    nominal and the extreme configurations for some steps; those of a foreign robot in a process with limits.
    """
    try:
        files, _ = robot_files(ref)
    except DynregError as problem:
        return [Finding("error", str(problem))]
    hidden = [Finding("warning", text) for text in hidden_by_name(ref)]
    try:
        return in_one_order([*hidden, *inspect_files(files)])
    except NotTried as problem:
        reading = read_all(toml_text(files.hashed.get(TOML, b""), TOML, RobotError))
        ended = Finding("error", str(problem), reading.line(("robot", "model")))
        return in_one_order([*hidden, *reading.errors(), ended])


def inspect_files(files: Folder) -> list[Finding]:
    """All that is wrong with a robot whose folder holds these files; a foreign one is tried in another process.

    Raises NotTried where that process came to no end, which says nothing about the robot.
    """
    if is_packaged_folder(files):
        from dynreg.sim.check import findings

        return findings(files)
    try:
        reading = read_all(toml_text(files.hashed.get(TOML, b""), TOML, RobotError))
    except DynregError as problem:
        return [Finding("error", str(problem))]
    try:
        if reading.file is not None and reading.file.robot.model in files.hashed:
            model = reading.file.robot.model
            check_closed(model_files(files).files, model)  # before anything reads what it names
            try_model(model_files(files), model, packaged_robots().values())
        return [Finding(**told) for told in in_child(CHECK, files.files, limit="check_seconds")]
    except NotTried:
        raise
    except DynregError as problem:
        ended = Finding("error", str(problem), reading.line(("robot", "model")))
        return in_one_order([*reading.errors(), ended])
