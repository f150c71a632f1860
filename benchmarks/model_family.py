"""A planted family of configurations on which models are timed and judged.

Twelve coupled joints with torque limits, friction and gravity push a body along; every configuration has its own
constants.
"""

import numpy as np

from dynreg.models.normaliser import fit_normaliser
from dynreg.rng import stream

JOINTS, BODY, EPISODES, STEPS, SUBSTEPS, RATE = 12, 9, 20, 50, 8, 40.0  # RATE in Hz
TRAIN_ROWS = 800  # the first 16 episodes; the other 4 are held out


def family(configs: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Normalised inputs (configs, 1000, 55) and targets (configs, 1000, 33) of random configurations."""
    rng = stream(seed, "family")
    shape = (configs, 1, JOINTS)
    low, high = np.array([[15, 0.5, 4, 0.05, 2, 0.05], [45, 3, 20, 1.0, 9, 0.5]])[..., None, None, None]
    stiffness, damping, limit, coulomb, gravity, slip = rng.uniform(low, high, (6, configs, 1, 1))
    coupling = stream(0, "family", "coupling").normal(0, 0.15, (JOINTS, JOINTS))
    feet = stream(0, "family", "feet").normal(0, 1, (JOINTS, BODY)) / np.sqrt(JOINTS)
    bank = stream(0, "family", "actions").uniform(
        -0.8, 0.8, (EPISODES, STEPS, JOINTS)
    )  # shared, as in a registry
    offset = rng.uniform(-0.2, 0.2, shape)

    q, v = np.zeros((2, configs, EPISODES, JOINTS))
    body = np.zeros((configs, EPISODES, BODY))
    states = np.empty((configs, EPISODES, STEPS + 1, 2 * JOINTS + BODY))
    for step in range(STEPS + 1):
        states[:, :, step] = np.concatenate([q, v, body], -1)
        for _ in range(SUBSTEPS if step < STEPS else 0):
            torque = np.clip(stiffness * (bank[:, step] - q - offset) - damping * v, -limit, limit)
            force = torque - coulomb * np.tanh(20 * v) - gravity * np.sin(q) + np.sin(q) @ coupling * gravity
            v = v + force / (RATE * SUBSTEPS)
            q = q + v / (RATE * SUBSTEPS)
            body = body + (np.tanh((v @ feet) / slip) * slip - 0.5 * body) * (4 / (RATE * SUBSTEPS))
    states = states + rng.normal(0, 0.002, states.shape)
    context = np.broadcast_to(rng.normal(0, 1, (configs, EPISODES, 1, 10)), (configs, EPISODES, STEPS, 10))
    actions = np.broadcast_to(bank, (configs, *bank.shape))
    tables = [states[:, :, :-1], actions, context, states[:, :, 1:]]
    tables = [table.reshape(configs, EPISODES * STEPS, -1) for table in tables]
    normaliser = fit_normaliser(*(table[:16].reshape(-1, table.shape[-1]) for table in tables))
    return normaliser.inputs(*tables[:3]), normaliser.targets(tables[0], tables[3])
