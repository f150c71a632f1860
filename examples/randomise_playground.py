"""Domain randomisation for MuJoCo Playground from what a log leaves open: needs jax and mujoco-mjx, nothing of dynreg.

    dynreg export monday --as ranges --to ranges.toml
    dynreg export diagnosed --as robot --to robot          # the command that `made_by` in ranges.toml shows
    python examples/randomise_playground.py ranges.toml robot/mujoco.xml -n 64

In a training script, with one key for each simulator:

    ranges = randomise_mjmodel.read("ranges.toml")
    randomise_mjmodel.check(environment.mj_model, ranges)      # the file is of this model
    randomise = functools.partial(domain_randomize, rng=keys, ranges=ranges)
    wrapper.BraxDomainRandomizationVmapWrapper(environment, randomise)
"""

import argparse
from pathlib import Path

import jax
import jax.numpy as jp
from mujoco import mjx
from randomise_mjmodel import load

STRETCH = {
    "linear": (lambda x: x, lambda x: x),
    "log": (jp.log, jp.exp),
    "inverse": (lambda x: -1.0 / x, lambda x: -1.0 / x),
}


def draw(ranges: dict, rng: jax.Array) -> dict[str, jax.Array]:
    """One simulator of what the log leaves open: {name: value in its unit}."""
    free, deviation = ranges["free"], jp.array([one["deviation"] for one in ranges["free"]])
    correlations, (normal, flat) = jp.array(ranges["correlations"]), jax.random.split(rng)
    variance, axes = jp.linalg.eigh(correlations)  # a root that a singular matrix has, too
    root = axes * jp.sqrt(jp.maximum(variance, 0.0))
    at = jp.array([one["centre"] for one in free]) + deviation * (
        root @ jax.random.normal(normal, (len(free),))
    )
    for i, one in enumerate(free):  # what is clipped takes the others along
        at += (jp.clip(at[i], 0.0, 1.0) - at[i]) * correlations[i] * deviation / max(one["deviation"], 1e-12)
    at, even = jp.clip(at, 0.0, 1.0), jax.random.uniform(flat, (len(free),))
    values = {}
    for i, one in enumerate(free):
        there, back = STRETCH[one["scale"]]
        low, high = there(jp.array(one["limits"]))
        values[one["name"]] = back(low + (even if one["draw"] == "uniform" else at)[i] * (high - low))
    return values


def fields(model: mjx.Model, ranges: dict, values: dict[str, jax.Array]) -> dict[str, jax.Array]:
    """{field: its array} of the model with one draw in it; "opt.gravity" is a field of `model.opt`."""
    made = {}
    for one in ranges.get("assignment", ()):
        target, (owner, _, field) = one["target"], one["target"].rpartition(".")
        array = made.get(target, getattr(model.opt if owner else model, field))
        product = jp.prod(jp.array([values[name] ** power for name, power in one["powers"].items()]))
        at = tuple(jp.array(one["indices"]).T)
        change = jp.array(one["factors"]) * product
        made[target] = array.at[at].add(change) if one["operation"] == "+=" else array.at[at].set(change)
    return made


def domain_randomize(model: mjx.Model, rng: jax.Array, ranges: dict) -> tuple[mjx.Model, mjx.Model]:
    """A model for each key in `rng` (N, ...), and which of its fields differ: as Playground's own functions return it.

    Inertia and friction are exact. What MuJoCo computes from them once, such as `dof_invweight0` (it scales contact and
    friction constraints), stays that of the exported model, as in Playground's own randomisation.
    """
    made = jax.vmap(lambda key: fields(model, ranges, draw(ranges, key)))(rng)
    in_axes = jax.tree_util.tree_map(lambda x: None, model)
    return model.tree_replace(made), in_axes.tree_replace(dict.fromkeys(made, 0))


def main(arguments: list[str] | None = None) -> jax.Array:
    """Draw simulators, and step all of them at once for a tenth of a second; (N, nq) where they then are."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("ranges", type=Path)
    parser.add_argument("model", type=Path, help="the mujoco.xml of `dynreg export --as robot`")
    parser.add_argument("-n", type=int, default=16)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--without-effects", action="store_true", help="although the model lacks an effect")
    asked = parser.parse_args(arguments)
    ranges, plain = load(asked.ranges, asked.model, asked.without_effects)
    keys = jax.random.split(jax.random.PRNGKey(asked.seed), asked.n)
    model, in_axes = domain_randomize(mjx.put_model(plain), keys, ranges)
    steps = round(0.1 / plain.opt.timestep)

    def run(one: mjx.Model) -> jax.Array:
        data = mjx.make_data(one)
        return jax.lax.fori_loop(0, steps, lambda _, d: mjx.step(one, d), data).qpos

    qpos = jax.jit(jax.vmap(run, in_axes=(in_axes,)))(model)
    print(f"{asked.n} simulators after {steps} steps: qpos from {qpos.min(axis=0)} to {qpos.max(axis=0)}")
    return qpos


if __name__ == "__main__":
    main()
