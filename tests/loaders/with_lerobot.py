"""LeRobot on an exported folder, with and without neighbours in time."""

import sys
from pathlib import Path

import numpy as np
import torch

try:
    import torchvision  # noqa: F401
except (
    RuntimeError
):  # one that was built for CUDA lacks its operators beside a torch for the CPU; none is used here
    operators = torch.library.Library("torchvision", "DEF")
    for name in ("nms", "qnms"):
        operators.define(f"{name}(Tensor boxes, Tensor scores, float iou_threshold) -> Tensor")
from lerobot.datasets.lerobot_dataset import LeRobotDataset

folder, _, out = map(Path, sys.argv[1:])
place = folder / "lerobot"
dataset = LeRobotDataset("dynreg/servo_pendulum", root=place)
print(dataset)
print(
    f"fps {dataset.fps}, {dataset.num_episodes} episodes, {dataset.num_frames} frames, first row {dataset[0]}"
)
rows = dataset.hf_dataset.with_format("numpy")
pairs = LeRobotDataset("dynreg/servo_pendulum", root=place, delta_timestamps={"observation.state": [0, 0.01]})
batch = next(iter(torch.utils.data.DataLoader(pairs, batch_size=32)))
print({name: tuple(v.shape) for name, v in batch.items() if isinstance(v, torch.Tensor)})
assert batch["observation.state"].shape == (32, 2, 2) and pairs[50]["observation.state_is_pad"].tolist() == [
    False,
    True,
]
some = LeRobotDataset("dynreg/servo_pendulum", root=place, episodes=[3, 7])
assert some.num_frames == 102 and np.isfinite(dataset.meta.stats["observation.state"]["std"]).all()
frames = np.array(rows["frame_index"])
np.savez(out, states=np.array(rows["observation.state"]), actions=np.array(rows["action"])[frames < 50, None])
