"""A diagnosis of some joints only: their channels, the candidate effects, and the parameters that they show."""

from dataclasses import replace

import numpy as np

from dynreg.data.names import joint_of
from dynreg.errors import UsageError, quoted
from dynreg.evidence.hypothesis import Coordinates
from dynreg.replay.windows import Windows
from dynreg.sim.effects import Term, Terms
from dynreg.sim.engines import rollout
from dynreg.sim.held import loose_joints
from dynreg.sim.robot import Robot

# A change below a tenth of the noise needs 100 independent rows to determine one sigma of the prior.
TRIED = 6  # windows in which a parameter is tried, spread over the recording to include each kind of motion
UNSEEN = 0.1  # of the sensor's noise: a parameter with smaller changes is not visible


def only_joints(robot: Robot, joints: tuple[str, ...]) -> Robot:
    """The robot with no weight on the channels of other joints.

    Raises UsageError if no action drives a joint, or none of the joints' channels has a weight.
    """
    driven = list(robot.driven)
    unknown = [j for j in joints if j not in driven]
    if passive := [j for j in unknown if j in passive_joints(robot)]:
        raise UsageError(
            f"joint {passive[0]!r} of robot {robot.name!r} is not driven",
            expected=f"some of {driven}: effects act at driven joints",
            do=f"leave it out; its damping and dry friction can be [[parameters]], as {damping_of(passive[0])!r}",
        )
    if unknown:
        raise UsageError(
            f"joint {unknown[0]!r} of robot {robot.name!r}",
            expected=f"some of {driven}",
            do="correct the name",
        )
    channels = [
        c if joint_of(c.name) in joints else c.model_copy(update={"weight": 0.0}) for c in robot.file.channels
    ]
    if not any(c.weight > 0 for c in channels):
        raise UsageError(
            f"no channel of {quoted(joints)} has a weight",
            expected="a channel to judge by",
            do="give one a weight in robot.toml",
        )
    return replace(robot, file=robot.file.model_copy(update={"channels": channels}))


def passive_joints(robot: Robot) -> tuple[str, ...]:
    """The hinges and slides with a channel that nothing drives or holds; none of a robot in the plane."""
    if robot.planar:
        return ()
    owners = dict.fromkeys(joint_of(name) for name in robot.channels)
    names = {robot.model.joint(j).name for j in loose_joints(robot.model)}
    return tuple(joint for joint in owners if joint in names and joint not in robot.driven)


def damping_of(joint: str) -> str:
    """The entry of `sets` for a joint's damping."""
    return f"mj.dof_damping[{joint}] ="


def terms_at(terms: list[Term], joints: tuple[str, ...]) -> list[Term]:
    """Of all single terms those at these joints: on each joint (each pair), and on all of them together.

    Effects of the whole robot are left out: a part of the joints does not identify them.
    """
    out = []
    for term in terms:
        if term.effect.scope != "joint":
            continue
        if len(joints) > 1 and not term.joints:
            out.append(Term(term.effect, joints))
        elif term.joints and {*term.joints} <= {*joints}:
            out.append(term)
    return out


def fixed_unseen(
    coordinates: Coordinates, windows: Windows, engine: str | None, begun: Terms | None
) -> np.ndarray:
    """The known parameters (P,), with those that the weighted channels do not show fixed at their centre.

    Each is tried one standard deviation up and down, as one direction may have no influence. begun : acting effects
    (one row).
    """
    robot, known = coordinates.robot, coordinates.known
    values, *moved = (coordinates.values(np.full(len(coordinates), way)) for way in (0.0, 1.0, -1.0))
    free = np.flatnonzero(np.isnan(known))
    tried = np.tile(values, (1 + len(moved) * len(free), 1))
    for way, other in enumerate(moved):
        tried[1 + way * len(free) + np.arange(len(free)), free] = other[free]
    some = np.unique(np.linspace(0, len(windows) - 1, TRIED).round().astype(int))
    use = np.flatnonzero(windows.weight > 0)
    acting = begun and begun.tiled(len(tried))
    states = rollout(robot, tried, windows.run.take(some), engine=engine, threads=1, terms=acting).states[
        ..., use
    ]
    noise = robot.sensor_noise[use]
    change = np.sqrt(np.mean((states[1:] - states[:1]) ** 2, axis=(1, 2)))  # (P', C)
    hidden = (change < UNSEEN * np.maximum(noise, 1e-12)).all(axis=1)
    unseen = free[hidden.reshape(len(moved), -1).all(axis=0)]
    out = known.copy()
    out[unseen] = values[unseen]
    return out
