"""Trials of a leg of three joints, in the air and on the ground: its commands, and the effects that its robots hide."""

from dataclasses import replace

import numpy as np
from naming import TUNE

from dynreg.evidence.hypothesis import single_terms
from dynreg.evidence.truth import Protocol, protocol
from dynreg.rng import stream, stream_seed
from dynreg.sim.robot import Robot

HEIGHTS = {"air": 0.5, "ground": 0.2}  # m of the rail's lower stop
SIZES = ("medium", "strong")
KINDS = ["levels", "chirp", "triangle"]
REACH = {"air": 1.0, "ground": 1.0}  # of the robot's own excitation


def plan_of(robot: Robot, where: str) -> Protocol:
    """The commands of all trials in the air or on the ground: large motions, the drives always on."""
    table = robot.file.excitation.model_copy(update={"kinds": KINDS})
    lively = replace(robot, file=robot.file.model_copy(update={"excitation": table}))
    plan = protocol(lively, seed=TUNE, seconds=15.0, episode=2.0, reach=REACH[where])
    return replace(plan, run=replace(plan.run, settings=np.full_like(plan.run.settings, HEIGHTS[where])))


def drawn(robot: Robot, where: str, many: int, seed: int) -> list[tuple[str, str, int]]:
    """(effect and joint, size, seed of the robot) of the trials; nothing that needs the ground in the air."""
    terms = [t for t in single_terms(robot) if where == "ground" or t.effect.acts_on != "contact"]
    effects = list(dict.fromkeys(t.effect.id for t in terms))
    rng, order, out = stream(seed, "leg", where), [], []
    for i in range(many):
        if not order:
            order = list(rng.permutation(effects))  # every effect once before any comes again
        own = [t.key for t in terms if t.effect.id == order[-1]]
        order.pop()
        key = str(rng.choice(own[1:] or own))  # the first sits in all joints
        out.append((key, SIZES[i % 2], stream_seed(seed, "leg", where, i) % 2**31))
    return out
