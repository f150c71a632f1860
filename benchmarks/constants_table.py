"""The constants that `bench_constants.py` changes, with the values tried besides the one that stands in the code.

A constant is named "module:NAME", a field of a plan "module:Class.field", what a function takes where nothing is said
"module:function.argument"; those that do one thing together are changed together. By the logs that tell them.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from inspect import signature
from sys import modules
from typing import Any

D, E = "dynreg.diagnose.", "dynreg.evidence."
SHORT, LONG, CONTACT = f"{D}plans.short:Short.", f"{D}plans.long:Long.", f"{D}plans.contact:Contact."
SEARCH = {  # names on short lists, and what is fitted on the way
    (f"{D}screen:SCREEN",): [((1.0,),), ((0.15, 0.5, 1.25),), ((0.6, 2.0, 5.0),)],
    (f"{D}screen:KEPT",): [(1,), (4,)],
    (f"{SHORT}finalists",): [(8,), (32,)],
    (f"{SHORT}iterations", f"{SHORT}again"): [(2, 2), (10, 10)],
    (f"{SHORT}rivals", f"{SHORT}rounds"): [(1, 1), (6, 4)],
    (f"{E}fit:SHARES",): [((1.0, 0.2, 0.07),), ((4.0, 0.8, 0.3),)],
    (f"{E}fit:FEWER",): [((0, 3),), ((0, 1, 2, 3, 4, 5, 6),)],
    (f"{E}fit:DAMPINGS", f"{E}fit:PULLS", f"{E}fit:REACH", f"{D}screen:FAR"): [
        ((1e-5, 5e-3, 0.5), (15.0,), 1.0, 5.0),
        ((1e-5, 2e-2, 2.0), (60.0,), 4.0, 20.0),
    ],
    (
        f"{E}fit:fit.tolerance",
        f"{D}calibrate:ENOUGH",
        f"{D}settle:ENOUGH",
        f"{SHORT}better",
        f"{SHORT}hopeless",
    ): [(0.15, 0.025, 0.025, 1.0, 30.0), (0.6, 0.1, 0.1, 4.0, 120.0)],
    (
        f"{SHORT}draws",
        f"{D}calibrate:FINALISTS",
        f"{D}calibrate:BEGUN",
        f"{D}calibrate:CLOSER",
        f"{D}calibrate:ITERATIONS",
    ): [(2, 1, 1, 1, 4), (8, 4, 6, 6, 16)],
    (f"{D}score:BEYOND",): [(2.5,), (10.0,)],
    (f"{E}likelihood:FLOOR",): [(0.125,), (0.5,)],
    (f"{E}accuracy:Accuracy.width",): [(0.035,), (0.14,)],
    (
        *(f"{D}settle:{one}" for one in ("STARTS", "KEPT", "ROUGHLY", "FULLY", "SIMPLY", "FINELY", "AGAIN")),
        f"{SHORT}last",
    ): [(5, 1, 1, 6, 2, 1, 3, 2), (20, 6, 6, 24, 8, 4, 12, 8)],
    (f"{D}settle:TURNS",): [(1,), (4,)],
    (f"{D}settle:SMALLER", f"{D}settle:SHAPES"): [((0.1, 0.5), 0.25), ((0.4, 2.0), 1.0)],
    (f"{E}data:BEFORE",): [(10.0,), (40.0,)],
    (f"{E}model:MOST",): [(0.25,), (1.0,)],
    (f"{E}hypothesis:NARROW",): [(0.15,), (0.6,)],
    (f"{D}score:FEW",): [(1.5,), (6.0,)],
}
INTERVAL = {  # 90 % intervals of a cause's size, after a search
    (f"{E}interval:ROUNDS", f"{E}interval:DRAWS"): [(3, 75), (12, 300)],
    (f"{E}interval:FREEDOM",): [(5.0,), (20.0,)],
    (f"{E}interval:WIDER",): [(1.0,), (1.3,)],
    (f"{E}interval:ENOUGH", f"{E}interval:PLENTY"): [(20.0, 75.0), (80.0, 300.0)],
    (f"{E}interval:TRIED",): [(10,), (40,)],
}
RIVALS = {  # causes that a log does not tell from their neighbours, after a search
    (f"{D}separability:SHARED",): [(1.25,), (2.0,)],
    (f"{D}separability:SAMPLED",): [(1,), (6,)],
    (f"{D}separability:SIZES",): [((0.15, 0.75),), ((0.6, 3.0),)],
    (f"{D}separability:BEGUN", f"{D}separability:KEPT", f"{D}separability:ENDED"): [(1, 1, 1), (2, 4, 6)],
}
REST = {  # what is left where the library lacks the cause, after a search
    (f"{D}residual_fit:LEAST", f"{D}residual_fit:MORE"): [(0.01, 0.025), (0.04, 0.1)],
    (f"{D}residual_fit:NULLS",): [(6,), (24,)],
    (f"{D}residual_fit:MARGIN",): [(1.0,), (1.5,)],
    (f"{D}residual_fit:MOST",): [(1500,), (6000,)],
    (f"{D}residual_fit:FOLDS",): [(2,), (8,)],
    (f"{D}residual_fit:NEAR",): [(0.01,), (0.04,)],
    (f"{D}residual_fit:WILD",): [(0.0,), (0.004,)],
    tuple(f"{D}residual_fit:{one}" for one in ("TREES", "LEAVES", "BINS", "FARTHEST")): [
        (8, 4, 32, 2.5),
        (32, 16, 128, 10.0),
    ],
    (f"{D}unexplained:LONGEST_LEAD",): [(5,), (20,)],
}
LEG = {  # names on long lists
    (f"{D}shortlist:PROBED",): [(8,), (32,)],
    (f"{D}linear:SIZES",): [((1.0,),), ((0.25, 0.5, 1.0, 2.0, 4.0),)],
    (f"{D}linear:PULL",): [(1.5,), (6.0,)],
    (f"{LONG}halved",): [((1,),), ((2, 2),)],
    (f"{LONG}hopeless",): [(30.0,), (120.0,)],
    (f"{LONG}iterations", f"{LONG}again"): [(2, 1), (10, 4)],
    (f"{LONG}rivals", f"{LONG}rounds"): [(0, 1), (3, 4)],
    (f"{LONG}last", f"{LONG}ends"): [(1, 1), (2, 4)],
}
GROUND = {  # where a foot sticks and slips
    (f"{CONTACT}behind", f"{CONTACT}fine"): [(20.0, 4), (80.0, 16)],
    (f"{CONTACT}finished", f"{CONTACT}polished"): [(1, 1), (6, 6)],
    (f"{CONTACT}again", f"{CONTACT}last"): [(1, 1), (4, 4)],
}
TABLE = {
    "search": SEARCH,
    "interval": INTERVAL,
    "rivals": RIVALS,
    "rest": REST,
    "leg": LEG,
    "ground": GROUND,
}


def standing(name: str) -> Any:
    """The value in the code."""
    holder, what, field = _split(name)
    return signature(getattr(holder, what)).parameters[field].default if field else getattr(holder, what)


@contextmanager
def changed(name: str, value: Any) -> Iterator[None]:
    """With another value, in every module that has the constant from its own."""
    holder, what, field = _split(name)
    if field:
        function = getattr(holder, what)
        function = function.__init__ if isinstance(function, type) else function
        before = function.__defaults__, function.__kwdefaults__
        taken = {k: p.default for k, p in signature(function).parameters.items() if p.default is not p.empty}
        taken[field] = value
        if before[0]:
            function.__defaults__ = tuple(taken[k] for k in list(taken)[: len(before[0])])
        if before[1]:
            function.__kwdefaults__ = {k: taken[k] for k in before[1]}
        try:
            yield
        finally:
            function.__defaults__, function.__kwdefaults__ = before
        return
    own = getattr(holder, what)
    mine = lambda m: vars(m).get(what) is own  # noqa: E731
    holders = [m for name, m in list(modules.items()) if name.startswith("dynreg.") and mine(m)]
    try:
        for module in holders:
            setattr(module, what, value)
        yield
    finally:
        for module in holders:
            setattr(module, what, own)


def _split(name: str) -> tuple[Any, str, str]:
    module, _, rest = name.partition(":")
    what, _, field = rest.partition(".")
    return import_module(module), what, field
