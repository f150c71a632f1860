"""What workers share that are forked from the process which imports this: modules, and the servo's compiled kernel."""

import torch

import dynreg.verbs.populations  # noqa: F401
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import excitation
from dynreg.sim.robot import load_robot

torch.set_num_threads(1)
_robot = load_robot("servo_pendulum")
rollout(_robot, _robot.space.nominal[None], excitation(_robot, seed=0), threads=1)
