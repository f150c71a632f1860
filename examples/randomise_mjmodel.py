"""Simulators drawn from what a log leaves open, in plain MuJoCo: needs mujoco and numpy, nothing of dynreg.

dynreg export monday --as ranges --to ranges.toml
dynreg export diagnosed --as robot --to robot          # the command that `made_by` in ranges.toml shows
python examples/randomise_mjmodel.py ranges.toml robot/mujoco.xml -n 20
"""

import argparse
import copy
import tomllib
from pathlib import Path

import mujoco
import numpy as np

STRETCH = {
    "linear": (lambda x: x, lambda x: x),
    "log": (np.log, np.exp),
    "inverse": (lambda x: -1.0 / x, lambda x: -1.0 / x),
}


def read(path: str | Path, without_effects: bool = False) -> dict:
    """The file of ranges; ValueError where its result says not to rely on it.

    Also where an effect is no field of the model, unless `without_effects`: its values are then not applied.
    """
    ranges = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    if not ranges["reliable"]:
        raise ValueError(f"{path}: {ranges['warning']}")
    if not ranges.get("complete_in_model", True):
        if not without_effects:
            raise ValueError(f"{path}: {ranges.get('incomplete') or ranges['model']['problem']}")
        for effect in (one["key"] for one in ranges.get("effect", ()) if one["carried_by"] == "engine"):
            sizes = [one["name"] for one in ranges["free"] if one.get("effect") == effect]
            print(f"not applied: {effect}; values drawn for it change nothing: {', '.join(sizes) or 'none'}")
    return ranges


def draw(ranges: dict, count: int, rng: np.random.Generator) -> list[dict[str, float]]:
    """`count` simulators: {name: value in its unit} of what the log leaves open."""
    free, correlations = ranges["free"], np.array(ranges["correlations"]).reshape(-1, len(ranges["free"]))
    deviation = np.array([one["deviation"] for one in free])
    normal = rng.multivariate_normal(np.zeros(len(free)), correlations, count, method="eigh")
    at = np.array([one["centre"] for one in free]) + deviation * normal
    for i, one in enumerate(free):  # what is clipped takes the others along
        beyond = np.clip(at[:, i], 0.0, 1.0) - at[:, i]
        at += beyond[:, None] * correlations[i] * deviation / one["deviation"]
    values = np.clip(at, 0.0, 1.0)
    for i, one in enumerate(free):
        if one["draw"] == "uniform":
            values[:, i] = rng.uniform(size=count)
        there, back = STRETCH[one["scale"]]
        low, high = there(np.array(one["limits"]))
        values[:, i] = back(low + values[:, i] * (high - low))
    names = [one["name"] for one in free]
    return [dict(zip(names, row.tolist(), strict=True)) for row in values]


def apply(model: mujoco.MjModel, ranges: dict, values: dict[str, float]) -> mujoco.MjModel:
    """A copy of the exported model with one draw in its fields."""
    model = copy.copy(model)
    for one in ranges.get("assignment", ()):
        product = np.prod([values[name] ** power for name, power in one["powers"].items()])
        owner, _, field = one["target"].rpartition(".")  # "opt.gravity" is a field of model.opt
        array = getattr(model.opt if owner else model, field)
        for index, factor in zip(one["indices"], one["factors"], strict=True):
            kept = array[tuple(index)] if one["operation"] == "+=" else 0.0
            array[tuple(index)] = kept + factor * product
    if any(one["target"] == "geom_size" for one in ranges.get("assignment", ())):
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_MIDPHASE  # its boxes are of the old sizes
    mujoco.mj_setConst(model, mujoco.MjData(model))  # what follows from masses and positions
    return model


def main(arguments: list[str] | None = None) -> None:
    """Draw simulators, and step each for a second."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("ranges", type=Path)
    parser.add_argument("model", type=Path, help="the mujoco.xml of `dynreg export --as robot`")
    parser.add_argument("-n", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--without-effects", action="store_true", help="although the model lacks an effect")
    asked = parser.parse_args(arguments)
    ranges, model = read(asked.ranges, asked.without_effects), mujoco.MjModel.from_xml_path(str(asked.model))
    for one in ranges.get("outside", ()):
        print(f"not in the model, apply it yourself: {one['target']} ({', '.join(one['powers'])})")
    for number, values in enumerate(draw(ranges, asked.n, np.random.default_rng(asked.seed))):
        drawn = apply(model, ranges, values)
        data = mujoco.MjData(drawn)
        mujoco.mj_step(drawn, data, nstep=round(1.0 / drawn.opt.timestep))
        told = ", ".join(f"{name} = {value:.4g}" for name, value in values.items())
        print(f"{number}: {told}; after 1 s qpos = {np.round(data.qpos, 4)}")


if __name__ == "__main__":
    main()
