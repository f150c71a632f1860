"""A plausible gait document."""

import math

from dynreg.results import (
    Cost,
    Fitness,
    Gait,
    GaitGene,
    GaitJoint,
    GaitRound,
    GaitRounds,
    GaitStep,
    GaitTable,
    GaitTrial,
)

TORQUES = (1.31, 1.44, 1.58)


def gait(fell: bool = False) -> Gait:
    """Three neighbours; in the last one it falls, or not."""
    trials = tuple(_trial(i, torque, fell and i == 2) for i, torque in enumerate(TORQUES))
    least = min(t.fitness for t in trials)
    return Gait(
        robot="quadruped",
        robot_hash="ab" * 32,
        recording="cd" * 32,
        recording_name="yard_monday",
        on="neighbours",
        k=3,
        source="ef" * 32,
        task="forward",
        unit="m",
        success=0.3,
        seconds=10.0,
        rate=36.0,
        ramp=1.0,
        kind="sines",
        genes={
            "frequency": GaitGene(value=1.5, low=0.5, high=2.5, unit="Hz"),
            "amplitude_shoulder": GaitGene(value=0.1, low=0.0, high=0.6, unit="rad"),
            "phase_fr": GaitGene(value=3.1, low=-math.pi, high=math.pi, unit="rad"),
        },
        joints=tuple(
            GaitJoint(
                action=f"{leg}_shoulder/target",
                rest=0.75,
                low=-1.527,
                high=None,
                speed=6.5,
            )
            for leg in ("fl", "fr")
        ),
        table=GaitTable(
            period=1 / 1.5,
            times=[k / 48 for k in range(33)],
            targets=[[0.4 + 0.1 * math.sin(2 * math.pi * k / 32 + p) for p in (0.0, 3.1)] for k in range(33)],
        ),
        accept="min",
        value=least,
        fitness=Fitness(min=least, mean=sum(t.fitness for t in trials) / 3, quantile=trials[1].fitness),
        succeeded=not fell,
        trials=trials,
        method="cma",
        seed=0,
        ended="budget",
        history=(GaitStep(evaluations=3, value=0.0), GaitStep(evaluations=120, value=least)),
        evaluations=242,
        resumed=11,
        cost=Cost(evaluations=0, rollouts=729, seconds=31.5),
    )


def _trial(i: int, torque: float, fell: bool) -> GaitTrial:
    time = [0.1 * t for t in range(100)]
    return GaitTrial(
        simulator=f"{i}" * 64,
        kind="neighbour",
        fitness=0.0 if fell else 0.9 + 0.1 * i,
        fell=fell,
        parameters={"torque": torque},
        time=time,
        x=[0.1 * t for t in time],
        y=[0.01 * math.sin(t) for t in time],
        yaw=[0.02 * t for t in time],
        contacts={"fl_foot": [(0.0, 1.5), (1.8, 2.1)], "fr_foot": [(1.4, 1.9)], "rl_foot": []},
    )


def rounds(fell: tuple[bool, ...] = (True, False, False)) -> GaitRounds:
    """Trials of gaits on a robot, each better than the one before where it does not fall."""
    made = tuple(
        GaitRound(
            gait=f"{i}a" * 32,
            simulators=("ef" * 32,),
            told_by="cd" * 32,
            fits=i != 1,
            median=1.5,
            p5=0.8,
            p95=2.0,
            recording=f"{i}b" * 32,
            name=f"yard_monday trial {i + 1}",
            packaged=3 if i == 2 else None,
            fitness=0.0 if down else 0.5 + i,
            fell=down,
            again=0.25 + i,
        )
        for i, down in enumerate(fell)
    )
    stood = [i + 1 for i, down in enumerate(fell) if not down]
    return GaitRounds(
        robot="quadruped",
        recording="cd" * 32,
        recording_name="yard_monday",
        task="forward",
        unit="m",
        rounds=made,
        best=stood[-1] if stood else None,
        seconds=24.5,
        ended="the budget of trials",
    )
