"""Results as rich tables, at most 100 columns wide: each by the room of its kind."""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType
from typing import Any

from rich.console import RenderableType

from dynreg.errors import CorruptError, DynregError
from dynreg.report.grid import table, value_text
from dynreg.results.result import Result

# the rooms that several kinds of results share; every other kind has the room of its own name, or none
_SHARED = dict.fromkeys(("robot_check", "robot_draft", "robot_folder"), "robots") | dict.fromkeys(
    (
        *("population", "recording", "list", "entry", "verify", "removal", "collection", "import"),
        *("report", "dataset_export"),
    ),
    "stored",
)


def room(result: Result) -> ModuleType | None:
    """The module with `tables(result)`; None where a plain table serves.

    It has `page(result)` where there is a page, `refusal(result)` where an answer may be that nothing fits, and
    `hint(result)` where something else comes next than the page.
    """
    kind = result.schema_name()
    name = f"{__package__}.{_SHARED.get(kind, kind)}"
    return import_module(name) if kind and find_spec(name) else None


def render(result: Result, **how: Any) -> RenderableType:
    """The tables of a result, its text fit to be shown. how : what its room can be told besides."""
    found, shown = room(result), result.visible()
    if found is None:
        return table(("", ""), [(key, value_text(value)) for key, value in shown.to_dict().items()])
    return found.tables(shown, **how)


def refusal(result: Result) -> DynregError | None:
    """The error with which a command ends after its answer; None where all is well."""
    found = getattr(room(result), "refusal", None)
    return found and found(result)


def hint(result: Result) -> str:
    """What to type after a stored result: what its room says, else how to see its page."""
    found = getattr(room(result), "hint", None)
    return (found and found(result)) or "dynreg report @last"


@contextmanager
def shown_again(result: Result) -> Iterator[None]:
    """A block that shows a result out of a registry; CorruptError where the result contradicts itself.

    Its schema tells the kinds of its values, not that a name in one place is explained in another.
    """
    try:
        yield
    except (LookupError, ValueError, TypeError, ArithmeticError, AttributeError) as error:
        raise CorruptError(
            f"the stored {result.schema_name()} contradicts itself ({type(error).__name__}: {error})",
            expected="a result as dynreg made it",
            do="run the command that made it again",
        ) from error
