"""The engines and what each can do, one row each; the modules load when a robot first runs on them."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True)
class Engine:
    """One engine that robot.toml may name.

    module : has the `simulate` that `dynreg.sim.engines.rollouts` calls.
    planar : moves a base on a plane; it has neither forces nor contacts.
    contacts : bodies touch the ground and each other; robots walk, stand and fall.
    vectorised : advances all simulators at once, in numpy or compiled; a thousand draws take a second.
    finer : times finer time steps tell what that of the model gets wrong; 1 where none are needed.
    order : of the integrator's error in the time step. That of the first order leads a search astray.
    """

    module: str
    planar: bool = False
    contacts: bool = False
    vectorised: bool = False
    finer: int = 1
    order: int = 2


_HOME = "dynreg.sim.engines"
ENGINES: Mapping[str, Engine] = MappingProxyType(
    {
        "mujoco": Engine(f"{_HOME}.mujoco_engine", contacts=True, finer=8, order=1),
        "joint": Engine(f"{_HOME}.joint_engine", vectorised=True, finer=4),
        # on diffdrive the step costs a lagging command 0.8 mrad of the wheels, more than their encoders' noise
        "kinematic": Engine(f"{_HOME}.kinematic_engine", planar=True, vectorised=True, finer=8),
        "unicycle": Engine(f"{_HOME}.unicycle_engine", planar=True, vectorised=True, finer=8),
    }
)


def engines_with(trait: str) -> list[str]:
    """Names of the engines that have a trait, such as "contacts"."""
    return [name for name, engine in ENGINES.items() if getattr(engine, trait)]
