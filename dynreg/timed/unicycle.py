"""The dynamic model: a unicycle whose speed and yaw rate follow their commands with a lag. Runge and Kutta's rule.

a1 v' = v_command - a4 v + a3 w^2 and a2 w' = w_command - a6 w - a5 v w (De La Cruz and Carelli; Laut), for the middle
of the axle.
"""

import numpy as np

from dynreg.timed.commands import Commands

STEP = 0.01  # s
NAMES = ("a1", "a2", "a3", "a4", "a5", "a6")
KHEPERA = np.array([0.087, 0.101, 1.17e-8, 0.989, 6.00e-6, 0.989])  # Pretorius et al., Table II
LAUT = np.array([0.0228, 0.0568, -0.0001, 1.0030, 0.0732, 0.9981])  # a Khepera III, Laut
PIONEER = np.array(
    [0.2604, 0.2509, -0.000499, 0.9965, 0.00263, 1.0768]
)  # Pioneer 3DX with a laser, the same source


def unicycle(commands: Commands, parameters: np.ndarray, track: float, *, step: float = STEP) -> np.ndarray:
    """(..., n, 3) displacements of commands (n,) with six parameters (..., 6), the wheels `track` [m] apart.

    A command begins with the speeds that the one before told. Its time is cut into equal steps of at most `step` [s].
    Where steps are too long for a lag the numbers grow without bounds: inf or NaN, which no search takes for good.
    """
    shape = parameters.shape[:-1]
    a = np.moveaxis(parameters.reshape(-1, 6), -1, 0)[:, :, None]  # (6, B, 1)
    count = np.maximum(np.ceil(commands.seconds / step - 1e-9).astype(int), 1)
    order = np.argsort(-count, kind="stable")  # those that still move are the first ones
    ranked = commands.take(order)
    steps, h = count[order], ranked.seconds / count[order]
    told, state = _begun(ranked, track, a.shape[1])
    with np.errstate(over="ignore", invalid="ignore"):
        for number in range(int(steps[0]) if len(steps) else 0):
            moving = int(np.searchsorted(-steps, -number, side="left"))
            state[..., :moving] = _stepped(state[..., :moving], told[:, None, :moving], a, h[:moving])
    out = np.empty((a.shape[1], len(commands), 3))
    out[:, order] = _displacement(state)
    return out.reshape(*shape, len(commands), 3)


def unicycle_along(
    commands: Commands, parameters: np.ndarray, track: float, every: float, *, step: float = STEP
) -> np.ndarray:
    """(n, S, 3) displacements of commands (n,) after `every` [s], twice that, ... and at the end of each; NaN after.

    parameters (6,). The time between two points is cut into equal steps of at most `step` [s].
    """
    a = parameters[:, None, None]
    parts = max(int(np.ceil(every / step - 1e-9)), 1)
    points = np.maximum(np.ceil(commands.seconds / every - 1e-9).astype(int), 1)
    order = np.argsort(-points, kind="stable")
    ranked, ahead = commands.take(order), points[order]
    last = (ranked.seconds - (ahead - 1) * every) / parts  # the step of the last part, which is shorter
    told, state = _begun(ranked, track, 1)
    out = np.full((len(commands), int(ahead[0]) if len(ahead) else 0, 3), np.nan)
    with np.errstate(over="ignore", invalid="ignore"):
        for number in range(out.shape[1]):
            moving = int(np.searchsorted(-ahead, -number, side="left"))
            h = np.where(ahead[:moving] == number + 1, last[:moving], every / parts)
            for _ in range(parts):
                state[..., :moving] = _stepped(state[..., :moving], told[:, None, :moving], a, h)
            out[order[:moving], number] = _displacement(state[..., :moving])[0]
    return out


def _begun(commands: Commands, track: float, many: int) -> tuple[np.ndarray, np.ndarray]:
    """What commands ask, (2, n) speed and yaw rate, and the states (5, many, n) that they begin with."""
    told = np.stack([0.5 * (commands.left + commands.right), (commands.right - commands.left) / track])
    state = np.zeros((5, many, len(commands)))  # v, w, ahead, left, heading
    state[0] = 0.5 * (commands.left_before + commands.right_before)
    state[1] = (commands.right_before - commands.left_before) / track
    return told, state


def _displacement(state: np.ndarray) -> np.ndarray:
    return np.stack([-state[3], state[2], state[4]], axis=-1)


def _stepped(state: np.ndarray, told: np.ndarray, a: np.ndarray, h: np.ndarray) -> np.ndarray:
    first = _rate(state, told, a)
    second = _rate(state + 0.5 * h * first, told, a)
    third = _rate(state + 0.5 * h * second, told, a)
    fourth = _rate(state + h * third, told, a)
    return state + h / 6.0 * (first + 2.0 * (second + third) + fourth)


def _rate(state: np.ndarray, told: np.ndarray, a: np.ndarray) -> np.ndarray:
    v, w, heading = state[0], state[1], state[4]
    out = np.empty_like(state)
    out[0] = (told[0] - a[3] * v + a[2] * w * w) / a[0]
    out[1] = (told[1] - a[5] * w - a[4] * v * w) / a[1]
    out[2] = v * np.cos(heading)
    out[3] = v * np.sin(heading)
    out[4] = w
    return out
