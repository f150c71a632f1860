"""Which simulator: the one answer for every verb, by the same words.

A simulator is named by one of `WORDS` (`nominal`, or what the newest result about a recording found), by the id of a
simulator or an entry, or by the id of a result that recommends one. Its effects come with it.
"""

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from dynreg.errors import AmbiguousError, CorruptError, NoMatchError, UsageError
from dynreg.verbs.newest import about, newest_for
from dynreg.verbs.settings import today

if TYPE_CHECKING:
    from dynreg.registry import EntryRecord, PopulationRecord, Registry, ResultRecord
    from dynreg.sim.config import SimConfig
    from dynreg.sim.robot import Robot

NOMINAL, POSTERIOR = "nominal", "posterior"
Document = Mapping[str, Any]


@dataclass(frozen=True)
class Word:
    """What a word stands for: the simulator that the newest result of a kind tells.

    made_by : the verb. other : what it stands for where no result of that kind is stored.
    """

    kind: str
    made_by: str
    told: Callable[[Document], str | None]
    other: "Word | None" = None

    def told_by(self, record: "ResultRecord") -> str | None:
        """The id of the simulator that a result of its kind, or of the other one's, tells."""
        word = self.other if self.other is not None and record.kind == self.other.kind else self
        return word.told(record.document)


WORDS: Mapping[str, Word] = {
    "nearest": Word(
        "neighbours", "query", lambda d: d["neighbours"][0]["entry"] if d["neighbours"] else None
    ),
    "synthesised": Word("neighbours", "query", lambda d: (d.get("synthesised") or {}).get("simulator")),
    "@answer": Word("neighbours", "query", lambda d: d["answer"]),
    "calibrated": Word(
        "calibration",
        "calibrate",
        lambda d: d["simulator"],
        other=Word("diagnosis", "diagnose", lambda d: d.get("calibrated_simulator")),
    ),
    "diagnosed": Word(
        "diagnosis", "diagnose", lambda d: d.get("extended_simulator") or d.get("calibrated_simulator")
    ),
}
NAMES = (NOMINAL, *WORDS)
RECOMMENDED = {
    "neighbours": "@answer",
    "calibration": "calibrated",
    "diagnosis": "diagnosed",
}  # by a kind of result
OLD = {"neighbours": "nearest", "query": "@answer", "calibration": "calibrated", "diagnosis": "diagnosed"}


@dataclass(frozen=True)
class Simulator:
    """A simulator that was named: its configuration, effects included, and its robot.

    id : of the simulator or entry; None for the nominal one, which nobody needs to register.
    name : "leg-17" of an entry, else how it came about and the beginning of its id, with the version of its robot where
    that is another one than was asked with. lineage : how it came about.
    source : id of the result that told it, None where it was named itself.
    fitted_to : episodes of the recording to which it was fitted, or by which it was chosen, whole or in part; empty
    where nothing says that it was, None where it was and nothing says to which. parts : of that result, by episode or
    as "episode[3]" where an episode was cut into windows; None where no result says them. asked : the options of that
    result, by name; empty where it says none. inherited : episodes of the recording to which those were fitted that it
    came from.
    """

    id: str | None
    name: str
    lineage: Mapping[str, Any]
    config: "SimConfig"
    robot: "Robot"
    source: str | None = None
    fitted_to: frozenset[str] | None = frozenset()
    parts: Mapping[str, Sequence[str]] | None = None
    asked: Mapping[str, Any] = field(default_factory=dict)
    inherited: frozenset[str] = frozenset()


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
        return _with_parts(
            registry, found, _told_by(registry, identity, found.robot.name, recording), recording
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


def fitted_on(registry: "Registry", found: Simulator) -> tuple[Simulator, Document | None]:
    """The simulator with the parts of the recording that it was made of, and the newest result that tells it.

    None where no such result is stored.
    """
    recording = found.lineage.get("recording")
    document = _told_by(registry, found.id, found.robot.name, recording)
    return _with_parts(registry, found, document, recording), document


def shaped(registry: "Registry", found: Simulator, recording: str) -> frozenset[str] | None:
    """Episodes of a recording (its id) that shaped a simulator or one that it came from, as far as these are kept.

    None where one of them was fitted to the recording, and nothing says to which part of it.
    """
    own = _shaped(registry, found.id, found.lineage, found.robot.name, recording)
    before = _inherited(registry, found, recording)
    return None if own is None or before is None else own | before


def _inherited(registry: "Registry", found: Simulator, recording: str) -> frozenset[str] | None:
    """Those that shaped a simulator that it came from; see `shaped`."""
    out, lineage = frozenset(), found.lineage
    while (parent := lineage.get("parent")) is not None:
        try:
            lineage = registry.simulator(parent).get("lineage", {})
        except (NoMatchError, CorruptError):  # an entry, which no recording shaped, or one that is gone
            break
        own = _shaped(registry, parent, lineage, found.robot.name, recording)
        if own is None:
            return None
        out |= own
    return out


def _shaped(
    registry: "Registry", identity: str | None, lineage: Mapping[str, Any], robot: str, recording: str
) -> frozenset[str] | None:
    """Those that shaped this simulator alone, by its lineage, else by the result that tells it; see `shaped`."""
    fitted, several = lineage.get("recording"), lineage.get("recordings", ())
    if recording not in (fitted, *several):
        return frozenset() if fitted is None else _shaped_parts(registry, identity, lineage, robot, recording)
    names = lineage.get("episodes")
    if names is None:
        document = _told_by(registry, identity, robot, fitted)
        names = document and _fitted(document)
    if names is None:
        return None
    if fitted == recording:
        return frozenset(names)
    mine = _without(names, _prefixes(registry, recording))
    every = tuple(prefix for one in several for prefix in _prefixes(registry, one))
    return mine if mine or all(name.startswith(every) for name in names) else None


def _shaped_parts(
    registry: "Registry", identity: str | None, lineage: Mapping[str, Any], robot: str, recording: str
) -> frozenset[str] | None:
    """As `_shaped`, of a recording that was joined from some that may have shaped the simulator."""
    if not registry.holds(recording):
        return frozenset()
    out = frozenset()
    for part in registry.recording(recording).provenance.get("joined", ()):
        own = _shaped(registry, identity, lineage, robot, part)
        if own is None:
            return None
        out |= {prefix + name for name in own for prefix in _prefixes(registry, part)}
    return out


def _without(names: Collection[str], prefixes: Sequence[str]) -> frozenset[str]:
    """Of episodes of joined recordings, NAME/EPISODE, those that begin so, by their own names."""
    return frozenset(n.removeprefix(p) for n in names for p in prefixes if n.startswith(p))


def _prefixes(registry: "Registry", recording: str) -> list[str]:
    """What the episodes of a recording may be called by where it was joined with others; none where it is gone."""
    if not registry.holds(recording):
        return []
    return [f"{name}/" for name in (*registry.recording_info(recording).names, recording[:12])]


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


def made(lineage: Mapping[str, Any]) -> str:
    """How a simulator was made, in words.

    >>> made({"made_by": "query", "kind": "synthesised"}), made({"made_by": "calibrate cma"})
    ('synthesised', 'calibrated by cma')
    >>> made({"made_by": "calibrate staged", "stage": "air"})
    'calibrated by staged, air'
    """
    by = lineage.get("kind") or (lineage.get("made_by") or "").replace("calibrate", "calibrated by")
    stage = lineage.get("stage")
    return by if stage is None or by.endswith(f" {stage}") else f"{by}, {stage}"


def _newest(registry: "Registry", ref: str, recording: str, robot: str) -> "ResultRecord":
    """The newest result about a recording, for a robot (its name), that tells a word's simulator."""
    word, where, todo = WORDS[ref], " about this recording", ""
    for one in _each(word):
        if found := newest_for(registry, one.kind, recording, robot):
            return found
    others = sorted({str(r.document.get("robot")) for r in about(registry, word.kind, recording)})
    if others:
        where += f" and robot {robot!r} (there is one for {', '.join(map(repr, others))})"
        todo = f"run `dynreg {word.made_by}` on it with --robot {robot}, or name the other robot"
    raise _none_yet(ref, where, todo)


def _newest_of_all(registry: "Registry", ref: str) -> "ResultRecord":
    """The newest result of all that tells a word's simulator."""
    for one in _each(WORDS[ref]):
        try:
            return registry.latest(one.kind)
        except NoMatchError:
            continue
    raise _none_yet(ref, "")


def _each(word: Word) -> tuple[Word, ...]:
    """A word, and what it stands for else."""
    return (word,) if word.other is None else (word, word.other)


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
        document = _told_by(registry, found.id, found.robot.name, recording)
    return replace(_with_parts(registry, found, document, recording), source=record.id)


def stored(registry: "Registry", kind: str, identity: str, robot: "Robot | None" = None) -> Simulator:
    """A registered simulator or entry, by its kind and id; robot : its own, where that is loaded already."""
    from dynreg.sim.config import SimConfig
    from dynreg.sim.robot import load_robot

    if kind == "entry":
        entry = registry.load_entry(identity)
        record = registry.population(entry.population_id)
        config = SimConfig(record.robot_hash, record.name, entry.values, _effects(record, entry))
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


def _effects(record: "PopulationRecord", entry: "EntryRecord") -> dict[str, dict[str, float]]:
    """{key: values} of the effect that an entry carries; {} for none, and in populations of models."""
    from dynreg.sim.effects import term
    from dynreg.verbs.subjects import of_effects

    if not of_effects(record) or int(entry.weights["carried"]) < 0:
        return {}
    found = term(record.spec["terms"][int(entry.weights["carried"])])
    values = entry.weights["effects"].tolist()
    return {found.key: {p.name: v for p, v in zip(found.effect.parameters, values, strict=False)}}


def _fitted(document: Document) -> frozenset[str] | None:
    """Names of the episodes that a result's simulator was fitted to or chosen by; None where it does not say.

    Parts are told by episode, or as "episode[3]" where an episode was cut into windows.
    """
    parts = document.get("parts")
    if parts is None:
        return None
    return frozenset(re.sub(r"\[\d+\]$", "", name) for name in (*parts["fit"], *parts["select"]))


def _told_by(
    registry: "Registry", identity: str | None, robot: str, recording: str | None
) -> Document | None:
    """The newest of all results about a recording that tells a simulator (its id) of a robot (its name), or None."""
    for word in (each for one in WORDS.values() for each in _each(one)) if recording else ():
        for record in about(registry, word.kind, recording):
            if record.document.get("robot", robot) == robot and word.told(record.document) == identity:
                return record.document
    return None


def _with_parts(
    registry: "Registry", found: Simulator, document: Document | None, recording: str | None
) -> Simulator:
    """The simulator with what a result about the recording, else its own lineage, says that it was fitted to, and with
    what those were fitted to that it came from."""
    if recording is None:
        return found
    before = _inherited(registry, found, recording)
    if before is None:
        return replace(found, fitted_to=None)
    found = replace(found, inherited=before)
    if document is not None:
        told = {"parts": document.get("parts"), "asked": document.get("asked") or {}}
        return replace(found, fitted_to=_fitted(document), **told)
    own = _shaped(registry, found.id, found.lineage, found.robot.name, recording)
    return replace(found, fitted_to=own)


def _no_simulator(ref: str, record: "ResultRecord") -> NoMatchError:
    return NoMatchError(
        f"result {record.id[:12]} of kind {record.kind!r} tells no simulator for {ref!r}",
        expected="a query, a calibration or a diagnosis that left one",
        do="name a simulator; see `dynreg list --kind simulator`",
    )
