"""The angles of a robot's channels, computed from a logged quaternion."""

from collections.abc import Sequence

import numpy as np

from dynreg.data.series import Series
from dynreg.errors import MapError

ANGLES = ("roll", "pitch", "yaw")
LEAST = 0.1  # length of a quaternion below which it tells no direction: many drivers send zeros before the first fix


def euler(parts: Sequence[Series], angle: str, channel: str) -> Series:
    """One Euler angle [rad] of a quaternion given as its series w, x, y, z.

    angle : "roll", "pitch" or "yaw", of turns about z, then y, then x, as robots' channels have them; roll and yaw lie
    within half a turn. Quaternions of any length above `LEAST` count, shorter ones are NaN.
    Raises MapError where the four are not on the same stamps; `channel` is what the error calls the angle.
    """
    time = parts[0].time
    if not all(np.array_equal(part.time, time, equal_nan=True) for part in parts):
        raise MapError(
            f"channel {channel!r}: the four parts of its quaternion have {[len(p) for p in parts]} samples "
            "that are not on the same stamps",
            expected="w, x, y and z of one message, or of one table",
            do="correct `source` in the map",
        )
    q = np.stack([part.values for part in parts])
    length = np.linalg.norm(q, axis=0)
    angles = euler_angles(*(q / np.where(length > LEAST, length, np.nan)))
    return Series(time, angles[ANGLES.index(angle)], "rad")


def euler_angles(w: np.ndarray, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, ...]:
    """Roll, pitch and yaw [rad] of unit quaternions: turns about z, then y, then x."""
    return (
        np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
        np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0)),
        np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
    )
