"""Channels of one joint against each other: a position that is stuck, a velocity that is not its rate."""

from collections.abc import Iterator, Mapping

import numpy as np

from dynreg.data.checks.runs import longest_run
from dynreg.data.episodes import RawEpisode
from dynreg.data.names import joint_of, quantity_of
from dynreg.data.outliers import spikes
from dynreg.data.schema import ChannelSpec
from dynreg.data.series import Finding, Series

STUCK_SHARE, STUCK_SECONDS = 0.2, 1.0
IN_VAIN = 3.0  # times what moved the joint elsewhere: neither friction nor a load holds it then
STUCK_WAY = 0.1  # way of the velocity, as a share of how far the position goes in all
AGREEMENT = (0.7, 1.4)  # slope of a velocity channel on the derivative of its position
THOUSANDTHS = "thousandths"
MISTAKES: Mapping[str, float] = {
    "deg": 180 / np.pi,
    "rpm": 60 / (2 * np.pi),
    "turns": 1 / (2 * np.pi),
    THOUSANDTHS: 1000.0,
}


def stuck(episode: RawEpisode, specs: Mapping[str, ChannelSpec], where: str) -> Iterator[Finding]:
    """States that keep one value while their joint is seen to move, or while its command pushes in vain.

    A servo that has settled, or is held by friction or by its load, keeps one value too.
    """
    for name, series in episode.channels.items():
        if specs[name].kind != "state" or len(series) < 3 or _position_of(name) in episode.channels:
            continue
        now, before = series.values[1:], series.values[:-1]
        start, run = longest_run((now == before) & np.isfinite(now))
        begin, end = series.time[start], series.time[start + run]
        if end - begin < max(STUCK_SECONDS, STUCK_SHARE * (series.time[-1] - series.time[0])):
            continue
        if _travels(name, series, episode, begin, end):
            why = "while its velocity says that it moves"
        elif any(_pushed(series, episode.channels[a], begin, end) for a in _commands(name, episode, specs)):
            why = "though its command pushes: the sensor is stuck, or the joint is"
        else:
            continue
        text = f"stays at {series.values[start]:.6g} from {begin:.3f} to {end:.3f} s {why}"
        yield Finding("warning", "stuck", f"{where}, {name}, row {start}", text)


def _commands(name: str, episode: RawEpisode, specs: Mapping[str, ChannelSpec]) -> list[str]:
    """The commands of the channel's joint; none where the drive is off at times."""
    enables = [n for n in episode.channels if specs[n].kind == "enable" and joint_of(n) == joint_of(name)]
    if any((episode.channels[n].values == 0).any() for n in enables):
        return []
    actions = [n for n in episode.channels if specs[n].kind == "action"]
    return [n for n in actions if joint_of(n) == joint_of(name)]


def _travels(name: str, position: Series, episode: RawEpisode, begin: float, end: float) -> bool:
    """Whether the joint's own velocity channel goes a way, from `begin` to `end` [s], that cannot stay unseen."""
    velocity = episode.channels.get(f"{joint_of(name)}/velocity")
    if velocity is None or quantity_of(name) != "position":
        return False
    inside = (velocity.time >= begin) & (velocity.time <= end) & np.isfinite(velocity.values)
    way = np.cumsum(velocity.values[inside][1:] * np.diff(velocity.time[inside]))
    straight = (
        np.ptp(way - np.linspace(0.0, way[-1], len(way))) if len(way) > 1 else 0.0
    )  # a bias is no motion
    return bool(straight > STUCK_WAY * np.nanmax(np.abs(position.values - np.nanmedian(position.values))))


def _pushed(position: Series, command: Series, begin: float, end: float) -> bool:
    """Whether a command pushed in vain: both ways by more than usually moves the joint, or far more than ever did.

    What pushes a servo is how far its command is from what is measured; elsewhere the command itself.
    """
    told = np.interp(position.time, command.time, command.values)
    same = position.unit == command.unit
    push = told - position.values if same else told
    inside = (position.time >= begin) & (position.time <= end)
    moved = np.append(np.diff(position.values) != 0, False) & ~inside & np.isfinite(push)
    held = push[inside & np.isfinite(push)]
    if not moved.any() or not len(held):
        return False
    enough = max(float(np.median(np.abs(push[moved]))), 0.1 * float(np.nanmax(np.abs(push))))
    most = IN_VAIN * float(np.quantile(np.abs(push[moved]), 0.99))
    return bool((held.min() < -enough and held.max() > enough) or (same and np.abs(held).max() > most))


def _position_of(name: str) -> str:
    """ "arm/position" for "arm/velocity", "" for other names."""
    return name.removesuffix("velocity") + "position" if quantity_of(name) == "velocity" else ""


def velocities(episode: RawEpisode, where: str) -> Iterator[Finding]:
    """A logged velocity that is not the rate of its position."""
    for name, velocity in episode.channels.items():
        position = episode.channels.get(_position_of(name))
        if position is None or velocity.error is not None:
            continue
        slope = velocity_slope(position, velocity)
        if slope is None or AGREEMENT[0] <= slope <= AGREEMENT[1]:
            continue
        unit = next((u for u, k in MISTAKES.items() for f in (k, 1 / k) if 0.85 < slope / f < 1.15), None)
        text = f"is {slope:.3g} times the rate of its position"
        do = "set `unit`" if unit else "check its sign and unit"
        if unit == THOUSANDTHS:
            unit, do = (
                f"{unit}, or the clock is",
                'set time_unit = "ms" under [map], or `scale` of that channel',
            )
        text += f": one of the two is in {unit}" if unit else ""
        yield Finding("error" if unit else "warning", "units", f"{where}, {name}", text, do)


def velocity_slope(position: Series, velocity: Series) -> float | None:
    """Slope of a velocity signal on the rate of its position, both as mean values over 20 samples.

    The means of the rate are differences of position, so encoder steps hardly matter; single-sample spikes of both
    are left out. None where either hardly moves, or the two do not correlate (r < 0.8), so that nothing can be said.
    """
    rows, good = (_plain(series.values) for series in (position, velocity))
    time, values = position.time[rows], position.values[rows]
    if len(time) < 200 or good.sum() < 200 or np.any(np.diff(time) < 0) or np.any(np.diff(velocity.time) < 0):
        return None
    edges = time[:: max(len(time) // max(len(time) // 20, 1), 1)]
    spans = np.diff(edges)
    rate = np.diff(np.interp(edges, time, values))
    stamps, speeds = velocity.time[good], velocity.values[good]
    travel = np.concatenate([[0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * np.diff(stamps))])
    mean = np.diff(np.interp(edges, stamps, travel))
    keep = spans > 0
    rate, mean = rate[keep] / spans[keep], mean[keep] / spans[keep]
    if np.std(rate) == 0 or np.std(mean) == 0 or abs(np.corrcoef(rate, mean)[0, 1]) < 0.8:
        return None
    return float(np.dot(rate, mean) / np.dot(rate, rate))


def _plain(values: np.ndarray) -> np.ndarray:
    """(T,) whether a value is a number and no single-sample spike."""
    good = np.isfinite(values)
    good[spikes(values)] = False
    return good
