"""Accuracy: what a model's own time step does to its rollouts, and how derivatives are taken of these."""

from dataclasses import dataclass, replace

from dynreg.sim.engine import ENGINES
from dynreg.sim.robot import Robot

# Where contacts make rollouts rough the numbers are those of the search that named 105 of 120 legs on the ground; of
# bases on their feet, 37 of 50 quadrupeds (bench_naming_leg, bench_naming_quadruped).
# Half and twice of STEP name the same, with 2778 and 2735 nats for 2646 (bench_constants).
STEP = 0.07  # half the width of central differences, in fit coordinates of effects
# Of nominal coordinates, in standard deviations of the nameplate. Over STEP some of them change less than where dry
# friction lets go by chance, and what such a derivative seems to tell holds them where they are. On 29 servos of
# bench_intervals' development 90 % intervals of nominal parameters held 0.73 with STEP and 0.90 with this.
NAMEPLATE = 0.5
ROUGH = 1.0  # where feet stick and slip: the rollouts are rough on a smaller scale
SEGMENT = 0.6  # s of a rollout of a robot on its feet that share a variance
STANDING, SLOPING = 4, 2  # times finer steps of a base on its feet, whose slips finer ones tell no better


@dataclass(frozen=True)
class Accuracy:
    """Plain, corrected by a finer time step, or fine; chosen once for a problem.

    finer : the robot's own time step over the finer one that tells what its own gets wrong; 1 where that is nothing
        (plain).
    fine : whether what counts in the end is simulated with the finer one (contacts follow no order, and nothing can be
        extrapolated); else what it changes at a near point is taken off (corrected).
    order : of the error. What is of the first order leads a search astray, and is taken off from the calibration on;
        what is of the second costs delays and speed limits the last of their precision: it is taken off at the end.
    slopes : the robot's own time step over that of the derivatives of fine rollouts. A floating base with many
        parameters (`Model.dear`) is searched with it throughout, and nothing is taken off.
    width, nominal : of the differences that derivatives are taken by, in fit coordinates of effects, in nominal ones.
    sides : 1 for central differences; 2 for differences to one side, to the other in every second iteration.
    segment : [s] of a rollout that share a variance; None for all of it.
    """

    finer: float = 1.0
    fine: bool = False
    order: int = 2
    slopes: float = 1.0
    width: float = STEP
    nominal: float = NAMEPLATE
    sides: int = 1
    segment: float | None = None


PLAIN = Accuracy()


def usual(robot: Robot, engine: str | None = None) -> Accuracy:
    """The accuracy of a robot's rollouts on an engine, before it is known whether contacts make them rough.

    A floating base stands on its feet: a foot that slips sets it on another course, and what happens after says little
    of the simulator. It must not drown what happened before: each segment counts with a variance of its own. Slips bend
    its rollouts more than differences to one side are biased, and these take half the time.
    """
    if robot.floating:
        own = {"width": ROUGH, "nominal": ROUGH, "sides": 2, "segment": SEGMENT}
        return Accuracy(STANDING, fine=True, order=1, slopes=SLOPING, **own)
    traits = ENGINES[robot.running(engine)]
    return Accuracy(traits.finer, order=traits.order)


def rough(robot: Robot, engine: str | None = None) -> Accuracy:
    """The accuracy where contacts come and go, so that narrow differences of rollouts tell nothing."""
    first = usual(robot, engine)
    return replace(first, fine=True, slopes=first.finer, width=ROUGH, nominal=ROUGH)
