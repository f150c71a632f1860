"""Symbols that stand for arrays in elementwise numpy, and write down what is done to each element.

An `if` on a value, a loop over joints or a sum over them cannot be said of one element: `Untraceable` says so.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

_OPERATORS = {
    "add": "+",
    "subtract": "-",
    "multiply": "*",
    "divide": "/",
    "power": "**",
    "greater": ">",
    "greater_equal": ">=",
    "less": "<",
    "less_equal": "<=",
    "equal": "==",
    "not_equal": "!=",
    "bitwise_and": "&",
    "bitwise_or": "|",
    "bitwise_xor": "^",
}
_POWERS = {2: "{0} * {0}", 1: "{0}", 0.5: "np.sqrt({0})", -1: "1.0 / {0}"}  # as numpy takes them


_OWN = {"sin": "sine", "exp": "exponential"}  # of `joint_kernel`


ELSEWHERE = "something else than x.memory that goes on from call to call"


class Untraceable(Exception):
    """What a port does to a symbol cannot be said of one joint."""


@dataclass
class Tape:
    """The statements so far; each gives a name to a value."""

    lines: list[str] = field(default_factory=list)

    def put(self, expression: str) -> "Symbol":
        """The value of an expression from here on."""
        self.lines.append(f"t{len(self.lines)} = {expression}")
        return Symbol(f"t{len(self.lines) - 1}", self)


class Symbol(NDArrayOperatorsMixin):
    """One number of an array (rows, joints); numpy's elementwise functions of it are written on its tape."""

    shape, ndim, dtype = (1, 1), 2, np.dtype(float)

    def __init__(self, name: str, tape: Tape):
        self.name, self.tape = name, tape

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> "Symbol":
        if method != "__call__" or options or ufunc.nout != 1:
            raise Untraceable(f"np.{ufunc.__name__}{'' if method == '__call__' else '.' + method} of it")
        names, name = [named(a, self.tape) for a in inputs], ufunc.__name__
        power = inputs[-1] if name == "power" and np.isscalar(inputs[-1]) else None
        if name == "square" or power in _POWERS:
            return self.tape.put(_POWERS[2 if power is None else power].format(names[0]))
        if name == "invert":
            return self.tape.put(f"not {names[0]}")
        if name in _OPERATORS:
            return self.tape.put(f" {_OPERATORS[name]} ".join(names))
        return self.tape.put(f"{_OWN.get(name, f'np.{name}')}({', '.join(names)})")

    def __array_function__(self, function: Callable, types: Any, args: tuple, options: dict) -> Any:
        if function not in _FUNCTIONS:
            raise Untraceable(f"np.{function.__name__} of it")
        return _FUNCTIONS[function](self.tape, *args, **options)

    def copy(self) -> "Symbol":
        """Itself: nothing changes it."""
        return self

    def astype(self, kind: type) -> "Symbol":
        """As a number of another kind."""
        made = {"i": "int", "b": "bool"}.get(np.dtype(kind).kind, "float")
        return self.tape.put(f"{made}({self.name})")

    def clip(self, low: Any, high: Any) -> "Symbol":
        """As np.clip."""
        return np.clip(self, low, high)

    def __getattr__(self, name: str) -> Any:
        raise Untraceable("np.array of it" if name.startswith("__array") else f".{name} of it")

    def __bool__(self) -> bool:
        raise Untraceable("an `if`, `and` or `not` on it: np.where chooses for each joint")

    def __float__(self) -> float:
        raise Untraceable("a function of plain numbers, as those of `math`: numpy's take arrays")

    __int__ = __index__ = __float__

    def __getitem__(self, key: Any) -> Any:
        raise Untraceable("single rows or joints of it")

    def __setitem__(self, key: Any, value: Any) -> None:
        raise Untraceable("an assignment to single rows or joints of it: np.where chooses")

    def __iter__(self) -> Any:
        raise Untraceable("a loop over its rows")


def named(value: Any, tape: Tape) -> str:
    """A symbol or a number in a statement on that tape.

    Raises Untraceable for a symbol of another: names of an earlier call mean something else now.
    """
    if isinstance(value, Symbol):
        if value.tape is not tape:
            raise Untraceable(ELSEWHERE)
        return value.name
    array = np.asarray(value)
    if array.size != 1 or array.dtype.kind not in "bif":
        raise Untraceable(f"a constant of shape {array.shape} and type {array.dtype} beside it")
    return repr(bool(array.item())) if array.dtype.kind == "b" else _number(float(array.item()))


def _number(value: float) -> str:
    text = repr(value) if np.isfinite(value) else f"{'-' if value < 0 else ''}np.{repr(abs(value))}"
    return f"({text})" if text.startswith("-") else text


def _where(tape: Tape, which: Any, a: Any, b: Any) -> Symbol:
    which, a, b = (named(value, tape) for value in (which, a, b))
    return tape.put(f"{a} if {which} else {b}")


def _clip(tape: Tape, a: Any, low: Any = None, high: Any = None) -> Any:
    a = a if low is None else np.maximum(a, low)
    return a if high is None else np.minimum(a, high)


def _like(number: float) -> Callable:
    return lambda tape, a, **options: tape.put(repr(number))


_FUNCTIONS: Mapping[Callable, Callable] = {
    np.where: _where,
    np.clip: _clip,
    np.copy: lambda tape, a: a,
    np.broadcast_to: lambda tape, a, shape: a,
    np.broadcast_arrays: lambda tape, *arrays: arrays,
    np.stack: lambda tape, arrays, axis=0: tuple(arrays),
    np.zeros_like: _like(0.0),
    np.ones_like: _like(1.0),
    np.full_like: lambda tape, a, value, **options: tape.put(named(value, tape)),
}
