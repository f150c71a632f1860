"""A robot on a stand: its base is held, and its legs hang free."""

import re
import tomllib
from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import mujoco
import numpy as np

from dynreg.errors import RobotError, UsageError
from dynreg.folder import TOML, Folder
from dynreg.sim.engines import rollout
from dynreg.sim.excitation import excitation
from dynreg.sim.mjcf import ROOT, model_files, trust_model
from dynreg.sim.robot import Robot, robot_of
from dynreg.sim.space import ParameterSpace
from dynreg.tomlfile import literal, toml_text

SUFFIX = "_on_stand"
ABOVE = 1.5  # times the length of a stretched leg at which the base is held: links may be longer than nominal
# what only a robot says that moves freely: it cannot fall from a stand, nor walk on it
ONLY_FREE = ("fall", "gait", "motions", "tasks", "populations")
# s: on the packaged quadruped its usual 4 ms move fast reversals by 11 mrad, five times its encoders' noise and more
# than a spring shows, 1 ms by 2.8
TIMESTEP = 0.001
TRIED, IDLE = 4, 1e-9  # episodes in which a parameter must change something, by so much of a channel's unit
_TRACKED = re.compile(r"""^\s*tracked\s*=\s*\[(?:"[^"]*"|'[^']*'|[^]"'])*\].*\n?""", re.MULTILINE)
_HEADER = re.compile(r"^\s*\[\[?\s*([A-Za-z0-9_-]+)[\w.\s-]*\]\]?\s*(?:#.*)?$", re.MULTILINE)


def on_stand(robot: Robot) -> Robot:
    """The robot with its base held so high that no foot reaches the ground: a folder in memory, to be written or used.

    Its model has no free joint, and nothing on it touches anything; robot.toml has no channel of the base, no falls,
    gaits, tasks, populations and tracked bodies, no parameter that changes nothing there, and a time step of at most
    `TIMESTEP`. A robot without a floating base is itself. Raises RobotError where the model cannot be changed so.
    """
    if not robot.floating:
        return robot
    base = robot.base
    name = robot.model.joint(base).name
    files = {path: data for path, data in robot.files.hashed.items() if path != robot.file.robot.model}
    files[robot.file.robot.model] = _held(robot, base).encode()
    made = _made(robot, files, name, frozenset())
    return _made(robot, files, name, _idle(made))


def _made(robot: Robot, files: dict[str, bytes], base: str, without: frozenset[str]) -> Robot:
    """The robot of these files; its parameters are the given robot's, which may have been changed since it was read."""
    folder = Folder({**files, TOML: _told(robot, base, without).encode()})
    made = robot_of(folder, robot.folder)
    trust_model(model_files(folder), made.file.robot.model)
    known = {p.name: p for p in robot.space.parameters}
    return replace(made, space=ParameterSpace(tuple(known[name] for name in made.space.names)))


def _idle(robot: Robot) -> frozenset[str]:
    """The parameters that change nothing of a robot on its stand, such as the ground's friction and the base's mass."""
    shaping = [any(entry.startswith("control.") for entry in p.sets) for p in robot.space.parameters]
    tried = [i for i, own in enumerate(shaping) if not own]  # motor noise is none of a rollout's own
    values = np.tile(robot.space.nominal, (1 + 2 * len(tried), 1))
    for row, i in enumerate(tried):
        p = robot.space.parameters[i]
        values[1 + 2 * row, i], values[2 + 2 * row, i] = p.low, p.high
    run = excitation(robot, seed=0, name="stand", episodes=TRIED, reach=2.0)
    states = rollout(robot, values, run).states
    change = np.nanmax(np.abs(states[1:] - states[:1]), axis=(1, 2, 3)).reshape(-1, 2).max(axis=1)
    return frozenset(robot.space.names[i] for i, most in zip(tried, change, strict=True) if most <= IDLE)


def legs_of(robot: Robot) -> dict[str, tuple[str, ...]]:
    """{leg: its driven joints} of all that hangs from the base by a joint, in the order of the actions.

    A leg is called as its joints' common beginning ("fl" of fl_hip and fl_knee), else by its first joint. Raises
    UsageError for a robot without joints.
    """
    if robot.planar or not robot.driven:
        raise UsageError(
            f"robot {robot.name!r} has no legs",
            expected="a robot with driven joints",
            do="name another robot",
        )
    model, branches = robot.model, dict[int, list[str]]()
    for joint in robot.driven:
        branches.setdefault(_root(model, int(model.joint(joint).bodyid[0])), []).append(joint)
    names = [_common(joints) for joints in branches.values()]
    unlike = len({*names}) == len(names) and "" not in names
    return {
        name if unlike else joints[0]: tuple(joints)
        for name, joints in zip(names, branches.values(), strict=True)
    }


def _root(model: mujoco.MjModel, body: int) -> int:
    """The first body on the way from the base to `body` that a joint moves, but for a free one."""
    root = body
    while body:
        first, many = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        if many and (model.jnt_type[first : first + many] != mujoco.mjtJoint.mjJNT_FREE).all():
            root = body
        body = int(model.body_parentid[body])
    return root


def _common(joints: list[str]) -> str:
    """What the names of several joints begin with, up to a "_"; "" of one joint, or where they have nothing alike."""
    if len(joints) < 2:
        return ""
    first, last = min(joints), max(joints)
    same = next((i for i, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), len(first))
    return first[:same].rpartition("_")[0]


def _held(robot: Robot, base: int) -> str:
    """The model as MJCF without free joints and contacts, its base at the keyframe's attitude and above all feet.

    Bodies beside the robot stay as parts of the world: parameters may name them.
    """
    model = robot.model
    body, at = int(model.jnt_bodyid[base]), int(model.jnt_qposadr[base])
    spec = _spec(robot)
    free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
    lost = {"qpos": (model.jnt_qposadr[free], 7), "qvel": (model.jnt_dofadr[free], 6)}
    for key, (name, (first, count)) in product(spec.keys, lost.items()):
        if len(told := np.array(getattr(key, name))):
            setattr(key, name, np.delete(told, (first[:, None] + np.arange(count)).ravel()))
    held = spec.body(model.body(body).name)
    beside = [spec.body(model.body(int(b)).name) for b in model.jnt_bodyid[free] if b != body]
    for joint in [joint for one in (held, *beside) for joint in one.joints]:
        spec.delete(joint)
    for geom in [geom for one in (held, *beside) for geom in one.find_all("geom")]:
        geom.contype = geom.conaffinity = 0
    for pair in list(spec.pairs):
        spec.delete(pair)
    held.pos = [0.0, 0.0, ABOVE * _reach(model, body)]
    # an `euler` of the model would win over its quat
    held.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    held.quat = robot.start[at + 3 : at + 7]
    return spec.to_xml()


def _spec(robot: Robot) -> mujoco.MjSpec:
    """The model as MuJoCo's own tree."""
    with mujoco.MjVfs() as given:
        for path, data in model_files(robot.files).files.items():
            given[f"{ROOT}/{path}"] = data
        return mujoco.MjSpec.from_file(f"{ROOT}/{robot.file.robot.model}", vfs=given)


def _reach(model: mujoco.MjModel, root: int) -> float:
    """How far any part that `root` carries can get from it [m], whatever its joints do."""
    far = {root: 0.0}
    for body in range(root + 1, model.nbody):
        parent = int(model.body_parentid[body])
        if parent in far:
            far[body] = far[parent] + float(np.linalg.norm(model.body_pos[body]))
    owners = model.geom_bodyid
    own = np.linalg.norm(model.geom_pos, axis=1) + model.geom_rbound
    return max((far[int(b)] + float(own[g]) for g, b in enumerate(owners) if int(b) in far), default=1.0)


def _told(robot: Robot, base: str, without: frozenset[str]) -> str:
    """robot.toml without what only a floating base has and these parameters, under another name."""
    text = toml_text(robot.files.files[TOML], TOML, RobotError)
    kept = []
    for name, block in _tables(text):
        if name in ONLY_FREE:
            continue
        told = tomllib.loads(block)
        if name == "channels" and told["channels"][0]["name"].startswith(f"{base}/"):
            continue
        if name == "parameters" and told["parameters"][0]["name"] in without:
            continue
        if name == "robot":
            block = _TRACKED.sub("", block)
            block = _put(block, "timestep", min(robot.file.robot.timestep, TIMESTEP))
            block = _put(block, "name", robot.name + SUFFIX)
            if "title" in told["robot"]:
                block = _put(block, "title", f"{told['robot']['title']}, on a stand")
        if name == "reset":
            block = re.sub(r"^\s*base\s*=.*\n?", "", block, flags=re.MULTILINE)
        kept.append(block)
    return "".join(kept)


def _tables(text: str) -> Iterator[tuple[str, str]]:
    """(name, text) of what stands before the first table, under "", and of each table up to the next."""
    heads = [*_HEADER.finditer(text)]
    ends = [head.start() for head in heads] + [len(text)]
    yield "", text[: ends[0]]
    for head, begin, end in zip(heads, ends, ends[1:], strict=False):
        yield head[1], text[begin:end]


def _put(block: str, key: str, value: str | float) -> str:
    """A table with another value of one key."""
    told = literal(value) if isinstance(value, str) else repr(value)
    return re.sub(rf"^(\s*{key}\s*=\s*).*$", lambda m: m[1] + told, block, count=1, flags=re.MULTILINE)
