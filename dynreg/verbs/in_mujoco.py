"""What a simulator that was fitted joint by joint does in MuJoCo, for which its robot folder is written."""

from typing import TYPE_CHECKING

import numpy as np

from dynreg.replay.judged import channel_errors
from dynreg.sim.config import terms_of
from dynreg.sim.engines import rollout
from dynreg.verbs.shaped import fitted_on
from dynreg.verbs.simulator import Simulator
from dynreg.verbs.subjects import Recorded
from dynreg.verbs.unseen import held_out

if TYPE_CHECKING:
    from dynreg.registry import Registry

ALONE, TOGETHER = "joint", "mujoco"


def in_mujoco(registry: "Registry", found: Simulator) -> str:
    """In which engine the simulator was fitted, and its error on the held-out part there and in MuJoCo.

    "" of one that was not fitted in the joint engine, or whose robot has no other. Without the error where the held-out
    part cannot be cut again.
    """
    one, document = fitted_on(registry, found)
    if document is None or document.get("engine") != ALONE or TOGETHER not in one.robot.engines:
        return ""
    said = "It was fitted in the joint engine, which moves each joint alone and lets a joint stick"
    errors = _errors(registry, one, document)
    if errors is None:
        return f"{said}: in MuJoCo it may err otherwise."
    channel, unit, alone, together = errors
    return f"{said}: its held-out error of {channel} is {alone:.3g} {unit} there, and {together:.3g} {unit} in MuJoCo."


def _errors(registry: "Registry", one: Simulator, document: dict) -> tuple[str, str, float, float] | None:
    """Channel that its result judged it by, unit, and mean absolute errors on the held-out windows in both engines."""
    recording = registry.recording(one.lineage["recording"])
    windows = held_out(Recorded(registry, one.robot, recording, recording.id[:12]), one)
    if windows is None or not len(windows):
        return None
    values, terms = one.robot.space.from_dict(dict(one.config.values))[None], terms_of(one.config, one.robot)
    column = one.robot.channels.index(document["error"]["channel"])
    every = np.arange(len(windows))
    told = []
    for engine in (ALONE, TOGETHER):
        states = rollout(one.robot, values, windows.run, engine=engine, terms=terms).states
        told.append(float(channel_errors(windows, states, every)[0, column]))
    return one.robot.channels[column], one.robot.file.channels[column].unit, *told
