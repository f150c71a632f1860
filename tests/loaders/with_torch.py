"""torch on the exported models: a batched forward pass from the file alone."""

import json
import sys
from pathlib import Path

import numpy as np
import torch
from safetensors import safe_open
from safetensors.torch import load_file

folder, _, out = map(Path, sys.argv[1:])
place = folder / "safetensors" / "models.safetensors"
arrays = {name: array.float() for name, array in load_file(place).items()}
with safe_open(place, framework="pt") as file:
    about = json.loads(file.metadata()["dynreg"])
print({name: tuple(array.shape) for name, array in arrays.items()})
print(
    f"{len(about['entries'])} models of {about['states']} under {about['actions']}, told {about['context']}"
)
states, actions = torch.zeros(5, 2), torch.linspace(-1, 1, 5)[:, None]
x = torch.cat([states, actions, torch.tensor(about["usual"]).float().expand(5, -1)], dim=1)
x = (x - arrays["input_mean"]) / arrays["input_std"]
for layer in range(about["layers"]):
    x = x @ arrays[f"weight{layer}"] + arrays[f"bias{layer}"][:, None]
    x = torch.relu(x) if layer < about["layers"] - 1 else x
after = states + x * arrays["delta_std"] + arrays["delta_mean"]
print(f"first prediction {after[0, 0].tolist()}")
np.savez(out, predicted=after.numpy())
