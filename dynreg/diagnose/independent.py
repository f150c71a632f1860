"""Hidden robots by other code than the model's: a robot's protocol as commands for a truth, and its log."""

import numpy as np

from dynreg.data.recording import Recording
from dynreg.errors import UsageError
from dynreg.evidence.truth import Hidden, Protocol, hide, recorded
from dynreg.rng import stream_seed
from dynreg.sim.effects import Effect, Term, applicable, placed
from dynreg.sim.robot import Robot, is_packaged
from dynreg.truths.causes import cause
from dynreg.truths.table import kind, log, sized
from dynreg.truths.truth import Commands, Truth


def require_truth(robot: Robot) -> None:
    """UsageError where no truth is of this robot: each is of one that comes with dynreg, as it comes."""
    kind(robot.name)
    if not is_packaged(robot):
        raise UsageError(
            f"robot {robot.name!r} ({robot.hash[:12]}) is not the one of that name that comes with dynreg",
            expected="that robot, unchanged: the independent truth has its joints and masses",
            do=f"name {robot.name} as it comes, or leave `truth` at 'own'",
        )


def hide_independent(robot: Robot, key: str | None, size: str | None, seed: int) -> tuple[Hidden, Truth]:
    """A robot drawn from its nameplate by a truth of its own, with a cause ("backlash", "backlash[elbow]") or none.

    Raises UsageError where the robot has no such truth, or that no such cause.
    """
    require_truth(robot)
    drawn = hide(robot, (), None, seed)
    parameters = robot.space.as_dict(drawn.parameters)
    if key is None:
        return drawn, Truth(robot.name, parameters, seed=seed)
    name, _, rest = key.partition("[")
    joints = tuple(j.strip() for j in rest.rstrip("]").split(",") if j.strip())
    values = sized(robot.name, name, size or "medium", stream_seed(seed, "values") % 2**31)
    truth = Truth(robot.name, parameters, name, values, joints, seed)
    known, able = cause(name), applicable(robot)
    answers = tuple(t for n in known.names if n in able for t in _answers(robot, able[n], joints))
    terms = answers[:1] if known.same else ()
    stated = tuple(np.array([values.get(p.name, np.nan) for p in t.effect.parameters]) for t in terms)
    hidden = Hidden(terms, stated, drawn.parameters, seed, size, name, answers)
    return hidden, truth


def _answers(robot: Robot, effect: Effect, joints: tuple[str, ...]) -> list[Term]:
    """The terms of an effect that name a cause right: at its joints; of a body's, wherever along the robot it sits.

    A cause between two joints acts on the last two.
    """
    if effect.scope == "body":
        return placed(robot, effect)
    if () not in effect.places(robot):
        return [t for t in placed(robot, effect) if t.at == tuple(robot.driven[-2:])]
    return [Term(effect, joints if effect.scope == "joint" else ())]


def independent_log(robot: Robot, truth: Truth, plan: Protocol) -> Recording:
    """What the logger of a hidden robot writes under the commands of `plan`."""
    run = plan.run
    inputs = {} if run.inputs is None else {n: run.inputs[..., i] for i, n in enumerate(robot.inputs)}
    settings = {} if run.settings is None else {n: run.settings[:, i] for i, n in enumerate(robot.settings)}
    commands = Commands(run.actions, run.period, run.begin, run.initial, inputs, settings)
    states = log(truth, commands)
    own = [sensor.channel for sensor in kind(truth.kind).sensors]
    return recorded(robot, plan, states[..., [own.index(name) for name in robot.channels]])
