"""Settings: said once, checked when they are made, and told to Python."""

import inspect
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from dynreg.errors import OldWord, UsageError
from dynreg.verbs.settings import Settings, option, seed, taking, threads


@dataclass(frozen=True)
class Ask(Settings):
    """For these tests."""

    k: int = option(5, "How many.", flag="-k", least=1, most=9)
    kind: str = option("a", "Which.", choices=("a", "b"))
    how: str = option("fast", "How.", choices=("fast",), old={"quickly": "fast"})
    kinds: tuple[str, ...] | None = option(
        None, "Which ones.", choices=lambda: ("a", "b"), usual="all", some="kinds"
    )
    longest: float = option(2.0, "Seconds.", above=0.0)
    again: bool = option(False, "Again.")
    file: Path | None = option(None, "A file.")
    seed: int = seed()
    threads: int = threads()


@pytest.mark.parametrize(
    ("told", "problem"),
    [
        ({"k": 0}, "k 0; expected 1 to 9"),
        ({"k": 10}, "k 10; expected 1 to 9"),
        ({"kind": "c"}, "kind 'c'; expected one of a, b"),
        ({"kinds": ["a", "c"]}, "kinds 'c'; expected one of a, b"),
        ({"longest": 0.0}, "longest 0; expected a number above 0"),
        ({"longest": float("nan")}, "longest nan; expected a number above 0"),
        ({"longest": float("inf")}, "longest inf; expected a number above 0"),
        ({"seed": -1}, "seed -1; expected a whole number of 0 or more"),
        ({"kinds": ()}, "no kinds; expected kinds such as a,b"),
        ({"seed": None}, "seed None; expected a whole number; leave it out for 0"),
        ({"seed": 1.5}, "seed 1.5; expected a whole number; give one"),
        ({"k": "5"}, "k '5'; expected a whole number; give one"),
        ({"longest": "2"}, "longest '2'; expected a number; give one"),
        ({"longest": True}, "longest True; expected a number; give one"),
        ({"again": 1}, "again 1; expected True or False; give one"),
        ({"kind": None}, "kind None; expected a word; leave it out for 'a'"),
    ],
)
def test_a_setting_that_cannot_be_is_named(told, problem):
    with pytest.raises(UsageError) as error:
        Ask(**told)
    assert str(error.value).startswith(problem)


def test_an_old_word_still_works_and_says_what_it_is_called_now():
    with pytest.warns(OldWord, match="'quickly' is called 'fast' now"):
        assert Ask(how="quickly").how == "fast"


def test_numbers_of_numpy_and_names_of_files_become_what_they_mean():
    told = Ask(
        k=np.int64(3), longest=np.float32(0.5), again=np.bool_(True), seed=np.uint8(4), file="a/b.toml"
    )
    assert (told.k, told.longest, told.again, told.seed) == (3, 0.5, True, 4)
    assert [type(one) for one in (told.k, told.longest, told.again, told.seed)] == [int, float, bool, int]
    assert told.file == Path("a/b.toml")


def test_sequences_become_tuples_and_none_is_left_alone():
    assert Ask(kinds=["a", "b"]).kinds == ("a", "b")
    assert Ask().kinds is None


def test_a_method_names_every_setting():
    @taking(Ask)
    def ask(self, recording: str, *, progress: object = None, **settings: object) -> None:
        """Ask it."""

    signature = inspect.signature(ask)
    assert list(signature.parameters) == [
        "self", "recording", "k", "kind", "how", "kinds", "longest", "again", "file", "seed", "threads", "progress",
    ]  # fmt: skip
    assert signature.parameters["k"].default == 5
    assert "kinds : Which ones. One of a, b. None: all." in ask.__doc__
    assert "threads : Simulation threads. 0: all cores." in ask.__doc__
