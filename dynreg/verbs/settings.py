"""What a verb can be told: each setting is said once, and becomes an option, a Python argument and their help.

>>> @dataclass(frozen=True)
... class Walk(Settings):
...     seed: int = option(0, "Seed of the random numbers.", least=0)
...     task: str | None = option(None, "One of the robot's [[tasks]].", usual="its first")
>>> Walk(seed=-1)
Traceback (most recent call last):
dynreg.errors.UsageError: seed -1; expected a whole number of 0 or more; give another number
"""

import inspect
import re
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import MISSING, Field, dataclass, field, fields
from math import isfinite
from typing import Any

from dynreg.errors import OldWord, UsageError
from dynreg.executor import LOCAL, NAMES
from dynreg.search.table import FORMER, SEARCHES
from dynreg.verbs.arguments import Wrapped, fitting, typed

_OPTION = "option"


@dataclass(frozen=True)
class Option:
    """One setting: its default, help and range.

    help : one sentence. flag : on the command line; "" for the name with dashes, None for none. usual : what the
    default stands for, in words. metavar : of its value. least, most : its range, ends included; above, below :
    without them. choices : the only values, or a function that gives them. old : {what a value was called: what it is
    called now}. some : what a list must hold at least one of; see : the command that shows these. complete : what a
    shell offers, by its name in `cli.completion`. repeated : a list with commas whose flag may be given
    again, too; apart : each time tells one value, which is the list between its commas. shared : a settings file and
    DYNREG_* may tell it as well.
    """

    help: str
    flag: str | None = ""
    usual: str = ""
    metavar: str | None = None
    least: int | None = None
    most: int | None = None
    above: float | None = None
    below: float = float("inf")
    choices: Collection[str] | Callable[[], Collection[str]] = ()
    old: Mapping[str, str] = field(default_factory=dict)
    some: str = ""
    see: str = ""
    complete: str | None = None
    repeated: bool = False
    apart: bool = False
    shared: bool = False

    @property
    def allowed(self) -> Collection[str]:
        """The only values; empty where every value will do."""
        return self.choices() if callable(self.choices) else self.choices

    def flag_of(self, name: str) -> str:
        """As an error names it."""
        return (self.flag or f"--{name.replace('_', '-')}").split("/")[0]

    def words(self, name: str, value: Any) -> list[str]:
        """What a command line tells for this value: the flag and the value, or the flag that turns it on or off."""
        flag = self.flag_of(name)
        if value is True:
            return [flag]
        if value is False:
            return [self.flag.split("/")[-1] if self.flag else f"{flag[:2]}no-{flag[2:]}"]
        return [flag, ",".join(map(str, value)) if isinstance(value, tuple) else str(value)]

    @property
    def sentence(self) -> str:
        """What it is, with its choices."""
        named = self.allowed and "ne of" not in self.help
        return f"{self.help} One of {', '.join(self.allowed)}." if named else self.help

    def check(self, name: str, value: Any) -> None:
        """UsageError, in which the setting is called `name`, for a value that cannot be; None is left to defaults."""
        if value is None:
            return
        if value == () and self.some:
            raise self.empty(f"no {name}", name)
        if self.allowed:
            for one in value if isinstance(value, tuple) else (value,):
                if one not in self.allowed:
                    expected = f"one of {', '.join(self.allowed)}"
                    raise UsageError(
                        f"{name} {one!r}", expected=expected, do="choose one of these", setting=name
                    )
        if isinstance(value, float) and not isfinite(value):
            raise UsageError(f"{name} {value}", expected=self._number(), do="give another", setting=name)
        if self.least is not None and not self.least <= value <= (self.most or float("inf")):
            raise UsageError(
                f"{name} {value}", expected=self._range(), do="give another number", setting=name
            )
        if self.above is not None and not self.above < value < self.below:
            raise UsageError(f"{name} {value:g}", expected=self._number(), do="give another", setting=name)

    def empty(self, problem: str, name: str) -> UsageError:
        """What is said of a list that holds nothing and may not."""
        return UsageError(
            problem, expected=f"{self.some} such as a,b", do=f"see `dynreg {self.see}`", setting=name
        )

    def _number(self) -> str:
        if self.above is None:
            return "a number"
        if self.below < float("inf"):
            return f"a number between {self.above:g} and {self.below:g}"
        return f"a number above {self.above:g}"

    def _range(self) -> str:
        return (
            f"a whole number of {self.least} or more" if self.most is None else f"{self.least} to {self.most}"
        )


def option(default: Any, help: str, **how: Any) -> Any:
    """A field of `Settings`: its default and how it is told; see `Option`."""
    return field(default=default, metadata={_OPTION: Option(help, **how)})


def threads() -> Any:
    """The setting that every verb has which simulates."""
    return option(0, "Simulation threads.", usual="all cores", least=0, shared=True)


def executor(more: str = "") -> Any:
    """The setting that every verb has whose work divides into independent jobs; see `executor.opened`.

    more : what else the help says.
    """
    told = f"What does the work: this process, or workers of Ray.{more}"
    return option(LOCAL, told, choices=NAMES, shared=True)


def address() -> Any:
    """The setting that goes with `executor`."""
    return option(
        None,
        "With --executor ray: HOST:PORT of a Ray cluster.",
        usual="RAY_ADDRESS, else workers on this machine",
    )


def seed(but: str = "") -> Any:
    """The setting that every verb has which draws at random. but : where it means nothing, for the help."""
    return option(0, f"Seed of the random numbers{but}.", least=0, shared=True)


def method() -> Any:
    """The setting that every verb has which searches."""
    return option("cma", "Search method.", choices=tuple(SEARCHES), old=FORMER)


def hold_out(usual: str = "a fifth of the episodes; of one run, pieces of it") -> Any:
    """The setting that every verb has which keeps a part of the recording to judge by; see `replay.parts`."""
    return option(
        None,
        "Held-out test part: a setting (kp=400), episodes (a,b or walk*), one of several recordings by its name, or a "
        "share (0.25).",
        usual=usual,
    )


@dataclass(frozen=True)
class Settings:
    """Base of what a verb can be told: frozen, and checked when it is made.

    Values become what their types ask (`arguments.typed`), an old word what it is called now. A verb with rules between
    its settings extends `__post_init__`.
    """

    def __post_init__(self) -> None:
        for one, how in options(type(self)):
            value = typed(one.name, one.type, getattr(self, one.name), one.default)
            if isinstance(value, tuple):
                value = tuple(today(each, how.old) for each in value)
            elif isinstance(value, str):
                value = today(value, how.old)
            object.__setattr__(self, one.name, value)
            how.check(one.name, value)

    @property
    def unused(self) -> Collection[str]:
        """Names of settings that do nothing beside the others; what a settings file tells of them is passed over."""
        return ()

    def refuse(self, names: Collection[str], where: str, expected: str) -> None:
        """UsageError for the first of these settings that is told otherwise than usual: it would be left unused.

        where : beside what it would do nothing, as in "for robot 'leg'". expected : what has a meaning there.
        """
        for one, how in options(type(self)):
            value = getattr(self, one.name)
            if one.name in names and value not in (one.default, ()):
                flag, *shown = how.words(one.name, value)
                problem = f"{' '.join((flag, *shown))} has no meaning {where}"
                raise UsageError(problem, expected=expected, do=f"leave {flag} out")


def today(word: str, old: Mapping[str, str]) -> str:
    """What a word is called now; where that is something else it is told (`OldWord`)."""
    if word not in old:
        return word
    warnings.warn(f"{word!r} is called {old[word]!r} now", OldWord, stacklevel=3)
    return old[word]


def options(kind: type[Settings]) -> Iterator[tuple[Field, Option]]:
    """Every setting of a verb, and how it is told."""
    return ((one, one.metadata[_OPTION]) for one in fields(kind))


def flags(settings: Settings, without: Collection[str] = ()) -> list[str]:
    """What a command line tells for these settings: those that differ from the usual ones, but `without` some."""
    out: list[str] = []
    for one, how in options(type(settings)):
        value = getattr(settings, one.name)
        if value != one.default and how.flag is not None and one.name not in without:
            out += how.words(one.name, value)
    return out


def taking(kind: type[Settings]) -> Callable[[Wrapped], Wrapped]:
    """Decorator of a method with `**settings`: its signature and its help name those of `kind`, one by one.

    Those that the method names itself stay as they are. The method is `fitting`.
    """

    def wrap(method: Wrapped) -> Wrapped:
        signature = inspect.signature(method)
        own = [p for p in signature.parameters.values() if p.kind is not p.VAR_KEYWORD]
        theirs = [(one, how) for one, how in options(kind) if one.name not in signature.parameters]
        settings = [
            inspect.Parameter(
                one.name,
                inspect.Parameter.KEYWORD_ONLY,
                default=inspect.Parameter.empty if one.default is MISSING else one.default,
                annotation=one.type,
            )
            for one, _ in theirs
        ]
        at = next((i for i, p in enumerate(own) if p.kind is p.KEYWORD_ONLY), len(own))
        method.__signature__ = signature.replace(parameters=[*own[:at], *settings, *own[at:]])
        lines = [
            f"{one.name} : {how.sentence}{f' {one.default!r}: {how.usual}.' if how.usual else ''}"
            for one, how in theirs
        ]
        method.__doc__ = _in_python("\n".join([inspect.cleandoc(method.__doc__ or ""), "", *lines]), kind)

        return fitting(method)

    return wrap


def _in_python(text: str, kind: type[Settings]) -> str:
    """A text in which the flags of a command are called as the settings that they tell."""
    called = {how.flag_of(one.name): f"`{one.name}`" for one, how in options(kind)}
    return re.sub(r"(?<!\S)--?\w[\w-]*", lambda flag: called.get(flag[0], flag[0]), text)
