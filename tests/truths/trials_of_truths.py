"""Commands for hidden robots, and what the library's simulators do under the same."""

from functools import cache

import numpy as np

from dynreg.evidence.truth import Protocol, protocol
from dynreg.sim.effects import Terms, term
from dynreg.sim.engines import rollout
from dynreg.sim.real import finer
from dynreg.sim.robot import Robot, load_robot
from dynreg.truths.table import log
from dynreg.truths.truth import Commands, Truth


@cache
def plan_of(name: str, episodes: int) -> tuple[Robot, Protocol]:
    robot = load_robot(name)
    plan = protocol(robot, seed=3)
    return robot, Protocol(plan.run.take(np.arange(episodes)), plan.names[:episodes])


def commands_of(name: str, episodes: int = 4) -> Commands:
    robot, plan = plan_of(name, episodes)
    run = plan.run
    inputs = {n: run.inputs[..., i] for i, n in enumerate(robot.inputs)}
    settings = {n: run.settings[:, i] for i, n in enumerate(robot.settings)}
    return Commands(run.actions, run.period, run.begin, run.initial, inputs, settings)


def told(
    name: str, cause: str | None = None, values: dict | None = None, episodes: int = 4, **more
) -> np.ndarray:
    """(E, T+1, S) of the nominal robot by the truth's code, without noise."""
    robot = load_robot(name)
    truth = Truth(name, robot.space.as_dict(robot.space.nominal), cause, values or {}, exact=True, **more)
    return log(truth, commands_of(name, episodes))


def simulated(name: str, key: str | None = None, values: dict | None = None, episodes: int = 4) -> np.ndarray:
    """The same by the library's, with a time step ten times finer than the model's."""
    robot, plan = plan_of(name, episodes)
    terms = None
    if key is not None:
        hidden = term(key)
        terms = Terms((hidden,), (np.array([[values[p.name] for p in hidden.effect.parameters]]),))
    return rollout(finer(robot), robot.space.nominal[None], plan.run, terms=terms, threads=1).states[0]


@cache
def plain(name: str) -> tuple[np.ndarray, np.ndarray]:
    """What both say where nothing is hidden: `told` and `simulated`."""
    return told(name), simulated(name)


def places(name: str) -> np.ndarray:
    """(S,) whether a channel is an angle or a place, not a speed."""
    return np.array([not channel.endswith("velocity") for channel in load_robot(name).channels])
