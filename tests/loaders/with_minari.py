"""Minari on an exported folder, by its path and by its name."""

import os
import sys
from pathlib import Path

import numpy as np

folder, _, out = map(Path, sys.argv[1:])
os.environ["MINARI_DATASETS_PATH"] = str(folder)
import minari  # noqa: E402

dataset = minari.MinariDataset(folder / "servo_pendulum-v0" / "data")
by_name = minari.load_dataset("servo_pendulum-v0")
assert by_name.id == dataset.id and by_name.total_steps == dataset.total_steps
print(dataset.spec)
episodes = list(dataset.iterate_episodes())
first = episodes[0]
print(
    f"observations {first.observations.shape}, actions {first.actions.shape}, rewards {first.rewards.shape}"
)
print(f"infos { {name: values.shape for name, values in first.infos.items()} }")
print(
    f"first row {first.observations[0]} {first.actions[0]}, ended {first.terminations[-1]} {first.truncations[-1]}"
)
assert all(len(e.observations) == len(e.actions) + 1 == 51 for e in episodes)
assert all(e.truncations[-1] and not e.terminations.any() and not e.rewards.any() for e in episodes)
np.savez(
    out,
    states=np.concatenate([e.observations for e in episodes]),
    actions=np.concatenate([e.actions for e in episodes]),
)
