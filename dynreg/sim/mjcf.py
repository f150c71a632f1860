"""A robot's model, compiled from the files of its folder and no others; a foreign one is tried elsewhere first."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from dynreg.errors import RobotError
from dynreg.folder import TOML, Folder, read_folder
from dynreg.limits import limits, refuse
from dynreg.sim.child import in_child

# MuJoCo looks for a file among those that it is given, by its path or else its name alone, and then on the disk. The
# folder's are given under a path that no disk has, and a model that names others is refused before.
ROOT = "/robot-folder"
_COMPILED: set[tuple[str, str]] = set()  # (hash of the files, model) of those that did so before


def model_files(folder: Folder) -> Folder:
    """The files that a robot's model may name: those that its hash covers, but robot.toml."""
    return Folder({name: data for name, data in folder.hashed.items() if name != TOML})


def try_model(files: Folder, model: str, packaged: Iterable[Path]) -> None:
    """Compile a foreign model in a process of its own, once for the same files; those of packaged robots need none.

    Raises RobotError where MuJoCo refuses the model or ends on it, and where it asks for more than the limits allow.
    """
    if (files.hash, model) in _COMPILED:
        return
    if files.hash not in (model_files(read_folder(folder, links=True)).hash for folder in packaged):
        in_child("dynreg.sim.mjcf:measure", files.files, model, limit="compile_seconds")
    trust_model(files, model)


def trust_model(files: Folder, model: str) -> None:
    """Let a model compile in this process."""
    _COMPILED.add((files.hash, model))


def compile_model(files: Mapping[str, bytes], model: str):
    """The mujoco.MjModel of a closed folder; RobotError where MuJoCo refuses it."""
    import mujoco

    try:
        with mujoco.MjVfs() as given:
            for name, data in files.items():
                given[f"{ROOT}/{name}"] = data
            made = mujoco.MjModel.from_xml_path(f"{ROOT}/{model}", vfs=given)
            # else what moves a centre of mass, or an axis, would be refused: a box on one slide is such a body
            if made.body_simple[1:].any():
                spec = mujoco.MjSpec.from_file(f"{ROOT}/{model}", vfs=given)
                keep_general(spec)
                made = spec.compile(given)
            return made
    except (ValueError, RuntimeError, mujoco.FatalError) as problem:
        raise _refused(model, str(problem)) from None


def keep_general(spec) -> None:
    """Let no body of a mujoco.MjSpec be compiled as a "simple" one, whose inertia is taken to be diagonal for good.

    MuJoCo does so where a body's frame is that of its inertia, and then refuses values of `body_ipos` and the like that
    belong to another: those of some parameters and effects. What flexes are made of stays; nothing here moves it.
    """
    flexed = {name for flex in spec.flexes for name in (*flex.vertbody, *flex.nodebody)}
    for body in spec.bodies:
        if body.name not in flexed:
            body.simple = 0


def _refused(model: str, told: str) -> RobotError:
    if "unknown exception" in told or "allocate memory" in told:  # of C++, which had none
        raise MemoryError
    return RobotError(f"{model}: {told.replace(f'{ROOT}/', '')}", expected="a valid MJCF model", do="mend it")


def measure(files: Mapping[str, bytes], model: str) -> None:
    """Compile a model and look at its first pose; RobotError for more bodies or bytes than the limits allow."""
    import mujoco

    made = compile_model(files, model)
    if made.nbody > limits().bodies:
        refuse(RobotError, f"{model}: too many bodies", made.nbody, "bodies")
    try:
        data = mujoco.MjData(made)
        size = mujoco.mj_sizeModel(made) + made.narena + data.nbuffer
        if size > limits().model_bytes:
            refuse(RobotError, f"{model}: too many bytes when compiled", size, "model_bytes")
        mujoco.mj_forward(made, data)
    except mujoco.FatalError as problem:
        raise _refused(model, str(problem)) from None
