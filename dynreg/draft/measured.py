"""The law of the drives by a log: how torques follow targets or speeds, where they stop, and how far commands go."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynreg.draft.drives import Drive
from dynreg.draft.entry import DraftOptions, Notes, listed
from dynreg.draft.heard import Heard
from dynreg.draft.stated import of_joint

EFFORT = "torque"  # the quantity of a joint's measured torque
LEAST = 200  # samples from which a law is fitted
UNEXPLAINED = 0.02  # share of the torque's variance that a law may leave: sensors' noise leaves below 0.001
SATURATED = 0.95  # of the largest torque from which on a drive may be at its limit, and follow no law
PASSED = 1.001  # times a range at which a command is beyond it: logs round
# By which a gain may differ from the log's and be the same, and share of the torque below which its part tells nothing:
# torques are measured no better.
AGREES = 0.1
# Samples at the very same largest torque, from which on that is a limit: of numbers that are not rounded no two are
# equal by chance, and of a signal at its peak none.
STOPS = 3
EQUAL = 1e-6  # relative difference of such samples: logs keep seven digits
ASKS = 1.02  # times the largest torque that the law asks for at a limit: no gain is known better


@dataclass(frozen=True)
class Law:
    """The gains that torques follow. gains : {gain: value}. parts : {gain: share of the torque that 1 of it makes}."""

    gains: Mapping[str, float]
    parts: Mapping[str, float]

    def told(self, stated: Mapping[str, float] | None = None) -> frozenset[str]:
        """The gains that make a part of the torque large enough to be known, here or as stated {gain: value}."""
        large = {key: max(value, (stated or {}).get(key, 0.0)) for key, value in self.gains.items()}
        return frozenset(key for key, value in large.items() if self.parts[key] * value >= AGREES)

    def contradicted(self, stated: Mapping[str, float]) -> frozenset[str]:
        """The gains that are known and differ from those stated {gain: value}."""
        return frozenset(
            key for key in self.told(stated) if abs(self.gains[key] - stated[key]) > AGREES * stated[key]
        )


def with_measured_gains(drives: Sequence[Drive], told: Heard | None, notes: Notes) -> tuple[Drive, ...]:
    """The drives with gains marked as measured where the log's torques follow them, and guessed ones replaced by these.

    A gain that the user or the model states stays where the log has another, which is noted.
    """
    if told is None:
        return tuple(drives)
    laws = {d.joint: law for d in drives if (law := law_of(told, d)) is not None}
    other, out = [], []
    for drive in drives:
        law = laws.get(drive.joint)
        if law is None:
            out.append(drive)
            continue
        if drive.guessed:
            gains = {key: float(f"{value:.3g}") for key, value in law.gains.items()}
            of_log = {"guessed": False, "measured": law.told(), "said": "of the log's torques"}
            out.append(replace(drive, **gains, **of_log))
            continue
        stated = {key: getattr(drive, key) for key in law.gains}
        if differ := law.contradicted(stated):
            out.append(drive)
            other.append(
                f"{drive.joint}: " + ", ".join(f"{key} {law.gains[key]:.3g}" for key in sorted(differ))
            )
        else:
            out.append(replace(drive, measured=law.told(stated)))
    if same := [d.joint for d in out if d.measured]:
        notes.add(
            f"the log's torques follow the gains of {len(same)} joints: these are doubted by {AGREES:.0%} only, as far "
            "as torques are measured"
        )
    if other:
        notes.add(f"the log's torques follow other gains than those stated ({listed(other)})")
    return tuple(out)


def with_measured_limits(
    drives: Sequence[Drive], told: Heard | None, options: DraftOptions, notes: Notes
) -> tuple[Drive, ...]:
    """The drives with the limits at which the log's torques stop, in place of the model's; what is stated stays.

    Where the user states another limit, that is noted.
    """
    found = {d.joint: limit for d in drives if told is not None and (limit := limit_of(told, d)) is not None}
    other, contradicted, out = [], [], []
    for drive in drives:
        limit = found.get(drive.joint)
        same = limit is not None and drive.limit is not None and abs(limit - drive.limit) <= EQUAL * limit
        if limit is None:
            out.append(drive)
        elif not same and of_joint(options.torque_limit, drive.joint) is not None:
            contradicted.append(f"{drive.joint}: {limit:g}")
            out.append(drive)
        else:
            out.append(replace(drive, limit=limit, measured=drive.measured | {"torque_limit"}))
            before = "none" if drive.limit is None else f"{drive.limit:g}"
            other += [] if same else [f"{drive.joint}: {limit:g}, the model says {before}"]
    if other:
        notes.add(f"the log's torques stop at a limit, which the drive gets ({listed(other)})")
    if contradicted:
        notes.add(f"the log's torques stop at other limits than those stated ({listed(contradicted)})")
    return tuple(out)


def limit_of(told: Heard, drive: Drive) -> float | None:
    """The torque at which a joint's measured torques stop while its law asks for more; None where they do not.

    The law is that of the samples below the largest torque. A signal that is rounded tells no limit: many of its
    largest values are equal by chance.
    """
    law, samples = law_of(told, drive), _samples(told, drive)
    if law is None or samples is None:
        return None
    _, columns, torque = samples
    size = np.abs(torque)
    most = float(size.max())
    at = size >= (1.0 - EQUAL) * most
    asked = np.abs(columns @ np.array([*law.gains.values()]))[at]
    rounds = len(np.unique(size)) < len(size) / 2
    if at.sum() < STOPS or rounds or np.median(asked) < ASKS * most:
        return None
    return float(f"{most:.6g}")


def without_passed_ranges(drives: Sequence[Drive], told: Heard | None, notes: Notes) -> tuple[Drive, ...]:
    """The drives of torques and speeds, where a range that the model states and the log's commands pass is no limit.

    The robot took these commands: a simulator that cuts them would move otherwise. Targets are left alone, since a
    controller may ask for more than a servo is given.
    """
    passed = {
        d.joint: (most, max(abs(d.low), abs(d.high)))
        for d in drives
        if told is not None
        and d.kind != "position"
        and not d.usual
        and d.low is not None
        and d.high is not None
        if (most := told.largest(d.action)) > PASSED * max(abs(d.low), abs(d.high))
    }
    if passed:
        cases = listed([f"{joint}: {most:.3g}, {end:.3g}" for joint, (most, end) in passed.items()])
        notes.add(
            f"the log's commands go beyond the range that the model states ({cases}): the log's counts. If the log has "
            "another unit, correct the map"
        )
    return tuple(replace(d, usual=True) if d.joint in passed else d for d in drives)


def law_of(told: Heard, drive: Drive) -> Law | None:
    """The gains by which a joint's measured torques follow its commands; None where they follow no such law.

    Least squares over the samples in which the drive is not at its limit: torque = gain (target - position) - rate_gain
    velocity of position drives, rate_gain (command - velocity) of velocity drives.
    """
    samples = _samples(told, drive)
    if samples is None:
        return None
    keys, columns, rows = samples
    known = np.abs(rows) < SATURATED * np.abs(rows).max(initial=0.0)
    if known.sum() < LEAST:
        return None
    columns, rows = columns[known], rows[known]
    values = np.linalg.lstsq(columns, rows, rcond=None)[0]
    missed = np.mean((rows - columns @ values) ** 2)
    parts = np.sqrt(np.mean(columns**2, axis=0) / np.mean(rows**2))
    if missed > UNEXPLAINED * np.var(rows) or values[0] <= 0 or (parts * values).min() < -AGREES:
        return None
    values = np.maximum(values, 0.0)  # below 0 by chance
    return Law(*(dict(zip(keys, map(float, some), strict=True)) for some in (values, parts)))


def _samples(told: Heard, drive: Drive) -> tuple[tuple[str, ...], np.ndarray, np.ndarray] | None:
    """(keys of gains, (N, K) what each is multiplied with, (N,) torques) of the samples in which all is known.

    None where the log lacks something, or the drive is of another kind.
    """
    names = [f"{drive.joint}/{EFFORT}", drive.action, f"{drive.joint}/position", f"{drive.joint}/velocity"]
    if drive.kind not in ("position", "velocity") or any(name not in told.series for name in names):
        return None
    torque, command, position, velocity = (told.series[name] for name in names)
    time = torque.time
    # a command holds until the next one
    at = np.maximum(np.searchsorted(command.time, time, side="right") - 1, 0)
    q, v = (np.interp(time, s.time, s.values) for s in (position, velocity))
    wanted, rows = command.values[at], torque.values
    if drive.kind == "position":
        keys, columns = ("gain", "rate_gain"), np.stack([wanted - q, -v], axis=1)
    else:
        keys, columns = ("rate_gain",), (wanted - v)[:, None]
    known = np.isfinite(columns).all(axis=1) & np.isfinite(rows)
    return (keys, columns[known], rows[known]) if known.any() else None
