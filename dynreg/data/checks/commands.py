"""Commands that change more often than the robot's control rate has rows for, and targets that are no angles."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from dynreg.data.checks.clock import FASTEST, coarse
from dynreg.data.checks.numbers import check_range
from dynreg.data.episodes import RawEpisode
from dynreg.data.names import joint_of
from dynreg.data.schema import RecordingSpec
from dynreg.data.series import STAMP_TOLERANCE, Finding, Series, clean

HALF = 0.51  # share of the commands that control must keep, and a little more, for stamps are not exact
MISSED = 0.02  # of a command's spread, by which those that control drops may go beyond those that it takes
TOGETHER = 10  # changes over which their rate is taken: stamps that come in bunches tell no rate one by one


def check_commands(episode: RawEpisode, spec: RecordingSpec, where: str) -> Iterator[Finding]:
    """Commands of which control at the robot's rate drops half or more. Those that a log repeats from row to row count
    once: nothing is lost where it is sampled faster than they change. Where those that are dropped lie between those
    that are taken, as of a robot drafted from a fast log, it is an info, not a warning.
    """
    if spec.rate is None:
        return
    actions = {c.name for c in spec.channels if c.kind == "action"}
    rates = {name: _changes(series) for name, series in episode.channels.items() if name in actions}
    fast = [name for name in rates if HALF * rates[name] > spec.rate]
    lost = [
        name for name in fast if rates[name] > FASTEST or _missed(episode.channels[name], spec.rate) > MISSED
    ]
    name = max(lost or fast, key=lambda n: rates[n], default="")
    if not name or coarse([episode.channels[name]]):
        return  # what is coarse is told of the clock
    rate = float(f"{rates[name]:.3g}")
    control = f"set control_rate = {rate:g} in robot.toml, with a timestep of at most {step_within(rate):g} s"
    share = f"{100 * (1 - spec.rate / rate):.0f} % of them are dropped"
    if rate > FASTEST:
        do = "no robot is told so many, so correct time_unit under [map]"
    elif lost:
        do = f"{control}, unless so many are meant to be left out"
    else:
        share, do = f"{share}, and lie between those that are taken", f"to take all, {control}"
    text = f"commands come at {rate:g} Hz, control_rate is {spec.rate:g} Hz: {share}"
    yield Finding("warning" if lost else "info", "rate", f"{where}, {name}", text, do)


def check_targets(episode: RawEpisode, spec: RecordingSpec, where: str) -> Iterator[Finding]:
    """Targets so far beyond the stops of their joint that positions there would be refused: another unit.

    What has limits of its own is checked against these.
    """
    stops = {joint_of(c.name): c.stops for c in spec.channels if c.stops is not None}
    for channel in spec.channels:
        series, ends = episode.channels.get(channel.name), stops.get(joint_of(channel.name))
        limited = channel.low is not None or channel.high is not None
        if channel.kind != "action" or channel.unit != "rad" or limited or series is None or ends is None:
            continue
        alike = replace(channel, kind="state", stops=ends)
        yield from (
            f for f in check_range(series, alike, f"{where}, {channel.name}") if f.severity == "error"
        )


def step_within(rate: float) -> float:
    """The longest time step [s] between two commands at a rate [Hz], in three digits that are not rounded up.

    >>> step_within(1000.0), step_within(700.0)
    (0.001, 0.00142)
    """
    digit = math.floor(math.log10(1.0 / rate)) - 2
    return math.floor(10.0**-digit / rate * (1.0 + 1e-9)) / 10.0**-digit


def _changes(commands: Series) -> float:
    """How often commands change while they do [Hz]; 0 where they change too seldom to tell."""
    known = commands.rows(np.isfinite(commands.values) & np.isfinite(commands.time))
    at = known.time[1:][np.diff(known.values) != 0]
    if len(at) <= 2 * TOGETHER:
        return 0.0
    step = float(np.median(at[TOGETHER:] - at[:-TOGETHER])) / TOGETHER
    return 1.0 / step if step > 0 else 0.0


def _missed(commands: Series, rate: float) -> float:
    """How far commands go beyond those around them that control at a rate [Hz] takes, in their spread."""
    known = clean(commands)
    steps = np.ceil((known.time - known.time[0] - STAMP_TOLERANCE) * rate)
    (taken,) = np.nonzero(np.diff(steps))  # the last before each control step
    if not len(taken) or np.any(np.diff(known.time) < 0):
        return np.inf  # where a clock runs back, which is told elsewhere, nobody knows what is taken
    values = known.values[: taken[-1] + 1]
    after = np.searchsorted(taken, np.arange(len(values)))
    around = known.values[[taken[np.maximum(after - 1, 0)], taken[after]]]
    beyond = np.maximum(values - around.max(axis=0), around.min(axis=0) - values)
    return float(np.sqrt(np.mean(np.maximum(beyond, 0.0) ** 2)) / np.std(known.values))
