"""What a call from Python is given: its names as the signature has them, its values as the types ask.

>>> @fitting
... def fill(folder: str, n: int, *, again: bool = False) -> None: ...
>>> fill("a", n="1e3")
Traceback (most recent call last):
dynreg.errors.UsageError: n '1e3'; expected a whole number; give one
"""

import functools
import inspect
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import MISSING
from numbers import Integral, Real
from operator import index
from pathlib import Path
from types import UnionType
from typing import Any, TypeVar, Union, get_args, get_origin

from dynreg.errors import UsageError, nearest

Wrapped = TypeVar("Wrapped", bound=Callable[..., Any])
Door = TypeVar("Door", bound=type)
_EMPTY = inspect.Parameter.empty


def fitting(function: Wrapped) -> Wrapped:
    """Decorator: a call that lacks an argument, has one too many or one of another type is a UsageError.

    Values become what their types ask, see `typed`. A type in quotes is left to the function.
    """
    signature = inspect.signature(function)

    @functools.wraps(function)
    def run(*given: Any, **told: Any) -> Any:
        bound = _bound(function, signature, given, told)
        for name, value in bound.arguments.items():
            own = signature.parameters[name]
            if own.annotation is not _EMPTY and not isinstance(own.annotation, str):
                default = MISSING if own.default is _EMPTY else own.default
                bound.arguments[name] = typed(name, own.annotation, value, default)
        return function(*bound.args, **bound.kwargs)

    return run


def every_method(door: Door) -> Door:
    """Decorator of a class: all its public methods are `fitting`."""
    for name, method in list(vars(door).items()):
        function = method.__func__ if isinstance(method, staticmethod) else method
        if inspect.isfunction(function) and not name.startswith("_") and not hasattr(function, "__wrapped__"):
            fit = fitting(function)
            setattr(door, name, staticmethod(fit) if isinstance(method, staticmethod) else fit)
    return door


def _bound(
    function: Callable[..., Any], signature: inspect.Signature, given: Sequence[Any], told: Mapping[str, Any]
) -> inspect.BoundArguments:
    """The arguments by their names; UsageError where they do not fit, for a name that there is not before all else."""
    name, known = function.__name__, {n: p for n, p in signature.parameters.items() if n != "self"}
    for one in told:
        if one not in known:
            raise UsageError(
                f"{name} has no argument {one!r}",
                expected=f"one of {', '.join(known)}" if known else "none",
                do=nearest(one, known, "leave it out"),
            )
    try:
        return signature.bind(*given, **told)
    except TypeError as problem:  # in Python's words, such as "missing a required argument: 'robot'"
        placed = [n for n, p in known.items() if p.kind is p.POSITIONAL_OR_KEYWORD]
        needed = [f"{n}=" for n, p in known.items() if n not in placed and p.default is _EMPTY]
        raise UsageError(
            f"{name}: {problem}",
            expected=f"{name}({', '.join(placed + needed)})"
            + ", all else by name" * (len(placed) < len(known)),
            do=f"see help(dynreg.{function.__qualname__})",
        ) from None


def optional(kind: Any) -> bool:
    """Whether a value of this type may be None."""
    return type(None) in _kinds(kind)


def typed(name: str, kind: Any, value: Any, default: Any = MISSING) -> Any:
    """A value as its type asks; UsageError, in which it is called `name`, for one that does not fit the type.

    A number of numpy becomes one of Python, a number where a word is asked for its digits, text that names a file its
    path, words a tuple, and one word where several may be told a tuple of it. A value of a type that is none of these
    stays as it is. default : what stands for the value where it is left out.
    """
    if value is None and optional(kind):
        return None
    others = [one for one in _kinds(kind) if one is not type(None)]
    if Path in others and isinstance(value, Real):
        others = [Path]  # a number is no word for a file
    kinds = [Callable if get_origin(one) is Callable else one for one in others]
    known = [_MADE[one] for one in kinds if one in _MADE]
    for _, made in known:
        with suppress(TypeError):
            return made(value)
    if len(known) < len(others):
        return value
    do = "give one"
    if value is None:
        do = "name one" if default is MISSING else f"leave it out for {default!r}"
    expected = " or ".join(dict.fromkeys(what for what, _ in known))
    raise UsageError(f"{name} {value!r}", expected=expected, do=do, setting=name)


def require(name: str, value: object, kind: type) -> None:
    """Hold a value against a class that its caller imports; UsageError, in which it is called `name`, for another."""
    if not isinstance(value, kind):
        raise UsageError(
            f"{name} {value!r}",
            expected=f"a {kind.__module__}.{kind.__name__}",
            do="give one, or leave it out",
            setting=name,
        )


def _kinds(kind: Any) -> tuple[Any, ...]:
    """The types of which a value may be one."""
    return get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)


def _flag(value: Any) -> bool:
    if type(value).__name__ not in ("bool", "bool_"):  # numpy's too, without the import
        raise TypeError
    return bool(value)


def _whole(value: Any) -> int:
    if isinstance(value, bool):
        raise TypeError
    return index(value)


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, Real):
        raise TypeError
    return float(value)


def _word(value: Any) -> str:
    if isinstance(value, str):
        return value
    return str(_whole(value)) if isinstance(value, Integral) else repr(_number(value))


def _words(value: Any) -> tuple[str, ...]:
    if isinstance(value, str):
        return (value,)
    return tuple(map(_word, value))


def _function(value: Any) -> Callable[..., Any]:
    if not callable(value):
        raise TypeError
    return value


_MADE: Mapping[Any, tuple[str, Callable[[Any], Any]]] = {
    bool: ("True or False", _flag),
    int: ("a whole number", _whole),
    float: ("a number", _number),
    str: ("a word", _word),
    Path: ("a path", Path),
    Callable: ("a function", _function),
    tuple[str, ...]: ("names", _words),
    Sequence[str]: ("names", _words),
}
