"""Verbs as rows: a session's method has the name, the help and the arguments of its verb."""

import inspect
from dataclasses import dataclass

import pytest

from dynreg.errors import UsageError
from dynreg.results import EffectsList
from dynreg.verbs.settings import Settings, option, seed
from dynreg.verbs.verb import about_recording, about_robot


@dataclass(frozen=True)
class CountSettings(Settings):
    """For these tests."""

    rows: int = option(3, "Rows to count.", least=1)
    seed: int = seed()


def count(asked, settings, progress) -> EffectsList:
    """Count rows, as many as --rows says.

    Exit status 0 whatever their number.

    Example: dynreg count monday

    Raises what is not told on the command line.
    """
    return EffectsList(robot=f"{asked.name} {settings.rows}" if hasattr(asked, "name") else None, effects=())


class Door:
    """As a session."""

    registry = None
    count = about_recording(count, CountSettings)
    counted = about_robot(count, CountSettings)


def test_a_method_is_told_as_its_verb():
    signature = inspect.signature(Door.count)
    assert [*signature.parameters] == ["self", "recording", "rows", "seed", "robot", "log_map", "progress"]
    assert [*inspect.signature(Door.counted).parameters] == ["self", "robot", "rows", "seed", "progress"]
    assert signature.return_annotation is EffectsList
    told = Door.count.__doc__
    assert told.startswith("Count rows, as many as `rows` says.\n\nRaises what")
    for name in [*signature.parameters][1:]:
        assert f"\n{name} : " in told
    assert "rows : Rows to count." in told and "dynreg count" not in told and "Exit status" not in told
    assert Door.count.verb.help == (
        "Count rows, as many as --rows says.\n\nExit status 0 whatever their number.\n\nExample: dynreg count monday"
    )


def test_the_answer_is_stored_under_its_kind_about_the_recording(registry_folder, tmp_path):
    import shutil

    from dynreg import session

    shutil.copytree(registry_folder, tmp_path / "registry")
    with session.open(tmp_path / "registry") as opened:
        door = Door()
        door.registry = opened.registry
        assert door.count("bench", rows=7).robot == "bench 7"
        identity = opened.show("bench").id
        assert opened.registry.latest("effects", identity).document["robot"] == "bench 7"


def test_a_setting_that_cannot_be_is_refused_before_anything_is_read():
    with pytest.raises(UsageError, match="rows 0"):
        Door().count("nowhere", rows=0)


def test_an_argument_that_there_is_not_is_answered_with_the_nearest() -> None:
    """Python's own error named the class of the settings."""
    with pytest.raises(UsageError, match="count has no argument 'row'; expected .*; write 'rows', which is"):
        Door().count("monday", row=3)
    with pytest.raises(UsageError, match="count has no argument 'xyzzy'; expected .*seed.*; leave it out"):
        Door().counted("leg", xyzzy=3)
