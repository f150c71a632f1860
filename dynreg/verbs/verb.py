"""Verbs as rows: the function, its settings, and its Python method and command.

A verb is a function (asked, settings, progress) -> Result. `asked` is a `Recorded` or a `Built`: the registry, with
the recording or the robot that it is about. What it answers is stored, and kept under the kind that its schema names.
A verb's module loads quickly, as the help of the program needs its settings: what is heavy is imported where it runs.
"""

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from dynreg.progress import Progress
from dynreg.verbs.settings import Settings, taking

if TYPE_CHECKING:
    from dynreg.registry import Registry
    from dynreg.results.stored import RecordingSummary
    from dynreg.sim.robot import Robot

Answer = TypeVar("Answer")
_COMMANDS = ("Example:", "Exit status")  # how paragraphs begin that a command alone shows
_TAKEN = {
    "recording": """recording : a registered one by its id, name, `@last` or summary, or the path of a log of `robot`.
robot : packaged name, folder, name or hash in the registry, or robot; needed for a log, and any that has the
    recording's channels may be named.
log_map : a map file, for a log that needs one; refused where every recording is stored already.
progress : is called with (stage, done, total).""",
    "robot": """robot : packaged name, folder or robot.
progress : is called with (stage, done, total).""",
}


@dataclass(frozen=True)
class Built:
    """A robot that a verb is asked about, and where the answer is kept."""

    registry: "Registry"
    robot: "Robot"


@dataclass(frozen=True)
class Verb:
    """One row: the function, its settings, and what it is about.

    ingest : whether a log that is given by its path is registered before the verb begins, as when its answer is kept;
    else it is registered with the answer. several : whether it may be asked about several recordings at once. keeps :
    whether it stores its answer itself, for it does more once that is stored. faster : of its settings, what a user can
    do where it takes long, told by the command; None where there is nothing.
    """

    run: Callable[..., Any]
    settings: type[Settings]
    about: Literal["recording", "robot"]
    ingest: bool = False
    several: bool = False
    keeps: bool = False
    faster: Callable[[Any], str] | None = None

    def ask(
        self,
        registry: "Registry",
        recording: "str | Path | RecordingSummary | Sequence[str | Path | RecordingSummary]",
        settings: Settings,
        robot: "str | Path | Robot | None",
        log_map: str | Path | None,
        progress: Progress | None,
    ) -> Any:
        """What a verb about a recording answers, stored."""
        from dynreg.verbs.several import joined
        from dynreg.verbs.subjects import every_recorded

        references = [*recording] if self.several and isinstance(recording, list | tuple) else [recording]
        each = every_recorded(registry, references, robot, log_map, ingest=self.ingest)
        asked = joined(each) if len(each) > 1 else each[0]
        found = self.run(asked, settings, progress)
        if not self.keeps:
            asked.keep(found)
        return found

    @property
    def help(self) -> str:
        """What it does and an example, for the command line: the docstring, without what Python raises."""
        return inspect.getdoc(self.run).partition("\n\nRaises")[0]

    @property
    def doc(self) -> str:
        """What it does, raises and takes beside its settings, for Python: without what is said of commands."""
        said = inspect.getdoc(self.run).split("\n\n")
        return "\n\n".join([*(part for part in said if not part.startswith(_COMMANDS)), _TAKEN[self.about]])


def about_recording(
    run: Callable[..., Answer],
    settings: type[Settings],
    *,
    ingest: bool = False,
    several: bool = False,
    faster: Callable[[Any], str] | None = None,
) -> Callable[..., Answer]:
    """The method of a session for a verb that is asked about a recording; see `Verb`."""
    verb = Verb(run, settings, "recording", ingest, several, faster=faster)

    def method(
        self,
        recording: "str | Path | RecordingSummary | Sequence[str | Path | RecordingSummary]",
        *,
        robot: "str | Path | Robot | None" = None,
        log_map: str | Path | None = None,
        progress: Progress | None = None,
        **told: Any,
    ) -> Answer:
        return verb.ask(self.registry, recording, settings(**told), robot, log_map, progress)

    return _row(method, verb)


def about_robot(run: Callable[..., Answer], settings: type[Settings]) -> Callable[..., Answer]:
    """The method of a session for a verb that is asked about a robot."""

    def method(self, robot: "str | Path | Robot", *, progress: Progress | None = None, **told: Any) -> Answer:
        from dynreg.verbs.subjects import loaded_robot

        chosen = settings(**told)
        found = run(Built(self.registry, loaded_robot(robot, registry=self.registry)), chosen, progress)
        self.registry.put_result(found.schema_name(), None, found.to_dict())
        return found

    return _row(method, Verb(run, settings, "robot"))


def of_verb(verb: Verb) -> Callable[[Callable[..., Answer]], Callable[..., Answer]]:
    """Decorator of a method that is written out: it has the arguments of its verb, and the row itself as `verb`."""

    def wrap(method: Callable[..., Answer]) -> Callable[..., Answer]:
        method.verb = verb
        return taking(verb.settings)(method)

    return wrap


def _row(method: Callable[..., Answer], verb: Verb) -> Callable[..., Answer]:
    """The method with the name and the help of its verb, too."""
    method.__name__ = verb.run.__name__
    method.__qualname__ = f"Session.{verb.run.__name__}"
    method.__doc__ = verb.doc
    method.__annotations__["return"] = inspect.signature(verb.run).return_annotation
    return of_verb(verb)(method)
