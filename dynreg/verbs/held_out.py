"""What a reader must know of a held-out part: motions in it that nothing was fitted to, or that it lacks."""

from dynreg.replay.outside import beyond, reached, small
from dynreg.replay.parts import Parts
from dynreg.replay.windows import Windows
from dynreg.sim.robot import Robot

SHOWN = 3  # signals


def held_out_notes(robot: Robot, windows: Windows, parts: Parts) -> tuple[str, ...]:
    """Warnings about a held-out part whose motions are of another size than those that were fitted."""
    found = reached(robot, windows, parts)
    further = beyond(found)
    if further:
        told = [
            f"{one.signal} reaches {one.held_out:.3g} {one.unit} from its middle, {one.fitted:.3g} where it was fitted"
            for one in further[:SHOWN]
        ]
        more = f", and {len(further) - SHOWN} more" if len(further) > SHOWN else ""
        return (
            f"the held-out motions go beyond what was fitted ({'; '.join(told)}{more}): the error on them tells how "
            "simulators extrapolate. Choose the held-out part with --hold-out, so that each kind of motion is in both",
        )
    if small(found):
        most = max(found, key=lambda one: one.ratio)
        return (
            f"the held-out motions are small or slow ({most.signal} reaches {most.held_out:.3g} {most.unit} from its "
            f"middle, {most.fitted:.3g} where it was fitted): the error on them says little of larger ones. Choose the "
            "held-out part with --hold-out",
        )
    return ()
