"""A plausible plan for a wheeled robot, with numbers that were made up."""

from dynreg.results import CommandLimits, Cost, Interval, Navigation, Place, Spread, TimedCommand, Way


def navigation(missed: bool = False) -> Navigation:
    """Two commands that visit one of two places, or both."""
    off = {"dx": ("cm", 0.13), "dy": ("cm", 0.15), "dtheta": ("deg", 0.7)}
    return Navigation(
        robot="diffdrive",
        recording="cd" * 32,
        recording_name="monday",
        on="dynamic",
        kind="unicycle, fitted",
        parameters={"track": 0.0884, "a1": 0.087},
        parts={"fit": 174, "validation": 40, "test": 40},
        errors={
            axis: Spread(mean=mean, min=0.0, max=3 * mean, sd=mean, unit=unit)
            for axis, (unit, mean) in off.items()
        },
        size=0.3,
        area=(0.0, -0.35, 0.65, 0.35),
        back=True,
        places=(
            Place(x=0.5, y=0.2, visited=True, drives=480),
            Place(x=0.5, y=-0.2, visited=not missed, drives=450),
        ),
        actions=("left_wheel/velocity_command", "right_wheel/velocity_command"),
        units=("rad/s", "rad/s"),
        commands=(
            TimedCommand(time=0.0, seconds=1.5, values=(9.5, 7.25)),
            TimedCommand(time=1.5, seconds=0.72, values=(-3.0, 4.0)),
        ),
        seconds=2.22,
        end=0.012,
        drives=500,
        drive_ends=Interval(value=0.023, low=0.004, high=0.061, unit="m"),
        all_visited=430,
        way=Way(x=(0.0, 0.3, 0.5, 0.2), y=(0.0, 0.1, 0.2, 0.01)),
        ways=(Way(x=(0.0, 0.31, 0.52, 0.24), y=(0.0, 0.12, 0.19, 0.03)),),
        limits=CommandLimits(
            commands=10, seconds=(0.1, 2.0), low=(-9.9, -9.8), high=(9.7, 9.9), beyond=False
        ),
        generations=2000,
        seed=0,
        notes=("this is the best plan found",) if missed else (),
        cost=Cost(evaluations=0, rollouts=400_000, test_rollouts=500, seconds=31.0),
    )
