"""MuJoCo without its warnings: a configuration that diverges is a result here, not news."""

from collections.abc import Iterator
from contextlib import contextmanager

import mujoco


@contextmanager
def quiet() -> Iterator[None]:
    """Keep MuJoCo from writing to stderr and to a MUJOCO_LOG.TXT in the working folder; also a decorator."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda text: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)
