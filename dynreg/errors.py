"""The errors that dynreg raises: each says what is wrong, what was expected and what to do next."""

import difflib
import shlex
from collections.abc import Iterable

from dynreg.foreign import visible

LISTED = 12  # names in one error


class DynregError(Exception):
    """Root of every error that a user can cause or mend.

    The message is always one line, in which foreign text is `visible`: the bad value, what was expected, the next
    step.

    Parameters
    ----------
    problem : what is wrong, with the bad value in it.
    expected : what a good value looks like (valid choices, a range, a form).
    do : what to do next.
    """

    exit_status = 1

    def __init__(self, problem: str, *, expected: str, do: str):
        self.problem = _one_line(problem)
        self.expected = _one_line(expected)
        self.do = _one_line(do)
        super().__init__(self.problem)

    def __str__(self) -> str:
        return f"{self.problem}; expected {self.expected}; {self.do}"


class UsageError(DynregError):
    """A command or a call that was put together wrongly (exit status 2).

    setting : the setting whose name begins the problem, where it is about one; a command line names its flag.
    """

    exit_status = 2

    def __init__(self, problem: str, *, expected: str, do: str, setting: str = ""):
        super().__init__(problem, expected=expected, do=do)
        self.setting = setting


class LogError(DynregError):
    """A log that cannot be read or does not hold what is needed."""


class CheckError(LogError):
    """A log that was read as its map says, and that a check refuses."""


class MapError(DynregError):
    """A map file that does not say how a log becomes a robot's channels."""


class RobotError(DynregError):
    """A robot folder that is not one."""


class SimulationError(DynregError):
    """A simulation that diverged or was asked for something its engine does not offer."""


class PictureError(DynregError):
    """A picture that cannot be drawn on this machine."""


class BudgetError(DynregError):
    """A robot that may not be tried any further.

    what : which budget is spent: "trials", "seconds" or "falls"; "budget" where nothing tells.
    """

    def __init__(self, problem: str, *, expected: str, do: str, what: str = "budget"):
        super().__init__(problem, expected=expected, do=do)
        self.what = what


class ExecutorError(DynregError):
    """Work that cannot be handed out: no cluster, one of another version, a worker that is lost each time."""


class RegistryError(DynregError):
    """A registry directory that cannot be used as asked."""


class NoPlaceError(RegistryError):
    """A disk without room, a place that may not be written, a catalogue that stays locked."""


class Interrupted(NoPlaceError):
    """A transaction that the catalogue's server broke off: nothing of it was stored, and the same put may follow."""


class CorruptError(RegistryError):
    """Stored data lost or changed (exit status 3)."""

    exit_status = 3


class LimitError(RegistryError):
    """Stored data, or data to store, of more than a limit or the memory allows: they may be sound, so none is lost."""


class DiffersError(RegistryError):
    """Content that is another one than is stored under the same id or number."""


class NoMatchError(DynregError):
    """Nothing found, or nothing close enough (exit status 4)."""

    exit_status = 4


class AmbiguousError(NoMatchError):
    """A prefix or a name that fits more than one thing."""


class OldWord(FutureWarning):
    """A word that is called something else today; it still works."""


class Damaged(UserWarning):
    """A part of the registry that is passed over, as it is damaged; what was asked for does not need it."""


class Assumed(UserWarning):
    """What was taken for granted where somebody may have meant something else; the answer stands."""


class NotStored(UserWarning):
    """A result that is shown and not kept, as the registry may only be read."""


class Awaited(UserWarning):
    """A server that was there before and is waited for."""


class Renewed(UserWarning):
    """Files of an older registry that are written anew in the present form."""


def one_of(names: Iterable[str], given: object = "", none: str = "there is nothing to name") -> str:
    """What to expect where a name is none of `names`: these or, of many, those that `given` may have meant.

    none : what is said where there are no names at all.

    >>> one_of(["backlash", "payload"], "paylod")
    "one of 'backlash', 'payload'"
    >>> one_of([f"joint_{i}" for i in range(30)] + ["payload"], "paylod")
    "one of 31 names (near: 'payload')"
    >>> one_of([], "wide", none="robot.toml has no named ranges")
    'none: robot.toml has no named ranges'
    """
    known = list(names)
    if not known:
        return f"none: {none}"
    if len(known) <= LISTED:
        return f"one of {quoted(known)}"
    if near := difflib.get_close_matches(str(given), known, n=5):
        return f"one of {len(known)} names (near: {quoted(near)})"
    return f"one of {quoted(known[:LISTED])} and {len(known) - LISTED} more"


def nearest(given: str, known: Iterable[str], otherwise: str) -> str:
    """What to do about a name that is none of `known`: to write the nearest; `otherwise` where none is near.

    >>> nearest("paylod", ["backlash", "payload"], "see `dynreg effects`")
    "write 'payload', which is nearest to it"
    >>> nearest("xyz", ["backlash", "payload"], "see `dynreg effects`")
    'see `dynreg effects`'
    """
    near = difflib.get_close_matches(given, list(known), n=1)
    return f"write {near[0]!r}, which is nearest to it" if near else otherwise


def quoted(names: Iterable[str]) -> str:
    """Names in a sentence, as somebody would write them.

    >>> quoted(["knee", "hip"])
    "'knee', 'hip'"
    >>> quoted([])
    'none'
    """
    return ", ".join(map(repr, names)) or "none"


def taken_apart(message: str) -> tuple[str, str, str]:
    """(problem, expected, do) of an error's message; the last two are "" where it does not say them.

    >>> taken_apart("no log 'a'; expected a file; check the path")
    ("no log 'a'", 'a file', 'check the path')
    """
    problem, _, rest = message.partition("; expected ")
    expected, _, do = rest.rpartition("; ")
    return problem, expected, do


def command(*words: object) -> str:
    """A dynreg command as it is typed: words with spaces or signs that a shell reads are quoted.

    >>> command("query", "first run", "-k", 5)
    "dynreg query 'first run' -k 5"
    """
    return shlex.join(["dynreg", *map(str, words)])


def _one_line(text: str) -> str:
    return visible(" ".join(str(text).split()))
