"""A verb's settings as options of its command: flags, help, defaults and what a shell offers, from one definition."""

import inspect
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import MISSING, Field, replace
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, get_args, get_origin

import typer

from dynreg.cli import completion
from dynreg.errors import UsageError
from dynreg.verbs.settings import Option, Settings, options

if TYPE_CHECKING:
    from dynreg.cli.settings import Settings as File

Kind = TypeVar("Kind", bound=Settings)
LONGEST_CHOICES = 60  # columns that choices may take beside a flag


def parameters(kind: type[Settings]) -> list[inspect.Parameter]:
    """The options of a command, one for each setting that a command line can tell."""
    return [
        inspect.Parameter(
            one.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=_default(one, how),
            annotation=Annotated[
                _type(one, how),
                typer.Option(
                    *_flags(one, how),
                    help=_help(one, how),
                    metavar=_metavar(one, how),
                    show_default=False,
                    autocompletion=_offers(how),
                ),
            ],
        )
        for one, how in options(kind)
        if how.flag is not None
    ]


def told(kind: type[Kind], given: dict[str, Any], file: "File") -> Kind:
    """The settings that were `given` (and are taken out of there), else in the settings file, else the usual ones.

    The file speaks to all verbs: of a setting that does nothing beside the others, its value is passed over.
    Raises UsageError that names the flag.
    """
    said, flags, filed = {}, {}, {}
    for one, how in options(kind):
        value = given.pop(one.name, None)
        if value is None and how.shared:
            value = getattr(file, one.name, None)
            filed[one.name] = one.default
        if value is not None:
            flags[one.name] = how.flag_of(one.name)
            said[one.name] = _value(value, one, how)
            if said[one.name] == () and how.some:
                raise how.empty(f"{flags[one.name]} {value!r}", one.name)
    with naming(flags):
        made = kind(**said)
    return replace(made, **{name: filed[name] for name in made.unused if name in filed})


@contextmanager
def naming(flags: Mapping[str, str]) -> Iterator[None]:
    """An error about a setting of the block names its flag. flags : {setting: flag}."""
    try:
        yield
    except UsageError as error:
        if error.setting not in flags:
            raise
        problem = flags[error.setting] + error.problem.removeprefix(error.setting)
        raise UsageError(problem, expected=error.expected, do=error.do) from None


def _flags(one: Field, how: Option) -> tuple[str, ...]:
    """What typer is told: for what is usually on, it adds the flag that turns it off."""
    return () if not how.flag and one.default is True else (how.flag or how.flag_of(one.name),)


def _listed(one: Field) -> bool:
    """Whether its value is a list with commas."""
    return any(get_origin(t) is tuple for t in (one.type, *get_args(one.type)))


def _type(one: Field, how: Option) -> Any:
    kind = list[str] if how.repeated else str if _listed(one) else one.type
    return kind | None if _default(one, how) is None else kind


def _default(one: Field, how: Option) -> Any:
    """Of the option; None where a settings file may tell it, or nothing stands for it."""
    if one.default is MISSING:
        return inspect.Parameter.empty
    if how.shared or one.default == ():
        return None
    return ",".join(one.default) if isinstance(one.default, tuple) else one.default


def _metavar(one: Field, how: Option) -> str | None:
    """What stands for its value: the choices, where there is room for them."""
    choices = "|".join(how.allowed)
    fits = choices and len(choices) <= LONGEST_CHOICES and not _listed(one)
    return how.metavar or (choices if fits else None)


def _help(one: Field, how: Option) -> str:
    """Its sentence, with its choices where they do not stand in place of the value, and with its default."""
    metavar = _metavar(one, how)
    sentence = how.help if metavar and metavar == "|".join(how.allowed) else how.sentence
    usual = how.usual or _written(one, how)
    return f"{sentence}  [default: {usual}]" if usual else sentence


def _written(one: Field, how: Option) -> str:
    """The default as a command line would give it; "" where there is none, or it is an absent flag."""
    if one.default is False or one.default in (MISSING, None, (), ""):
        return ""
    if one.default is True:
        return how.flag_of(one.name).removeprefix("--")
    return ",".join(one.default) if isinstance(one.default, tuple) else f"{one.default}"


def _offers(how: Option) -> Callable[[str], list[str]] | None:
    if how.complete:
        return getattr(completion, how.complete)
    return completion.one_of(how.allowed) if how.allowed else None


def _value(given: Any, one: Field, how: Option) -> Any:
    """What a flag was given, with the parts of a list apart."""
    if how.apart:
        return tuple(tuple(part.strip() for part in each.split(",")) for each in given)
    if not _listed(one):
        return given
    return _names(given if isinstance(given, str) else ",".join(given))


def _names(given: str) -> tuple[str, ...]:
    """The names of a list with commas; one between brackets parts joints, not names.

    >>> _names("payload, backlash[hip,knee]")
    ('payload', 'backlash[hip,knee]')
    """
    parts, depth = [""], 0
    for letter in given:
        depth += {"[": 1, "]": -1}.get(letter, 0)
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return tuple(part.strip() for part in parts if part.strip())
