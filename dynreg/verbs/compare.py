"""Compare: which simulator, or model, predicts a robot best."""

import time
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

from dynreg.errors import DynregError, NoMatchError, UsageError
from dynreg.progress import Progress
from dynreg.verbs.newest import about, newest_for
from dynreg.verbs.settings import Settings, hold_out, option, seed, threads
from dynreg.verbs.simulator import NAMES, NOMINAL, OLD, RECOMMENDED, WORDS
from dynreg.verbs.simulators import simulator

if TYPE_CHECKING:
    from dynreg.compare.compare import Compared
    from dynreg.compare.contenders import Plan
    from dynreg.compare.rollouts import Scored
    from dynreg.results.comparison import Comparison
    from dynreg.sim.robot import Robot
    from dynreg.verbs.simulator import Simulator
    from dynreg.verbs.subjects import Recorded

MODELS = ("kinematic", "dynamic", "table", "network", "mlp")  # the names that `compare.contenders` knows
WHEELS = ("models", "starts", "generations", "longest")  # settings of robots on wheels alone


@dataclass(frozen=True)
class CompareSettings(Settings):
    """What `compare` can be told."""

    simulators: tuple[str, ...] | None = option(
        None,
        f"Simulators, entries, results that recommend one, or {', '.join(NAMES)}; may be repeated.",
        flag="--with",
        usual="nominal, and what the newest results found",
        metavar="A,B",
        repeated=True,
        old=OLD,
    )
    hold_out: str | None = hold_out("what no simulator was fitted to")
    models: tuple[str, ...] | None = option(
        None,
        "Models to make of a wheeled robot's commands.",
        usual=f"all: {','.join(MODELS)}",
        metavar="A,B",
        choices=MODELS,
    )
    starts: int = option(30, "Random starts of the networks.", least=1)
    generations: int = option(60, "Generations of the search that fits the dynamic model.", least=1)
    longest: float = option(2.0, "Seconds after which a held command counts as another.", above=0.0)
    seed: int = seed()
    threads: int = threads()

    def meant_for(self, robot: "Robot", on_wheels: bool) -> None:
        """UsageError for a setting that has no meaning for a robot: it would be left unused."""
        if not on_wheels:
            self.refuse(WHEELS, f"for robot {robot.name!r}, which has no wheels", "simulators, with --with")


def compare(asked: "Recorded", settings: CompareSettings, progress: Progress | None = None) -> "Comparison":
    """Compare simulators by their held-out error.

    The simulators replay data that none of them was fitted to. Rollouts last 0.1, 0.5 and 1 s, and as long as
    what was held out allows. Errors are given by channel, and relative to the first simulator with 90 %
    intervals.

    For a robot on wheels, models are also made from the first 84 % of the commands and judged on the last 16 %:
    kinematic (the closed form), dynamic (the unicycle, fitted), table (the closed form, corrected in cells of wheel
    speeds), network (three small networks), mlp (one network of three layers).

    Example: dynreg compare monday --with nominal,@answer --report monday.html

    Raises NoMatchError where the registry lacks a simulator, UsageError where fewer than two are to be compared,
    nothing was held out from all of them, or a setting has no meaning for the robot, and what `compare.compare` does.
    """
    from dynreg.compare.contenders import Plan as ModelPlan
    from dynreg.timed.wheels import steering
    from dynreg.verbs.comparison import document

    began = time.perf_counter()
    on_wheels = steering(asked.robot) is not None
    settings.meant_for(asked.robot, on_wheels)
    refs = found(asked) if settings.simulators is None else settings.simulators
    chosen = named(asked, refs)
    models = (settings.models if settings.models is not None else MODELS) if on_wheels else ()
    _require_two(models, chosen)
    same = [one.name for one in fields(ModelPlan) if one.name != "models"]
    plan = ModelPlan(models=models, **{name: getattr(settings, name) for name in same})
    commands = _commands(asked, chosen, plan, progress) if on_wheels else None
    scored, notes = _scored(asked, chosen, settings, commands, progress)
    seconds = time.perf_counter() - began
    notes = (*_without_cause(asked, refs), *notes)
    return document(asked, plan, chosen, scored, commands, notes, seconds)


def found(asked: "Recorded") -> tuple[str, ...]:
    """nominal, and the words for what the newest results about the recording recommend, each by its own kind."""
    out, recording = [NOMINAL], asked.recording.id
    for kind, word in RECOMMENDED.items():
        if newest_for(asked.registry, kind, recording, asked.robot.name) is None:
            continue
        try:
            simulator(asked.registry, word, asked.robot, recording)
        except NoMatchError:
            continue
        out.append(word)
    return tuple(out)


def named(asked: "Recorded", refs: tuple[str, ...]) -> "dict[str, Simulator]":
    """The simulators that `refs` name, each once, however often it is named, and each by a name of its own.

    The name begins with the words by which it was asked for: "diagnosed (calibrated 1a2b3c4d)".
    """
    once: dict[str, Simulator] = {}
    words: dict[str, list[str]] = {}
    for ref in refs:
        one = simulator(asked.registry, ref, asked.robot, asked.recording.id)
        once[one.config.id] = one
        mine = words.setdefault(one.config.id, [])
        mine += [ref] if ref in WORDS and ref not in mine else []
    told = {identity: _called(one.name, words[identity]) for identity, one in once.items()}
    many = [*told.values()]
    return {
        name if many.count(name) == 1 else f"{name} {identity[:8]}": once[identity]
        for identity, name in told.items()
    }


def _called(name: str, words: list[str]) -> str:
    """A simulator's name with the words before it; a single word with which it begins is not said twice.

    >>> _called("synthesised 1a2b3c4d", ["synthesised"]), _called("extended 1a2b3c4d", ["diagnosed"])
    ('synthesised 1a2b3c4d', 'diagnosed (extended 1a2b3c4d)')
    """
    return f"{', '.join(words)} ({name})" if words and words != name.split()[:1] else name


def _without_cause(asked: "Recorded", refs: tuple[str, ...]) -> tuple[str, ...]:
    """A note where the newest diagnosis named no cause: "diagnosed" is then its calibrated simulator."""
    told = [
        record
        for record in (about(asked.registry, "diagnosis", asked.recording.id) if "diagnosed" in refs else ())
        if record.document.get("robot", asked.robot.name) == asked.robot.name
    ]
    if not told or told[0].document.get("extended_simulator"):
        return ()
    note = f"the newest diagnosis, {told[0].id[:12]}, named no cause: diagnosed is its calibrated simulator"
    earlier = next((one for one in told[1:] if one.document.get("extended_simulator")), None)
    if earlier is None:
        return (note,)
    causes = ", ".join(one["effect"] for one in earlier.document.get("causes", ())) or "a cause"
    return (f"{note}. An earlier one, {earlier.id[:12]}, named {causes}: --with {earlier.id[:12]}",)


def _require_two(models: tuple[str, ...], chosen: "dict[str, Simulator]") -> None:
    many = len({*models}) + len(chosen)
    if many < 2:
        raise UsageError(
            f"{many} to compare",
            expected="two simulators, or models of a wheeled robot",
            do="name more with --with, or run a query or a diagnosis of the recording first",
        )


def _commands(
    asked: "Recorded",
    chosen: "dict[str, Simulator]",
    plan: "Plan",
    progress: Progress | None,
) -> "Compared":
    """Models and simulators on the last commands of a wheeled robot's recording."""
    from dynreg.compare.compare import compare as compare_all
    from dynreg.verbs.unseen import seen

    known = {name: seen(asked, one) for name, one in chosen.items()}
    replayed = {name: (one.robot, one.config) for name, one in chosen.items()}
    return compare_all(asked.robot, asked.recording, replayed, plan, known, progress)


def _scored(
    asked: "Recorded",
    chosen: "dict[str, Simulator]",
    settings: CompareSettings,
    commands: "Compared | None",
    progress: Progress | None,
) -> "tuple[Scored | None, tuple[str, ...]]":
    """Held-out errors of two simulators or more; a note where commands alone can be compared."""
    from dynreg.compare.rollouts import score
    from dynreg.verbs.unseen import seen

    if len(chosen) < 2:
        return None, ()
    simulators = {name: (one.robot, one.config) for name, one in chosen.items()}
    known = [seen(asked, one) for one in chosen.values()]
    how = {"threads": settings.threads, "progress": progress}
    try:
        scored = score(asked.robot, asked.recording, simulators, known, settings.hold_out, **how)
        return scored, _too_long(scored)
    except DynregError as error:
        if commands is None:
            raise
        return None, (f"no rollouts are compared: {error}",)


def _too_long(scored: "Scored") -> tuple[str, ...]:
    """A note where rollouts of some lengths are left out."""
    if not scored.too_long:
        return ()
    lengths = ", ".join(f"{seconds:.3g}" for seconds in scored.too_long)
    return (f"rollouts of {lengths} s are left out: nothing so long was held out from all simulators",)
