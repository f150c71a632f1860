"""Checks of a log: clocks, gaps, numbers, units, limits."""

import json
import math
from collections.abc import Iterable, Iterator, Sequence

from dynreg.data.base_frame import check_frame
from dynreg.data.checks.clock import FASTEST, check_clocks
from dynreg.data.checks.commands import check_commands, check_targets
from dynreg.data.checks.motion import stuck, velocities
from dynreg.data.checks.numbers import check_numbers, check_range, check_spikes
from dynreg.data.episodes import RawEpisode
from dynreg.data.names import quantity_of
from dynreg.data.schema import RecordingSpec
from dynreg.data.series import Finding, Series

__all__ = ["check_clocks", "check_episode", "check_lengths", "check_numbers", "check_spikes", "errors"]

STEPS = 10  # of control, that an episode lasts at least


def check_episode(episode: RawEpisode, spec: RecordingSpec, gap: float) -> tuple[Finding, ...]:
    """Everything that is found in one episode against the channels; `gap` [s] is a silence to report.

    Where control is timed there are none: a row stands where a command begins.
    """
    where = f"{episode.file}, episode {episode.name}"
    findings = [
        Finding("error", "missing", where, f"channel {c.name!r} is missing")
        for c in spec.channels
        if c.name not in episode.channels and not c.optional
    ]
    findings += [
        Finding("warning", "missing", where, f"setting {name!r} is not known")
        for name in spec.settings
        if name not in episode.settings and name not in spec.usual
    ]
    findings += episode.findings
    specs = {c.name: c for c in spec.channels}
    shown = {name: s for name, s in episode.channels.items() if not specs[name].hold}
    silence = None if spec.rate is None else gap
    findings += check_clocks(episode.channels, where, None, counting=episode.counting)
    findings += check_clocks(shown, where, silence, only_gaps=True, counting=episode.counting)
    for name, series in episode.channels.items():
        here = f"{where}, {name}"
        findings += check_numbers(series, here, episode.dropped.get(name), optional=specs[name].optional)
        # an impact is over in a sample of a velocity; a position cannot come back so
        told = specs[name].kind in ("state", "input") and specs[name].unit not in ("rad/s", "m/s")
        findings += check_spikes(series, here, f"under [channels.{json.dumps(name)}]") if told else ()
        findings += check_range(
            series, specs[name], here, followed=spec.rate is None and quantity_of(name) == "yaw"
        )
    findings += stuck(episode, specs, where)
    findings += velocities(episode, where)
    findings += check_frame(episode, where)
    findings += _short(episode, spec, where)
    findings += check_targets(episode, spec, where)
    findings += check_commands(episode, spec, where)
    return tuple(findings)


def check_lengths(episodes: Sequence[RawEpisode], spec: RecordingSpec) -> Iterator[Finding]:
    """Episodes of a few control steps: warnings beside longer ones, errors where there are no others."""
    if spec.rate is None:
        return
    lasting = [_lasts(_states(e, spec)) for e in episodes]
    short = [duration * spec.rate < STEPS - 1e-6 for duration in lasting]
    severity, do = ("error", "record longer") if all(short) else ("warning", "")
    for e, duration in ((e, t) for e, t, few in zip(episodes, lasting, short, strict=True) if few):
        text = f"lasts {duration:.3f} s, less than {STEPS} steps at {spec.rate:g} Hz"
        yield Finding(severity, "short", f"{e.file}, episode {e.name}", text, do)


def _states(episode: RawEpisode, spec: RecordingSpec) -> list[Series]:
    """What was measured in an episode."""
    return [episode.channels[c.name] for c in spec.channels if c.name in episode.channels and not c.hold]


def _lasts(states: Sequence[Series]) -> float:
    """How long all signals are known [s]; without end where another check tells why none can say it.

    Those are a signal of fewer than two rows, and a clock in another unit: rows that come too fast for any log.
    """
    if not states or min(map(len, states)) < 2:
        return math.inf
    lasting = [float(s.time[-1] - s.time[0]) for s in states]
    fast = any(len(s) - 1 > FASTEST * time for s, time in zip(states, lasting, strict=True))
    return math.inf if fast else min(lasting)


def _short(episode: RawEpisode, spec: RecordingSpec, where: str) -> Iterator[Finding]:
    states = _states(episode, spec)
    if not states:
        return
    duration = _lasts(states)
    rows = min(len(s) for s in states)
    if rows < 2:
        yield Finding("error", "short", where, f"{rows} samples; at least 2 are needed")
    elif spec.rate is not None and rows < 0.1 * duration * spec.rate < math.inf:
        text = f"{rows / duration:.3g} samples/s for {spec.rate:g} Hz of control: is the clock in seconds?"
        yield Finding("warning", "rate", where, text, "if not, set time_unit under [map]")


def errors(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """The findings that block ingestion."""
    return tuple(f for f in findings if f.severity == "error")
