"""Maps, robot.toml and MJCF: text changed line by line, trees of elements, and models that ask for much."""

import os
import random
import resource
import zlib
from collections.abc import Callable
from copy import deepcopy
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

from dynreg.data.ingest import read_recording
from dynreg.data.maps import read_map
from dynreg.errors import DynregError, RobotError
from dynreg.limits import limits
from dynreg.sim.mjcf import measure, model_files, trust_model
from dynreg.sim.robot import load_robot, packaged_robots
from fuzzer.mutate import ODD_TEXT, lines, raw
from fuzzer.scratch import held
from fuzzer.target import Target

REAL = 400  # of so many models, one is tried in a real process of its own
MAP = """\
[map]
robot = "servo_pendulum"
time_unit = "s"

[channels."arm/position"]
source = "q"
unit = "rad"
scale = 1.0
delay = 0.001
unwrap = true

[channels."arm/velocity"]
derivative_of = "arm/position"
filter_hz = 20.0

[channels."arm/target"]
source = "goal"

[settings.kp]
filename = 'kp(\\d+)'
default = 400.0

[episodes]
by = "gaps"
gap = 0.5
name = "{stem}_{kp}"
"""
_LOG = "time,q,dq,goal,n\n" + "".join(
    f"{0.01 * i:.2f},{0.3 * (i % 7)},{0.1 * (i % 5)},{0.2 * (i % 9)},{i // 20}\n" for i in range(60)
)
_TOML_WORDS = (
    *ODD_TEXT, "[map]", "[files]", '[channels."a/b"]', "[settings.kp]", "[episodes]", '"', "'", '"""', "{", "}",
    "[[a]]", "=", "true", "nan", "inf", "-inf", "1e999", "9" * 30, "0x7fffffffffffffff", "1979-05-27T07:32:00Z",
    "{a = 1}", "[1, [2]]", "# ", 'by = "column"', 'column = "n"', 'column = "time"', "value = 1e300",
    'metadata = "n"', "scale = 1e308", "offset = nan", 'unit = "deg"', "delay = 1e18", "filter_hz = 49.9",
    "filter_hz = 1e-300", "gap = 1e-300", "filename = '(?:a+)+(x)$'", "filename = '(\\\\d*)*$'",
    'name = "{stem:>1000000000}"', 'name = "{kp:.999999999f}"', 'time_unit = "ns"', 'time = "q"',
)  # fmt: skip
_ROBOT_WORDS = (
    *_TOML_WORDS, "timestep = 1e-12", "control_rate = 1e9", "low = -1e308", "high = 1e308",
    '"port.friction.coulomb[arm] ="', '"mj.body_mass[*] *="', '"mj.opt.timestep ="', '"mj.geom_size[tip] ="',
    'model = "/etc/passwd"', 'model = "../model.xml"', 'model = "."', 'engines = ["mujoco"]',
    'integrator = "rk4"', "steps = 1000000000", "episodes = 1000000000", "[[parameters]]", 'kinds = ["levels"]',
    'keyframe = "a"', 'control = "timed"', 'type = "torque"', "quantum = 1e-320", "values = []",
)  # fmt: skip


def make_map(rng: random.Random) -> bytes:
    """A map file with lines or bytes changed."""
    data = lines(rng, MAP, _TOML_WORDS).encode("utf-8", "surrogatepass")
    return raw(rng, data) if rng.random() < 0.1 else data


def check_map(data: bytes) -> None:
    """Ingest a sound log by a map."""
    log = held("map/kp400_aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa.csv", _LOG.encode())
    read_recording(log, load_robot("servo_pendulum").recording_spec, read_map(held("map/map.toml", data)))


def make_robot(rng: random.Random) -> bytes:
    """A robot.toml with lines or bytes changed."""
    data = lines(rng, text_of("robot.toml"), _ROBOT_WORDS).encode("utf-8", "surrogatepass")
    return raw(rng, data) if rng.random() < 0.1 else data


def check_robot_file(data: bytes) -> None:
    """Load a robot with a sound model, and resolve what its file sets."""
    held("robot/model.xml", text_of("model.xml").encode())
    robot = load_robot(held("robot/robot.toml", data).parent)
    robot.recording_spec, robot.setters, robot.setting_setters, robot.sensor_noise  # noqa: B018
    robot.model  # noqa: B018 (compiles it)


def make_model(rng: random.Random) -> bytes:
    """An MJCF model: elements and attributes changed, or its text."""
    text = text_of("model.xml")
    if rng.random() < 0.2:
        data = lines(rng, text, _ELEMENTS).encode("utf-8", "surrogatepass")
        return raw(rng, data) if rng.random() < 0.3 else data
    root = ElementTree.fromstring(text)
    for _ in range(rng.choice((1, 1, 2, 4))):
        _change(rng, root)
    return ElementTree.tostring(root)


def check_model(data: bytes) -> None:
    """Load a robot with a sound robot.toml, and compile its model, as it is done to a stranger's.

    The process of its own that tries the model first is mostly a fork of this one, which takes a hundredth of the time.
    """
    held("model/robot.toml", text_of("robot.toml").encode())
    robot = load_robot(held("model/model.xml", data).parent)
    files, name = model_files(robot.files), robot.file.robot.model
    if zlib.crc32(data) % REAL:
        _forked(lambda: measure(files.files, name))
        trust_model(files, name)
    robot.model  # noqa: B018 (compiles it)


def _forked(work: Callable[[], None]) -> None:
    """Do the work in a fork with the limits of the real one; a fork that ends, or is refused, is a refusal."""
    child = os.fork()
    if child == 0:
        status = 2
        try:
            seconds = limits().compile_seconds
            resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
            os.close(2)
            work()
            status = 0
        except (DynregError, MemoryError):
            status = 1
        finally:
            os._exit(status)
    _, status = os.waitpid(child, 0)
    if status and os.WIFEXITED(status) and os.WEXITSTATUS(status) != 1:
        raise RuntimeError("neither a result nor a refusal in the process that tries a model")
    if status:
        raise RobotError("the model ends the process that tries it", expected="a model", do="mend it")


_ELEMENTS = (
    '<include file="model.xml"/>', '<include file="../model/model.xml"/>', '<include file="/etc/passwd"/>',
    '<asset><mesh name="m" file="robot.toml"/></asset>',
    '<asset><hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/></asset>',
    '<asset><texture name="t" type="2d" builtin="flat" width="100000" height="100000"/></asset>',
    '<asset><mesh name="m" builtin="sphere" params="9"/></asset>', '<compiler meshdir="/" autolimits="false"/>',
    '<compiler angle="degree" coordinate="global"/>', '<size memory="1000G"/>', '<size njmax="100000000"/>',
    '<size nuserdata="2000000000"/>', '<option timestep="1e-12"/>', '<option timestep="nan"/>',
    '<option gravity="1e308 0 0"/>', "<worldbody/>", "<keyframe><key/></keyframe>",
    '<extension><plugin plugin="mujoco.elasticity.cable"/></extension>', '<default class="a"><geom/></default>',
    "<custom/>", "<sensor/>", '<asset><model name="x" file="model.xml"/></asset>', "<!DOCTYPE a>",
    "<statistic/>", "<visual/>", '<contact><pair geom1="a" geom2="a"/></contact>',
)  # fmt: skip
_BODIES = (
    '<replicate count="{n}" offset="0.1 0 0"><geom size="0.1"/></replicate>',
    '<replicate count="{n}"><replicate count="{n}"><geom size="0.1"/></replicate></replicate>',
    '<composite type="cable" count="{n} 1 1" size="1"><geom size="0.01"/></composite>',
    '<flexcomp name="f" type="grid" count="{n} {n} 1" spacing="0.1 0.1 0.1"/>',
    '<body><freejoint/><geom type="mesh" mesh="m"/></body>', '<geom type="hfield" hfield="h"/>',
    '<body name="a"><body name="a"/></body>', '<attach model="x" body="arm" prefix="p"/>',
    '<frame><geom size="1"/></frame>', '<site size="1"/>', '<camera resolution="100000 100000"/>',
)  # fmt: skip
_VALUES = (
    *ODD_TEXT,
    "0",
    "-1",
    "1e308",
    "-1e308",
    "1e-320",
    "nan",
    "inf",
    "0 0 0",
    "1 2",
    "2147483647",
    "1e400",
    "true",
    "box",
    "mesh",
)


def _change(rng: random.Random, root: ElementTree.Element) -> None:
    nodes = list(root.iter())
    node = rng.choice(nodes)
    act = rng.randrange(8)
    if act < 4 and node.attrib:
        name = rng.choice(list(node.attrib))
        value = rng.choice(_VALUES)
        node.set(name, value if _plain(value) and rng.random() < 0.8 else "0 0 1")
    elif act == 4:
        root.append(_parsed(rng.choice(_ELEMENTS)))
    elif act == 5:
        bodies = [n for n in nodes if n.tag in ("body", "worldbody")] or [root]
        rng.choice(bodies).append(
            _parsed(rng.choice(_BODIES).format(n=rng.choice((0, 1, 5, 50, 1000, 10**5, 10**9))))
        )
    elif act == 6 and len(node):
        node.remove(rng.choice(list(node)))
    elif len(nodes) < 200:
        node.append(deepcopy(rng.choice(nodes)))


def _plain(text: str) -> bool:
    return all(c.isprintable() for c in text)


def _parsed(text: str) -> ElementTree.Element:
    try:
        return ElementTree.fromstring(text)
    except ElementTree.ParseError:
        return ElementTree.Element("custom")


@cache
def text_of(name: str) -> str:
    """A file of the sound robot."""
    return Path(packaged_robots()["servo_pendulum"] / name).read_text(encoding="utf-8")


TARGETS = (
    Target("map", make_map, check_map),
    Target("robot-toml", make_robot, check_robot_file),
    Target("mjcf", make_model, check_model),
)
