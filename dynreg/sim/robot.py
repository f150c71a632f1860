"""Robots as folders: an MJCF model and a robot.toml."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import resources
from pathlib import Path

import numpy as np

from dynreg.data.names import joint_of
from dynreg.data.recording import Recording
from dynreg.data.schema import ChannelSpec, RecordingSpec
from dynreg.errors import LISTED, LogError, RobotError, UsageError, nearest, one_of, quoted
from dynreg.folder import TOML, Folder, expanded, read_folder
from dynreg.sim.base import base_joint
from dynreg.sim.closed import check_closed
from dynreg.sim.consistency import check_consistency
from dynreg.sim.engine import ENGINES, Engine
from dynreg.sim.mjcf import compile_model, model_files, try_model
from dynreg.sim.sets import Assignment, parse
from dynreg.sim.space import Parameter, ParameterSpace
from dynreg.sim.spec import RobotFile
from dynreg.sim.stops import with_stops
from dynreg.tomlfile import parse_toml, toml_text


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot that can be simulated: its folder's files and the checked robot.toml.

    Attributes
    ----------
    name, folder : as given.
    files : those of the folder, as they were when it was loaded.
    file : the checked robot.toml.
    space : the parameters that a population randomizes, in the order of the value vector (P,).
    """

    name: str
    folder: Path
    files: Folder
    file: RobotFile
    space: ParameterSpace

    @property
    def hash(self) -> str:
        """64 hexadecimal digits over robot.toml and the model's files."""
        return self.files.hash

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the state vector (S,)."""
        return tuple(c.name for c in self.file.channels)

    @property
    def actions(self) -> tuple[str, ...]:
        """Names of the action vector (A,)."""
        return tuple(a.name for a in self.file.actions)

    @property
    def action_ranges(self) -> np.ndarray:
        """(A, 2) lowest and highest command of each action; infinite where it states none."""
        ends = [
            (-np.inf if a.low is None else a.low, np.inf if a.high is None else a.high)
            for a in self.file.actions
        ]
        return np.array(ends, dtype=float).reshape(-1, 2)

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """What each action moves: its joint, its wheel, or the base (A,)."""
        return tuple(joint_of(name) for name in self.actions)

    @cached_property
    def driven(self) -> tuple[str, ...]:
        """The joints that actions move, each once, in their order."""
        return tuple(dict.fromkeys(self.joints))

    def drives_of(self, joints: Sequence[str] | None) -> list[int]:
        """Numbers of the actions that move one of `joints`; all of them where none is named."""
        return [i for i, joint in enumerate(self.joints) if not joints or joint in joints]

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the measured inputs, the drives' enable channels last (I,)."""
        enables = dict.fromkeys(d.enable for d in self.file.drives if d.enable)
        return tuple(i.name for i in self.file.inputs) + tuple(enables)

    @property
    def settings(self) -> tuple[str, ...]:
        """Names of the known constants of an episode (K,)."""
        return tuple(s.name for s in self.file.settings)

    @property
    def keyframe(self) -> int:
        """Number of the model's keyframe that episodes start from; -1 where they start from its own pose."""
        name = self.file.reset.keyframe
        names = [self.model.key(i).name for i in range(self.model.nkey)]
        if name is not None and name not in names:
            raise RobotError(
                f"[reset] keyframe {name!r} is not in the model",
                expected=f"one of {quoted(names)}",
                do="correct it",
            )
        return -1 if name is None else names.index(name)

    @property
    def start(self) -> np.ndarray:
        """(nq,) the pose of that keyframe, or the model's own."""
        from dynreg.sim.held import pose_of

        return pose_of(self.model, self.keyframe)

    @property
    def tools(self) -> tuple[str, ...]:
        """Names of the tool frames: sites of bodies that move; RobotError where the model has no such site."""
        from dynreg.sim.masses import weight_at

        for name in self.file.robot.tools:
            weight_at(self.model, name)
        return tuple(self.file.robot.tools)

    @property
    def materials(self) -> dict[str, tuple[int, ...]]:
        """{material: numbers of its geoms}; RobotError where the model has no such geom, or two claim one."""
        from dynreg.sim.materials import geoms_of

        if not self.file.materials:
            return {}
        names = [self.model.geom(i).name for i in range(self.model.ngeom)]
        return geoms_of(self.file, self.files.files[TOML].decode(), TOML, names)

    @property
    def input_defaults(self) -> np.ndarray:
        """(I,) values where a log lacks the input: nominal ones, drives enabled."""
        given = [i.nominal for i in self.file.inputs]
        return np.array(given + [1.0] * (len(self.inputs) - len(given)))

    @property
    def context_defaults(self) -> np.ndarray:
        """(I+K,) inputs and settings where a log tells none: defaults, then nominal values."""
        return np.array([*self.input_defaults, *(s.nominal for s in self.file.settings)])

    @property
    def rate(self) -> float:
        """Commands a second [Hz]."""
        if self.file.robot.control_rate is None:
            raise RobotError(
                f"robot {self.name!r} has control = 'timed'",
                expected="a control_rate",
                do="use a robot whose commands come at a fixed rate",
            )
        return self.file.robot.control_rate

    @property
    def engines(self) -> dict[str, Engine]:
        """The engines that it can run on, by name."""
        return {name: ENGINES[name] for name in self.file.robot.engines}

    def running(self, engine: str | None = None) -> str:
        """The engine that it runs on: this one, or its first; UsageError where it does not offer it."""
        offered = self.file.robot.engines
        if engine is not None and engine not in offered:
            raise UsageError(
                f"robot {self.name!r} has no engine {engine!r}",
                expected=one_of(offered, engine),
                do="choose one of them, or add it to robot.toml",
            )
        return engine or offered[0]

    @property
    def planar(self) -> bool:
        """Whether all of its engines move a planar base: no forces, no contacts."""
        return all(engine.planar for engine in self.engines.values())

    def substeps(self, period: float | np.ndarray) -> np.ndarray:
        """Physics time steps in commands of `period` [s]: at least one, none longer than the stated time step."""
        return np.maximum(np.ceil(np.asarray(period) / self.file.robot.timestep - 1e-9), 1).astype(int)

    def stepped(self, finer: float, **changes: object) -> "Robot":
        """The robot with a physics time step so many times finer, and these entries of [robot] changed."""
        table = self.file.robot
        table = table.model_copy(update={"timestep": table.timestep / finer, **changes})
        return replace(self, file=self.file.model_copy(update={"robot": table}))

    @cached_property
    def base(self) -> int:
        """Number of the free joint of its base; -1 where the base is held, or moves in a plane."""
        return -1 if self.planar else base_joint(self.model, self.driven)

    @property
    def floating(self) -> bool:
        """Whether its base is held by no joint: it stands on its feet, or falls."""
        return self.base >= 0

    @property
    def sensor_noise(self) -> np.ndarray:
        """(S,) standard deviation of each channel by its stated noise and quantum; 0 where none is stated."""
        return np.array([np.sqrt(c.noise**2 + c.quantum**2 / 12) for c in self.file.channels])

    @property
    def recording_spec(self) -> RecordingSpec:
        """What a log of this robot must hold; RobotError where its model cannot be compiled."""
        file = self.file
        signals = {"state": file.channels, "action": file.actions, "input": file.inputs}
        channels = [
            ChannelSpec(t.name, t.unit, kind, getattr(t, "optional", False), t.low, t.high)
            for kind, tables in signals.items()
            for t in tables
        ]
        channels += [ChannelSpec(name, "1", "enable", True, 0, 1) for name in self.inputs[len(file.inputs) :]]
        usual = tuple(s.name for s in file.settings if s.values == [s.nominal])
        spec = RecordingSpec(self.name, tuple(channels), self.settings, file.robot.control_rate, usual)
        return spec if self.planar else with_stops(self.model, spec)

    @cached_property
    def setters(self) -> tuple[tuple[Assignment, ...], ...]:
        """What each parameter sets (P,)."""
        return tuple(tuple(parse(text) for text in p.sets) for p in self.space.parameters)

    @cached_property
    def setting_setters(self) -> tuple[tuple[Assignment, ...], ...]:
        """What each setting sets (K,)."""
        return tuple(tuple(parse(text) for text in s.sets) for s in self.file.settings)

    @cached_property
    def model(self):
        """The compiled mujoco.MjModel, with the physics time step and the integrator of robot.toml."""
        import mujoco

        files, name = model_files(self.files), self.file.robot.model
        try_model(files, name, packaged_robots().values())
        model = compile_model(files.files, name)
        table = self.file.robot
        model.opt.timestep = table.timestep
        if table.integrator is not None:
            model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{table.integrator.upper()}")
        return model


def packaged_robots() -> dict[str, Path]:
    """{name: folder} of the robots that come with dynreg."""
    root = Path(str(resources.files("dynreg") / "robots"))
    return {folder.name: folder for folder in sorted(root.iterdir()) if (folder / "robot.toml").is_file()}


def is_packaged(robot: Robot) -> bool:
    """Whether the robot is one of those that come with dynreg, be it a registry's copy."""
    folder = packaged_robots().get(robot.name)
    return folder is not None and read_folder(folder, links=True).hash == robot.hash


def is_packaged_folder(files: Folder) -> bool:
    """Whether these files are those of a robot that comes with dynreg."""
    toml = files.files.get(TOML)
    same = (folder for folder in packaged_robots().values() if (folder / TOML).read_bytes() == toml)
    return any(read_folder(folder, links=True).hash == files.hash for folder in same)


def load_robot(ref: str | Path, ranges: str | None = None) -> Robot:
    """The robot of a packaged name or of any folder.

    ranges : one of its [populations]; UsageError where it has no such one. Raises RobotError that says what is wrong
    with the folder, and where.
    """
    robot = robot_of(*robot_files(ref))
    return robot if ranges is None else with_population(robot, ranges)


def robot_files(ref: str | Path) -> tuple[Folder, Path]:
    """The files of a packaged name or of any folder, and where they lie; RobotError where there is no robot."""
    packaged = packaged_robots()
    folder = packaged.get(str(ref)) or expanded(ref)
    if not (folder / TOML).is_file():
        here = _folders_here(packaged)
        such = f" (here: {quoted(here[:LISTED])})" if here else ""
        # a path is rather one of a folder than a packaged robot of that name
        others = [n for n in packaged if f"./{n}" not in here or str(ref) == folder.name]
        raise RobotError(
            f"no {TOML} in folder {str(ref)!r}" if folder.is_dir() else f"no robot {str(ref)!r}",
            expected=f"{one_of(packaged, ref)}, or a folder with robot.toml and its MJCF model{such}",
            do="draft one with `dynreg robots init`, or name another folder"
            if folder.is_dir()
            else nearest(folder.name, [*others, *here], "see `dynreg robots`"),
        )
    return read_folder(folder, links=folder in packaged.values()), folder.resolve()


def _folders_here(packaged: Collection[str]) -> list[str]:
    """The robot folders in the working folder, as they are named: with "./" where a packaged robot has the name."""
    names = sorted(toml.parent.name for toml in Path().glob(f"*/{TOML}"))
    return [f"./{name}" if name in packaged else name for name in names]


def hidden_by_name(ref: str | Path) -> list[str]:
    """What to know of a folder whose name is that of a robot that comes with dynreg; empty where there is no such."""
    name, packaged = str(ref), packaged_robots()
    if name in packaged and Path(name, TOML).is_file():
        return [
            f"{name!r} is the robot that comes with dynreg, not the folder here; write './{name}' for the folder"
        ]
    folder = Path.cwd() / expanded(ref)
    if name not in packaged and folder.name in packaged and folder.parent == Path.cwd():
        hidden = f"{folder.name!r} alone means the robot that comes with dynreg"
        return [f"{hidden}; write './{folder.name}' everywhere, or rename the folder"]
    return []


def robot_of(files: Folder, folder: Path) -> Robot:
    """The robot of these files, which were read from `folder`; RobotError as from `load_robot`."""
    text = toml_text(files.hashed.get(TOML, b""), TOML, RobotError)
    file = parse_toml(text, TOML, RobotFile, RobotError)
    check_consistency(file, text, TOML)
    return robot_from(file, files, folder)


def robot_from(file: RobotFile, files: Folder, folder: Path) -> Robot:
    """The robot that a checked robot.toml and the other files make; RobotError where its model lacks a file."""
    readable = model_files(files).files
    if file.robot.model not in readable:
        raise RobotError(
            f"{file.robot.model!r} does not exist in the robot's folder {str(folder)!r}",
            expected="the MJCF model that robot.toml names",
            do="add it or correct `model`",
        )
    check_closed(readable, file.robot.model)
    space = ParameterSpace(
        tuple(Parameter(**dict(table) | {"sets": tuple(table.sets)}) for table in file.parameters)
    )
    return Robot(file.robot.name, folder, files, file, space)


def with_population(robot: Robot, ranges: str) -> Robot:
    """The robot with the parameter ranges that its [populations.<ranges>] gives; UsageError where it has none."""
    if ranges not in robot.file.populations:
        raise UsageError(
            f"robot {robot.name!r} has no population {ranges!r}",
            expected=one_of(sorted(robot.file.populations), ranges, "robot.toml has no named ranges"),
            do="correct the name, or add it to robot.toml as [populations.NAME.ranges]",
        )
    space = robot.space.with_ranges(robot.file.populations[ranges].ranges)
    return replace(robot, space=space)


def require_commands(robot: Robot, recording: Recording) -> None:
    """LogError where a recording lacks commands that the robot declares optional: nothing can be replayed."""
    missing = [name for name in robot.actions if name not in recording.names]
    if missing:
        raise LogError(
            f"the recording holds no commands {missing[0]!r} of robot {robot.name!r}: nothing can be replayed",
            expected=f"the channels {quoted(robot.actions)}",
            do="log the commands too and map them; until then it can only be checked, listed and exported",
        )
