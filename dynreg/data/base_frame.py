"""Whether the velocities of a floating base are told in its own frame, as they must be, or in the world's."""

from collections.abc import Iterator

import numpy as np

from dynreg.data.episodes import RawEpisode
from dynreg.data.names import parts_of
from dynreg.data.series import Finding, Series

NEEDED = ("x", "y", "yaw", "vx", "vy")
SPAN = 0.2  # [s] over which ways and velocities are compared: noise of poses counts little
LEAST = 20  # spans below which nothing is said
HALF = 0.5  # of the error of the base's own frame: the world's fits so much better
SEEN = 0.2  # of the speed: less than that is noise, or a base that hardly turns


def check_frame(episode: RawEpisode, where: str) -> Iterator[Finding]:
    """A base whose vx and vy go along with its ways in the world, whatever its heading."""
    owners = dict.fromkeys(parts_of(name)[0] for name in episode.channels)
    for owner in owners:
        series = [episode.channels.get(f"{owner}/{quantity}") for quantity in NEEDED]
        known = [_known(one) for one in series if one is not None]
        if len(known) < len(NEEDED) or not all(map(_runs_on, known)):
            continue
        own, world, speed = _apart(*known)
        if own > SEEN * speed and world < HALF * own:
            text = (
                f"go along with the ways in the world ({world:.2g} m/s off) and not with those ahead and to the left "
                f"({own:.2g} m/s off): they are in the world's frame, as motion capture tells them"
            )
            do = "take them from a topic in the base's frame, such as Odometry, or leave both out of the map"
            yield Finding("warning", "frame", f"{where}, {owner}/vx and {owner}/vy", text, do)


def _known(series: Series) -> Series:
    """Its rows with a number; of equal stamps the last, as everywhere."""
    series = series.rows(np.isfinite(series.values) & np.isfinite(series.time))
    return series.rows(np.append(np.diff(series.time) != 0, True)) if len(series) > 1 else series


def _runs_on(series: Series) -> bool:
    return len(series) > LEAST and bool((np.diff(series.time) > 0).all())


def _apart(*known: Series) -> tuple[float, float, float]:
    """How far the base's mean velocities are off [m/s], taken in its own frame and in the world's; its speed [m/s].

    All are 0 where the channels share too little time.
    """
    begin, end = max(s.time[0] for s in known), min(s.time[-1] for s in known)
    edges = np.arange(begin, end, SPAN)
    if len(edges) <= LEAST:
        return 0.0, 0.0, 0.0
    x, y, yaw, *velocities = known
    ways = np.stack([np.diff(np.interp(edges, s.time, s.values)) for s in (x, y)], -1) / SPAN
    told = np.stack([_means(s, edges) for s in velocities], -1)
    heading = np.interp(0.5 * (edges[1:] + edges[:-1]), yaw.time, np.unwrap(yaw.values))
    cos, sin = np.cos(heading), np.sin(heading)
    turned = np.stack([cos * told[:, 0] - sin * told[:, 1], sin * told[:, 0] + cos * told[:, 1]], -1)
    own, world, speed = (float(np.sqrt(np.mean(np.square(e)))) for e in (turned - ways, told - ways, ways))
    return own, world, speed


def _means(velocity: Series, edges: np.ndarray) -> np.ndarray:
    """(N,) means of a velocity between the stamps `edges` (N + 1,)."""
    steps = 0.5 * (velocity.values[1:] + velocity.values[:-1]) * np.diff(velocity.time)
    travel = np.concatenate([[0.0], np.cumsum(steps)])
    return np.diff(np.interp(edges, velocity.time, travel)) / np.diff(edges)
