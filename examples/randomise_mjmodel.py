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

FORMAT = "dynreg/ranges/1"
OBJECTS = {
    "body": mujoco.mjtObj.mjOBJ_BODY,
    "geom": mujoco.mjtObj.mjOBJ_GEOM,
    "jnt": mujoco.mjtObj.mjOBJ_JOINT,
    "actuator": mujoco.mjtObj.mjOBJ_ACTUATOR,
    "site": mujoco.mjtObj.mjOBJ_SITE,
    "tendon": mujoco.mjtObj.mjOBJ_TENDON,
    "sensor": mujoco.mjtObj.mjOBJ_SENSOR,
}
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
    if ranges.get("format") != FORMAT:
        raise ValueError(f"{path}: this is no file of `dynreg export --as ranges`")
    if not ranges["reliable"]:
        raise ValueError(f"{path}: {ranges['warning']}")
    if ranges.get("warning"):
        print(f"warning: {ranges['warning']}")
    if not ranges.get("complete_in_model", True):
        if not without_effects:
            raise ValueError(f"{path}: {ranges.get('incomplete') or ranges['model']['problem']}")
        for effect in (one["key"] for one in ranges.get("effect", ()) if one["carried_by"] == "engine"):
            sizes = [one["name"] for one in ranges["free"] if one.get("effect") == effect]
            print(f"not applied: {effect}; values drawn for it change nothing: {', '.join(sizes) or 'none'}")
    return ranges


def check(model: mujoco.MjModel, ranges: dict) -> None:
    """Whether the file is of this model: ValueError where an element of the file is not at its index in the model."""
    for one in ranges.get("assignment", ()):
        field = one["target"]
        shape = np.shape(
            getattr(model.opt if field.startswith("opt.") else model, field.removeprefix("opt."))
        )
        for name, index in zip(one.get("elements", [""] * len(one["indices"])), one["indices"], strict=True):
            inside = len(index) == len(shape) and all(i < n for i, n in zip(index, shape, strict=True))
            found = name_at(model, field, index[0]) if inside and name else name
            if not inside or found != name:
                there = repr(found) if inside else "nothing"
                raise ValueError(
                    f"the ranges are of another model: {field}{index} is of {name or 'an element'!r} in the file, and "
                    f"of {there} in the model; take the model of `{ranges['model'].get('made_by', 'dynreg export')}`"
                )


def name_at(model: mujoco.MjModel, field: str, row: int) -> str:
    """The name of the element of a row of a field; a degree of freedom and a position have their joint's."""
    prefix = field.split("_")[0]
    if prefix == "dof":
        prefix, row = "jnt", int(model.dof_jntid[row])
    elif field in ("qpos0", "qpos_spring"):
        prefix, row = "jnt", int(np.searchsorted(model.jnt_qposadr, row, side="right")) - 1
    return mujoco.mj_id2name(model, OBJECTS[prefix], row) or ""


def load(file: Path, mjcf: Path, without_effects: bool) -> tuple[dict, mujoco.MjModel]:
    """The ranges and their model; ends with one line where a file cannot be read, or they do not go together."""
    try:
        ranges, model = read(file, without_effects), mujoco.MjModel.from_xml_path(str(mjcf))
        check(model, ranges)
    except (OSError, ValueError) as problem:
        raise SystemExit(" ".join(str(problem).split())) from None
    return ranges, model


def draw(ranges: dict, count: int, rng: np.random.Generator) -> list[dict[str, float]]:
    """`count` simulators: {name: value in its unit} of what the log leaves open."""
    free, correlations = ranges["free"], np.array(ranges["correlations"]).reshape(-1, len(ranges["free"]))
    deviation = np.array([one["deviation"] for one in free])
    normal = rng.multivariate_normal(np.zeros(len(free)), correlations, count, method="eigh")
    at = np.array([one["centre"] for one in free]) + deviation * normal
    for i, one in enumerate(free):  # what is clipped takes the others along
        beyond = np.clip(at[:, i], 0.0, 1.0) - at[:, i]
        at += beyond[:, None] * correlations[i] * deviation / max(one["deviation"], 1e-12)
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
    """A copy of the exported model with one draw in its fields; ValueError where the file is of another model."""
    check(model, ranges)
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
    ranges, model = load(asked.ranges, asked.model, asked.without_effects)
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
