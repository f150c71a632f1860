"""Logs written in the tests."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dynreg.data.schema import ChannelSpec, RecordingSpec


@pytest.fixture
def servo_spec() -> RecordingSpec:
    """A one-joint robot at 100 Hz."""
    channels = (
        ChannelSpec("arm/position", "rad", "state", low=-3.2, high=3.2),
        ChannelSpec("arm/velocity", "rad/s", "state"),
        ChannelSpec("arm/target", "rad", "action", low=-3.1, high=3.1),
        ChannelSpec("supply", "V", "input", optional=True),
        ChannelSpec("arm/enabled", "1", "enable", optional=True),
    )
    return RecordingSpec("servo_pendulum", channels, ("kp",), 100.0)


@pytest.fixture
def write_table(tmp_path: Path) -> Callable[..., Path]:
    """Writes columns as a CSV file."""

    def write(name: str = "log.csv", **columns: object) -> Path:
        names = {key.replace("__", "/"): np.asarray(value) for key, value in columns.items()}
        rows = zip(*(v.tolist() for v in names.values()), strict=True)
        lines = [",".join(names)] + [",".join(map(repr, row)).replace("'", "") for row in rows]
        path = tmp_path / name
        path.write_text("\n".join(lines) + "\n")
        return path

    return write


@pytest.fixture
def swing() -> dict[str, np.ndarray]:
    """Columns of a servo that swings for 4 s at 200 Hz, with its true rate, and hears 100 targets a second."""
    t = np.arange(801) / 200
    return {
        "time": t,
        "arm__position": np.sin(3 * t),
        "arm__velocity": 3 * np.cos(3 * t),
        "arm__target": np.sin(3 * (np.arange(801) // 2) / 100 + 0.2),
        "kp": np.full(len(t), 400.0),
    }
