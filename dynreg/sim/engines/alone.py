"""One simulation in an MjModel and MjData that a user holds, for what else advances a `mujoco.batch.Batch`."""

from typing import Any

import mujoco
import numpy as np

_WRITABLE = (
    "qpos",
    "qvel",
    "act",
    "ctrl",
    "qfrc_applied",
    "qacc_warmstart",
)  # the fields of a state that are bound


class Alone:
    """A batch of one simulation: its arrays have a leading axis of 1, and `ids` can only name that one.

    model, data : where it is. What is written into their state acts from the next call on.
    """

    nsim = 1

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData):
        self.model, self.data = model, data
        self._outputs: dict[str, np.ndarray] = {}

    def bind(self, name: str) -> np.ndarray:
        """(1, ...) a field of the data. State is a view; all else is as the last `step` or `forward` here left it.

        So nothing changes when a user calls mj_forward on the data to look at it.
        """
        if name in _WRITABLE:
            return getattr(self.data, name)[None]
        if name not in self._outputs:
            self._outputs[name] = np.array(getattr(self.data, name))[None]
        return self._outputs[name]

    def expand(self, name: str) -> np.ndarray:
        """(1, ...) view of a field of the model."""
        return getattr(self.model, name)[None]

    def step(self, ids: Any = None, nstep: int = 1) -> None:
        """Advance it by so many time steps."""
        mujoco.mj_step(self.model, self.data, nstep)
        self._put_out()

    def forward(self, ids: Any = None) -> None:
        """Compute the forces of the present state."""
        mujoco.mj_forward(self.model, self.data)
        self._put_out()

    def _put_out(self) -> None:
        for name, out in self._outputs.items():
            out[0] = getattr(self.data, name)
