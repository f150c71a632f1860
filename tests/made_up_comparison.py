"""A plausible comparison of models, with errors that were made up."""

from functools import cache

import numpy as np

from dynreg.results import (
    Commands,
    ComparedTrace,
    Comparison,
    Contender,
    Cost,
    DrivenPath,
    Gain,
    Horizon,
    Pace,
    Paths,
    Rollouts,
    Score,
    Way,
)
from dynreg.rng import stream
from dynreg.timed.compare import compared, spread

NAMES = ("nominal", "synthesised ab12ab12", "kinematic", "dynamic")
OFF = {"nominal": 1.1, "synthesised ab12ab12": 1.0, "kinematic": 3.0, "dynamic": 1.0}  # times the noise


@cache  # its tests are a tenth of a second, and half of all tests of the commands ask for it
def comparison(paths: bool = True) -> Comparison:
    """Two simulators and two models on 40 commands."""
    rng = stream(1, "made up comparison")
    moved = rng.normal(0.0, [0.03, 0.05, 0.8], (40, 3))
    noise = {name: rng.normal(0.0, [0.003, 0.003, 0.05], (40, 3)) for name in NAMES}
    errors = compared(moved, {name: moved + OFF[name] * noise[name] for name in NAMES})
    ends = {name: spread(np.abs(rng.normal(0.0, OFF[name], 3)), "cm") for name in NAMES}
    return Comparison(
        robot="diffdrive",
        recording="cd" * 32,
        recording_name="monday",
        seed=0,
        contenders=(
            Contender(name="nominal", kind="nominal simulator", parameters={"track": 0.0884}),
            Contender(
                name="synthesised ab12ab12",
                kind="synthesised simulator",
                simulator="ab12" * 16,
                parameters={"track": 0.09},
                effects={"command_delay": {"delay": 0.04}},
            ),
            Contender(name="kinematic", kind="closed form", parameters={"track": 0.0884}),
            Contender(name="dynamic", kind="unicycle, fitted", parameters={"a1": 0.087, "a2": 0.101}),
        ),
        rollouts=rollouts(NAMES[:2]) if paths else None,
        commands=Commands(
            parts={"fit": 174, "validation": 40, "test": 40},
            names=NAMES,
            track=0.0884,
            longest=2.0,
            starts=30,
            generations=300,
            best="dynamic",
            errors=errors,
            paths=Paths(runs=3, commands=10, models=ends) if paths else None,
            driven=tuple(_driven(begin) for begin in (20.0, 31.5)) if paths else (),
            paces=tuple(_pace(name) for name in NAMES),
        ),
        notes=() if paths else ("the test part has no ten commands in a row without a gap",),
        cost=Cost(evaluations=0, rollouts=2, seconds=31.5),
    )


def arm(names: tuple[str, ...] = ("nominal", "extended ab12ab12", "calibrated cd34cd34")) -> Comparison:
    """Simulators of an arm: the second errs least, the third ties with the first."""
    kinds = ("nominal simulator", "extended simulator", "calibrated simulator")
    contenders = (Contender(name=name, kind=kind) for name, kind in zip(names, kinds, strict=True))
    return Comparison(
        robot="arm",
        recording="ef" * 32,
        recording_name="tuesday",
        seed=0,
        contenders=tuple(contenders),
        rollouts=rollouts(names, ("shoulder/position", "elbow/position")),
        commands=None,
        cost=Cost(evaluations=0, rollouts=3, seconds=3.1),
    )


def rollouts(names: tuple[str, ...], channels: tuple[str, ...] = ("base/x", "base/y")) -> Rollouts:
    """Errors of 0.1 and 2 s: the second simulator errs by half."""
    horizons = (Horizon(seconds=0.1, rollouts=80, whole=False), Horizon(seconds=2.0, rollouts=4, whole=True))
    scores = tuple(
        _score(name, i, channel, h.seconds)
        for h in horizons
        for channel in (None, *channels)
        for i, name in enumerate(names)
    )
    time = [0.1 * i for i in range(20)]
    curve = {name: [0.9 * float(np.sin(t + 0.1 * i)) for t in time] for i, name in enumerate(names)}
    measured = [None if i == 3 else float(np.sin(t)) for i, t in enumerate(time)]
    trace = ComparedTrace(
        episode="run_1", channel=channels[0], unit="rad", time=time, measured=measured, simulators=curve
    )
    return Rollouts(
        episodes=("run_1", "run_3"),
        left_out=("run_0", "run_2[1]"),
        names=names,
        horizons=horizons,
        best=names[1],
        alike=(),
        scores=scores,
        traces=(trace,),
    )


def _score(name: str, number: int, channel: str | None, seconds: float) -> Score:
    error = (0.5 if number == 1 else 1.0) * 0.02 * (seconds + 0.5)
    return Score(
        simulator=name,
        channel=channel,
        seconds=seconds,
        error=error,
        low=0.9 * error,
        high=1.1 * error,
        unit="spread" if channel is None else "rad",
        gain=(None, Gain(value=0.5, low=0.45, high=0.55), Gain(value=0.0, low=-0.01, high=0.01))[number],
        tie=(None, False, True)[number],
    )


def _driven(begin: float) -> DrivenPath:
    angle = np.linspace(0.0, 4.0, 41)
    ways = {
        name: Way(
            x=tuple((0.1 * (1 + 0.02 * i) * np.cos(angle)).tolist()), y=tuple((0.1 * np.sin(angle)).tolist())
        )
        for i, name in enumerate(NAMES)
    }
    gap = tuple(None if i == 7 else 0.1 * float(np.cos(a)) for i, a in enumerate(angle))
    measured = Way(x=gap, y=tuple((0.1 * np.sin(angle)).tolist()))
    return DrivenPath(episode="run", begin=begin, seconds=10.4, measured=measured, models=ways)


def _pace(name: str) -> Pace:
    replayed = name in NAMES[:2]
    return Pace(
        model=name,
        one_by_one=None if replayed else 20.0,
        at_once=1500.0 if replayed else 0.3,
        one_by_one_ratio=None if replayed else 1.1,
        at_once_ratio=5000.0 if replayed else 1.0,
        fit=0.0 if replayed else 2.0,
    )
