"""What a call from Python is given: its names and its values, the same for every method of a session."""

import inspect
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dynreg
from dynreg.errors import LogError, UsageError
from dynreg.session import Session
from dynreg.verbs.arguments import typed

METHODS = sorted(
    name for name in dir(Session) if not name.startswith("_") and callable(getattr(Session, name))
)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    with dynreg.open(tmp_path_factory.mktemp("arguments") / "registry") as opened:
        yield opened


def refused(call: Callable[..., Any], *given: Any, **told: Any) -> str:
    with pytest.raises(UsageError) as error:
        call(*given, **told)
    return str(error.value)


@pytest.mark.parametrize("name", METHODS)
def test_no_method_answers_a_name_that_there_is_not_in_pythons_words(session: Session, name: str) -> None:
    said = refused(getattr(session, name), xyzzy=1)
    assert said.startswith(f"{name} has no argument 'xyzzy'; expected ") and said.endswith("; leave it out")


@pytest.mark.parametrize("name", METHODS)
def test_no_method_counts_its_arguments_in_pythons_words(session: Session, name: str) -> None:
    said = refused(getattr(session, name), *range(9))
    assert said.startswith(f"{name}: too many positional arguments; expected {name}(")
    assert said.endswith(f"; see help(dynreg.Session.{name})")


def test_the_nearest_name_is_told(session: Session) -> None:
    assert "'nme'" in (said := refused(session.ingest, nme="x")) and said.endswith(
        "write 'name', which is nearest to it"
    )
    assert "'crate'" in (said := refused(dynreg.open, crate=True)) and "write 'create'" in said
    assert "write 'seconds'" in refused(session.excite_legs, "quadruped", second=3.0, folder="x")
    assert refused(session.export, to="x").startswith(
        "export has no argument 'to'; expected one of refs, destination;"
    )


def test_what_is_missing_is_told_with_the_form_of_the_call(session: Session) -> None:
    assert "'robot'; expected ingest(logs, robot), all else by name;" in refused(session.ingest, "run.csv")
    assert "'visit'; expected navigate(recording, visit=), all" in refused(session.navigate, "run")
    assert refused(dynreg.share, "here").endswith("; see help(dynreg.share)")


def test_a_wrapped_method_keeps_its_name_and_its_signature() -> None:
    assert inspect.signature(Session.show).parameters["ref"].annotation is str
    assert Session.show.__name__ == "show" and "One thing in the registry" in (Session.show.__doc__ or "")
    assert isinstance(vars(Session)["effects"], staticmethod)


@pytest.mark.parametrize(
    ("name", "given", "told", "said"),
    [
        ("populate", ("servo_pendulum", "1e3"), {}, "n '1e3'; expected a whole number; give one"),
        ("populate", ("servo_pendulum", 2.5), {}, "n 2.5; expected a whole number; give one"),
        ("populate", ("servo_pendulum", None), {}, "n None; expected a whole number; name one"),
        ("neighbours", ("x",), {"k": "5"}, "k '5'; expected a whole number; give one"),
        ("collect", (), {"caches": "yes"}, "caches 'yes'; expected True or False; give one"),
        ("collect", (), {"dry_run": None}, "dry_run None; expected True or False; leave it out for False"),
        ("simulator", ("nominal",), {"period": "0.02"}, "period '0.02'; expected a number; give one"),
        ("show", (None,), {}, "ref None; expected a word; name one"),
        ("remove", (["a", None],), {}, "refs ['a', None]; expected a word or names; give one"),
        ("compare", ("x",), {"simulators": 5}, "simulators 5; expected names; give one"),
        ("diagnose", ("x",), {"horizon": "2"}, "horizon '2'; expected a number; give one"),
        ("query", ("x",), {"hold_out": ["a", "b"]}, "hold_out ['a', 'b']; expected a word; give one"),
        ("query", ("x",), {"progress": "yes"}, "progress 'yes'; expected a function; give one"),
        ("import_registry", ("x",), {"progress": 1}, "progress 1; expected a function; give one"),
        ("calibrate", ("x",), {"say": "aloud"}, "say 'aloud'; expected a function; give one"),
        (
            "populate",
            ("servo_pendulum", 2),
            {"training": "long"},
            "training 'long'; expected a dynreg.distance.population.Training; give one, or leave it out",
        ),
        (
            "calibrate",
            ("quadruped",),
            {"method": "btr", "task": "forward", "robot_door": "trials", "rules": 3},
            "rules 3; expected a dynreg.adapt.tried.Rules; give one, or leave it out",
        ),
    ],
)
def test_a_value_of_another_type_is_told(
    session: Session, name: str, given: tuple, told: dict[str, Any], said: str
) -> None:
    assert refused(getattr(session, name), *given, **told) == said


def test_a_word_where_several_may_be_told_is_one_and_never_its_letters(session: Session) -> None:
    assert "unknown effect 'paylod'" in refused(session.diagnose, "x", effects="paylod")
    assert "unknown effect 'paylod'" in refused(
        session.trial, "servo_pendulum", hide="chosen", effects="paylod"
    )
    assert "between 'payload'" in refused(session.excite, "servo_pendulum", "payload")
    assert "leg 'xl'" in refused(session.excite_legs, "quadruped", "xl", folder="new")


@pytest.mark.parametrize(
    ("kind", "value", "made"),
    [
        (tuple[str, ...] | None, "nominal", ("nominal",)),
        (tuple[str, ...], np.array(["a", "b"]), ("a", "b")),
        (str | Sequence[str], "bench", "bench"),
        (str | Sequence[str], ["a", 5], ("a", "5")),
        (str, 12345678, "12345678"),
        (str | None, 0.25, "0.25"),
        (str | None, None, None),
        (Path | None, "a/b.toml", Path("a/b.toml")),
        (str | Path, Path("a"), Path("a")),
        (int, np.int64(3), 3),
        (float, 2, 2.0),
        (dict[str, float] | None, {"gain": "x"}, {"gain": "x"}),
    ],
)
def test_a_value_becomes_what_its_type_asks(kind: Any, value: object, made: object) -> None:
    told = typed("it", kind, value)
    assert told == made and type(told) is type(made)


@pytest.mark.parametrize(
    ("ask", "said"),
    [
        (lambda s: s.compare(5), "recording 5; expected its name or id"),
        (lambda s: s.diagnose(None), "recording None; expected its name or id"),
        (lambda s: s.populate(None, n=2), "robot None; expected a robot's name"),
        (lambda s: s.effects(4), "robot 4; expected a robot's name"),
        (lambda s: s.ingest(None, robot="servo_pendulum"), "log None; expected a path"),
        (lambda s: s.ingest(["a.csv", 3], robot="servo_pendulum"), "log 3; expected a path"),
    ],
)
def test_what_can_name_nothing_is_told_as_such(tmp_path, ask, said):
    with dynreg.open(tmp_path / "registry") as session, pytest.raises(UsageError) as error:
        ask(session)
    assert said in str(error.value)


def test_a_number_is_no_path_and_keeps_its_digits():
    with pytest.raises(UsageError, match="path 5; expected a path"):
        dynreg.open(5)
    assert typed("ref", str, 1234567.25) == "1234567.25"


def test_an_empty_word_is_no_path():
    with pytest.raises(UsageError, match="registry ''; expected a folder; name one, or leave it out"):
        dynreg.open("")


@pytest.mark.parametrize("place", ["postgresql://me@db.lab/robots", Path("s3://robots/registry")])
def test_the_address_of_a_server_makes_no_folder(place, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match="expected a folder on this machine; join a shared registry by"):
        dynreg.open(place)
    assert not list(tmp_path.iterdir())


def test_logs_may_come_one_by_one(tmp_path):
    bad = [tmp_path / "a.csv", tmp_path / "b.csv"]
    with dynreg.open(tmp_path / "registry") as session:
        with pytest.raises(LogError, match="a.csv"):  # it is looked for: a generator is several logs
            session.ingest((path for path in bad), robot="servo_pendulum")
        with pytest.raises(UsageError, match="log b'a.csv'; expected a path"):
            session.ingest(b"a.csv", robot="servo_pendulum")
