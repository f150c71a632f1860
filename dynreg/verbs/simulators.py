"""Which simulator: the one answer for every verb, by the same words.

A simulator is named by one of `NAMES` (`nominal`, or what the newest result about a recording found), by the id of a
simulator or an entry, or by the id of a result that recommends one. Its effects come with it.
"""

from dataclasses import replace
from typing import TYPE_CHECKING

from dynreg.errors import AmbiguousError, NoMatchError, UsageError
from dynreg.verbs.newest import about, newest_for
from dynreg.verbs.settings import today
from dynreg.verbs.shaped import newest_telling, with_parts
from dynreg.verbs.simulator import NAMES, NOMINAL, OLD, RECOMMENDED, WORDS, Simulator, made

if TYPE_CHECKING:
    from dynreg.registry import EntryRecord, PopulationRecord, Registry, ResultRecord
    from dynreg.sim.robot import Robot


def simulator(registry: "Registry", ref: str, robot: "Robot", recording: str | None = None) -> Simulator:
    """The simulator that `ref` names: one of `NAMES`, or the id of a simulator, an entry or a result.

    recording : id of the recording about which the results are that the words ask for; those for other robots than
    `robot`, by its name, do not count. The words hide nothing: what else can be named here has an id and no name.
    Raises NoMatchError where there is no such simulator, or no such result yet.
    """
    ref = today(ref, OLD)
    if ref == NOMINAL:
        from dynreg.sim.config import SimConfig

        config = SimConfig.of(robot, robot.space.nominal)
        return Simulator(None, NOMINAL, {"kind": NOMINAL}, config, robot)
    if ref in WORDS:
        if recording is None:
            raise _none_yet(ref, " about this recording")
        return _told(registry, _newest(registry, ref, recording, robot.name), ref, robot, recording)
    try:
        kind, identity = registry.resolve(ref, ("simulator", "entry", "result"))
    except AmbiguousError:
        raise
    except NoMatchError:
        raise NoMatchError(
            f"no simulator is called {ref!r}",
            expected=f"one of {', '.join(NAMES)}, or the id of a simulator, an entry or a result",
            do="see `dynreg list --kind simulator`",
        ) from None
    if kind != "result":
        found = stored(registry, kind, identity, robot)
        return with_parts(
            registry, found, newest_telling(registry, identity, found.robot.name, recording), recording
        )
    record = registry.result(identity)
    if record.kind not in RECOMMENDED:
        raise _no_simulator(ref, record)
    return _told(registry, record, RECOMMENDED[record.kind], robot, recording)


def told_last(registry: "Registry", ref: str) -> str:
    """The id of the simulator that a word of `WORDS` stands for in the newest result; another `ref` as it is.

    A thing of that name goes before the word. Raises NoMatchError where no result tells such a simulator yet.
    """
    if ref not in WORDS:
        return ref
    try:
        return registry.resolve(ref)[1]
    except NoMatchError:
        record = _newest_of_all(registry, ref)
    identity = WORDS[ref].told_by(record)
    if identity is None:
        raise _no_simulator(ref, record)
    return identity


def named(registry: "Registry", ref: str) -> Simulator:
    """The simulator that `ref` names, whatever its robot: a word of `WORDS`, which the newest result of all tells, or
    the id of a simulator, an entry or a result that recommends one.

    Raises NoMatchError where there is no such simulator, or no such result yet.
    """
    try:
        kind, identity = registry.resolve(told_last(registry, ref), ("simulator", "entry", "result"))
    except NoMatchError as error:
        raise _no_recording(registry, ref) or error from None
    if kind == "result":
        record = registry.result(identity)
        told = RECOMMENDED.get(record.kind)
        recommended = told and WORDS[told].told(record.document)
        if recommended is None:
            raise _no_simulator(ref, record)
        kind, identity = registry.resolve(recommended, ("simulator", "entry"))
    return stored(registry, kind, identity)


def stored(registry: "Registry", kind: str, identity: str, robot: "Robot | None" = None) -> Simulator:
    """A registered simulator or entry, by its kind and id; robot : its own, where that is loaded already."""
    from dynreg.sim.config import SimConfig
    from dynreg.sim.robot import load_robot

    if kind == "entry":
        entry = registry.load_entry(identity)
        record = registry.population(entry.population_id)
        config = SimConfig(record.robot_hash, record.name, entry.values, effects_of(record, entry))
        name, lineage = f"{record.name}-{entry.number}", {"kind": "entry"}
    else:
        document = registry.simulator(identity)
        config, lineage = SimConfig.from_dict(document), document.get("lineage", {})
        name = f"{made(lineage) or kind} {identity[:8]}"
    same = robot is not None and config.robot == robot.hash
    owner = robot if same else load_robot(registry.robot_folder(config.robot))
    if robot is not None and not same:
        version = registry.robot_info(config.robot).version
        name += f" (version {version})" if owner.name == robot.name else f" ({owner.name})"
    return Simulator(identity, name, lineage, config, owner)


def own(found: Simulator, robot: "Robot") -> Simulator:
    """The simulator again; UsageError where it is of another robot, or of another version of it."""
    if found.config.robot != robot.hash:
        version = "another version of " if found.config.robot_name == robot.name else ""
        again = f", or ask with --robot {found.config.robot[:12]}" if version else ""
        raise UsageError(
            f"simulator {found.name!r} is of {version}robot {found.config.robot_name!r} ({found.config.robot[:12]})",
            expected=f"a simulator of {robot.name!r} ({robot.hash[:12]})",
            do=f"name another; see `dynreg list --kind simulator`{again}",
        )
    return found


def _no_recording(registry: "Registry", ref: str) -> NoMatchError | None:
    """The error where a recording is named in place of a simulator; None where `ref` is no recording."""
    try:
        registry.resolve(ref, ("recording",))
    except NoMatchError:
        return None
    return NoMatchError(
        f"{ref!r} is a recording here, and no simulator",
        expected=f"what a result found, one of {', '.join(WORDS)}, or the id of a simulator, an entry or a result",
        do="name one, such as diagnosed; see `dynreg list --kind result`",
    )


def _newest(registry: "Registry", ref: str, recording: str, robot: str) -> "ResultRecord":
    """The newest result about a recording, for a robot (its name), that tells a word's simulator."""
    word, where, todo = WORDS[ref], " about this recording", ""
    for one in word.each():
        if found := newest_for(registry, one.kind, recording, robot):
            return found
    others = sorted({str(r.document.get("robot")) for r in about(registry, word.kind, recording)})
    if others:
        where += f" and robot {robot!r} (there is one for {', '.join(map(repr, others))})"
        todo = f"run `dynreg {word.made_by}` on it with --robot {robot}, or name the other robot"
    raise _none_yet(ref, where, todo)


def _newest_of_all(registry: "Registry", ref: str) -> "ResultRecord":
    """The newest result of all that tells a word's simulator."""
    for one in WORDS[ref].each():
        try:
            return registry.latest(one.kind)
        except NoMatchError:
            continue
    raise _none_yet(ref, "")


def _none_yet(ref: str, about: str, todo: str = "") -> NoMatchError:
    """The error of a word of which no result is stored. todo : what to do then; by default to run its verb."""
    word = WORDS[ref]
    kind = "query" if word.made_by == "query" else word.kind
    return NoMatchError(
        f"no {ref!r} simulator: no {kind}{about} is stored",
        expected=f"one of {', '.join(NAMES)}, or an id",
        do=todo or f"run `dynreg {word.made_by}` on it first, or name another simulator",
    )


def _told(
    registry: "Registry", record: "ResultRecord", word: str, robot: "Robot", recording: str | None
) -> Simulator:
    """The simulator that a result tells under a word."""
    identity = WORDS[word].told_by(record)
    if identity is None:
        raise _no_simulator(word, record)
    found = stored(registry, *registry.resolve(identity, ("simulator", "entry")), robot)
    document = record.document
    if record.recording_id != recording:
        document = newest_telling(registry, found.id, found.robot.name, recording)
    return replace(with_parts(registry, found, document, recording), source=record.id)


def effects_of(record: "PopulationRecord", entry: "EntryRecord") -> dict[str, dict[str, float]]:
    """{key: values} of the effect that an entry carries; {} for none, and in populations of models."""
    from dynreg.sim.effects import term
    from dynreg.verbs.subjects import of_effects

    if not of_effects(record) or int(entry.weights["carried"]) < 0:
        return {}
    found = term(record.spec["terms"][int(entry.weights["carried"])])
    values = entry.weights["effects"].tolist()
    return {found.key: {p.name: v for p, v in zip(found.effect.parameters, values, strict=False)}}


def _no_simulator(ref: str, record: "ResultRecord") -> NoMatchError:
    return NoMatchError(
        f"result {record.id[:12]} of kind {record.kind!r} tells no simulator for {ref!r}",
        expected="a query, a calibration or a diagnosis that left one",
        do="name a simulator; see `dynreg list --kind simulator`",
    )
