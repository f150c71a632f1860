"""What logs of joints show that makes them useless to tell what a robot is: one finding for each cause."""

from collections.abc import Iterable, Iterator, Sequence

from dynreg.data.behaviour.chatter import chatter, unmeasured
from dynreg.data.behaviour.effort import saturation
from dynreg.data.behaviour.joint import Seen, joints_of
from dynreg.data.behaviour.stop import stop
from dynreg.data.behaviour.target import targets
from dynreg.data.episodes import RawEpisode
from dynreg.data.schema import RecordingSpec
from dynreg.data.series import Finding

__all__ = ["check_behaviour"]

NAMED = 3  # joints that a finding names one by one
_CHATTER = (
    "lower kd, or log faster; to use the log as it is, leave {them} out: weight = 0 of {their} channels in robot.toml, "
    "or --joints with the others"
)
TOLD = {  # what was seen, and what to do
    ("chatter", ""): (
        "{oscillate} at about half the sampling rate in {0} of the log (at {1} of {2}, amplitude {3}): the drive is "
        "unstable or the log is aliased",
        _CHATTER,
    ),
    ("chatter", "aliased"): (
        "{have} a velocity of {0} that the position does not go along with ({1}): the drive is unstable and the log is "
        "aliased",
        _CHATTER,
    ),
    ("velocity", "constant"): (
        "{have} a velocity of {0} in all of the log while the position moves: it was not measured",
        "in the map, give its channel derivative_of (the channel of the position) in place of source",
    ),
    ("stop", "largest"): (
        "{stand} at {0} in {1} of the samples while the target is up to {2} beyond: {it_is} at a stop",
        "keep the target within it",
    ),
    ("stop", "both"): (
        "{stand} at {0} and at {1} in {2} of the samples while the target is up to {3} beyond: {it_is} at a stop on "
        "both sides",
        "keep the target within them",
    ),
    ("target", "order"): (
        "{follow} the target of {other} (correlation {0}), not the own ({1}): joints are swapped",
        "correct their order in the log or in the map",
    ),
    ("target", "unit"): (
        "{move} {0} times as far as the target: {other} is in deg, the other in rad",
        "set `unit` in the map",
    ),
    ("target", "sign"): (
        "{move} against the target (correlation {0}): one of the two has the wrong sign",
        "set scale = -1 in the map",
    ),
    ("target", "zero"): (
        "{follow} the target {0} off it in all of the log: one of the two has a wrong zero",
        "set `offset` in the map",
    ),
    ("target", "far"): (
        "{stay} at least {0} off the target in all of the log: the drive is off or weak, or the order of joints or a "
        "zero is wrong",
        "check both",
    ),
}
TOLD["stop", "smallest"] = TOLD["stop", "largest"]
SATURATED = (
    "{stand} at the largest {kind}, {1}, in {0} of the moving samples: the drive is at its limit",
    "move slower, carry less or lower its gains",
)
ONE = {"it_is": "it is", "them": "it", "their": "its"}
MANY = {"it_is": "they are", "them": "them", "their": "their"}
VERBS = {
    "oscillate": "oscillates",
    "stand": "stands",
    "follow": "follows",
    "move": "moves",
    "stay": "stays",
    "have": "has",
}


def check_behaviour(
    episodes: Iterable[RawEpisode], spec: RecordingSpec, known: Sequence[Finding] = ()
) -> Iterator[Finding]:
    """What keeps a log of joints from being of use, over all its episodes; joints that are alike are one finding.

    Of each joint the first that is found, in the order of what causes what: with another's target a drive is far off
    its own and gives all it can, and a drive that is unstable does that, too.
    known : findings of other checks. Of joints of which these say that a unit is wrong, or that they are stuck, nothing
    more is said.
    """
    episodes = list(episodes)
    told = [f.where for f in known if f.check in ("units", "stuck")]
    joints = [j for j in joints_of(episodes, spec) if not any(f", {j.name}/" in where for where in told)]
    seen = targets(joints)
    for joint in joints:
        checks = (check(joint) for check in (unmeasured, chatter, stop, saturation))
        found = seen.get(joint.name) or next((one for one in checks if one is not None), None)
        if found is not None:
            seen[joint.name] = found
    alike: dict[tuple, list[str]] = {}
    for joint in joints:
        if one := seen.get(joint.name):
            key = (one.check, one.kind, one.units, one.other if one.kind == "unit" else "")
            alike.setdefault(key, []).append(joint.name)
    files = [*dict.fromkeys(episode.file for episode in episodes)]
    where = f"{files[0]} and {len(files) - 1} more" if files[1:] else "".join(files)
    for names in alike.values():
        text, do = _texts(names, [seen[name] for name in names])
        who = f"all {len(names)} joints" if 1 < len(names) == len(joints) else _named(names)
        yield Finding("warning", seen[names[0]].check, f"{where}, {who}", text, do)


def _texts(names: Sequence[str], seen: Sequence[Seen]) -> tuple[str, str]:
    """What was seen of some joints, with the numbers of all of them, and what to do."""
    first = seen[0]
    numbers = [_range([s.numbers[k] for s in seen], unit) for k, unit in enumerate(first.units)]
    said, do = TOLD.get((first.check, first.kind), SATURATED)
    verbs = VERBS if len(seen) == 1 else {verb: verb for verb in VERBS}
    pairs = ", ".join(f"{name} that of {one.other}" for name, one in zip(names, seen, strict=True))
    other = first.other if len(seen) == 1 or first.kind != "order" else f"another joint ({pairs})"
    words = dict(kind=first.kind, other=other, **(ONE if len(seen) == 1 else MANY), **verbs)
    return said.format(*numbers, **words), do.format(**words)


def _named(names: Sequence[str]) -> str:
    """ "hip", "hip and knee", "12 joints (FL_hip to RR_calf)"."""
    if len(names) > NAMED:
        return f"{len(names)} joints ({names[0]} to {names[-1]})"
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def _range(values: Sequence[float], unit: str) -> str:
    """Values with their unit: "12 %", "0.5 to 0.7 rad"."""
    low, high = (f"{end:.0f}" if unit == "%" else f"{end:.3g}" for end in (min(values), max(values)))
    return (low if low == high else f"{low} to {high}") + (f" {unit}" if unit else "")
