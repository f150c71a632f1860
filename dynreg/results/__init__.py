"""Frozen results: what every verb answers, with a JSON form (`dynreg/schemas/`) and tables for notebooks.

Each module here is one row of the table: its public names are names of this package, and those of its classes that
have a schema of their own are in `RESULTS`.
"""

from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING

from dynreg.results.result import Result

if TYPE_CHECKING:  # for editors, which cannot run `_public`
    from dynreg.results.calibration import *
    from dynreg.results.causes import *
    from dynreg.results.changes import *
    from dynreg.results.comparison import *
    from dynreg.results.diagnosis import *
    from dynreg.results.doctor import *
    from dynreg.results.drift import *
    from dynreg.results.effects import *
    from dynreg.results.experiment import *
    from dynreg.results.gait import *
    from dynreg.results.gait_rounds import *
    from dynreg.results.helped import *
    from dynreg.results.navigation import *
    from dynreg.results.neighbours import *
    from dynreg.results.posterior import *
    from dynreg.results.protocol import *
    from dynreg.results.ranges import *
    from dynreg.results.refit import *
    from dynreg.results.result import *
    from dynreg.results.robots import *
    from dynreg.results.rollouts import *
    from dynreg.results.sentence import *
    from dynreg.results.stored import *
    from dynreg.results.trials import *


def _public() -> dict[str, object]:
    """{name: class or function} that the modules of this package define."""
    homes = [import_module(f"{__name__}.{module.name}") for module in iter_modules(__path__)]
    return {
        name: thing
        for home in homes
        for name, thing in vars(home).items()
        if not name.startswith("_") and getattr(thing, "__module__", None) == home.__name__
    }


_PUBLIC = _public()
globals().update(_PUBLIC)

RESULTS: dict[str, type[Result]] = {
    thing.schema_name(): thing
    for thing in _PUBLIC.values()
    if isinstance(thing, type) and issubclass(thing, Result) and thing.schema_name()
}
"""{name in its schema, such as "neighbours": class} of everything that a command answers."""

__all__ = sorted(("RESULTS", *_PUBLIC))  # noqa: PLE0605
