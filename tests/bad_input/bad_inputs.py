"""The table of bad inputs: what is given, and what the one line must say."""

import os
import sqlite3
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from tiny_registry import COLUMNS, bench_csv

MAP = """\
[map]
robot = "servo_pendulum"

[channels."arm/position"]
source = "q"

[channels."arm/velocity"]
source = "dq"

[channels."arm/target"]
source = "goal"
"""
MAPPED = "time,q,dq,goal\n" + "".join(
    f"{0.01 * i:.2f},{0.3 * (i % 7)},{0.1 * (i % 5)},{0.2 * (i % 9)}\n" for i in range(400)
)
INGEST = "ingest {tmp}/run.csv --robot servo_pendulum"
WITH_MAP = f"{INGEST} --map {{tmp}}/map.toml"
CHECK = "robots check {tmp}/robot"
STAGED = "calibrate bench --method staged --plan {tmp}/p.toml"
COPIES = '<replicate count="200"><body><freejoint/><geom size="1"/></body></replicate>'
FIELD = '<hfield name="h" nrow="99999" ncol="99999" size="1 1 1 1"/>'
ITSELF = (
    '<mujoco><asset><model name="m" file="model.xml"/></asset><worldbody><body name="b"/>'
    '<frame><attach model="m" body="b" prefix="p"/></frame></worldbody></mujoco>'
)


@dataclass(frozen=True)
class Bad:
    """One bad input.

    line : the command line; {tmp} is the case's folder, {reg} the registry's copy.
    says : what the error line must hold. status : the exit status.
    files : written below {tmp} first. robot : edits (old, new) of a copy of servo_pendulum at {tmp}/robot.
    prepare : does anything else to (tmp, registry). environment : variables.
    """

    title: str
    line: str
    says: str
    status: int = 1
    files: Mapping[str, str | bytes] = field(default_factory=dict)
    robot: tuple[tuple[str, str], ...] = ()
    prepare: Callable[[Path, Path], object] = lambda tmp, registry: None
    environment: Mapping[str, str] = field(default_factory=dict)


def _at(row: int, column: str, value: object) -> str:
    """The bench log with one value of each episode changed."""
    place = COLUMNS.index(column)
    return bench_csv(lambda i, r: [*r[:place], value, *r[place + 1 :]] if i == row else r)


def _each(column: str, change: Callable[[float], object]) -> str:
    """The bench log with one column changed."""
    place = COLUMNS.index(column)
    return bench_csv(lambda i, r: [*r[:place], change(r[place]), *r[place + 1 :]])


def _without(column: str) -> str:
    place = COLUMNS.index(column)
    return bench_csv(lambda i, r: r[:place] + r[place + 1 :], COLUMNS[:place] + COLUMNS[place + 1 :])


def _csv(text: str | bytes) -> dict[str, str | bytes]:
    return {"run.csv": text}


def _map(old: str, new: str) -> dict[str, str | bytes]:
    assert old in MAP
    return {"run.csv": MAPPED, "map.toml": MAP.replace(old, new)}


def _plan(*parameters: str) -> dict[str, str]:
    stages = [f'[[stages]]\nname = "s{i}"\nparameters = {of}\n' for i, of in enumerate(parameters)]
    return {"p.toml": "\n".join(stages)}


LOGS = [
    Bad("no such log", "ingest {tmp}/none.csv --robot servo_pendulum", "none.csv"),
    Bad("no such log for the doctor", "doctor {tmp}/none.csv", "none.csv"),
    Bad(
        "a folder that is no log",
        "ingest {tmp}/folder --robot servo_pendulum",
        "folder",
        files={"folder/x": ""},
    ),
    Bad(
        "an unknown suffix",
        "ingest {tmp}/run.xyz --robot servo_pendulum",
        "run.xyz",
        files={"run.xyz": "hello"},
    ),
    Bad("a text file called .md", "doctor {tmp}/notes.md", "notes.md", files={"notes.md": "# hello"}),
    *(
        Bad(
            f"an empty {kind}",
            f"ingest {{tmp}}/run.{kind} --robot servo_pendulum",
            f"run.{kind}",
            files={f"run.{kind}": b""},
        )
        for kind in ("csv", "mcap", "bag", "db3", "parquet", "mat", "json")
    ),
    *(
        Bad(
            f"junk in a {kind}",
            f"ingest {{tmp}}/run.{kind} --robot servo_pendulum",
            f"run.{kind}",
            files={f"run.{kind}": bytes(range(7, 256)) * 40},
        )
        for kind in ("csv", "mcap", "bag", "db3", "parquet", "mat", "json")
    ),
    Bad(
        "a header of MCAP and nothing behind it",
        "doctor {tmp}/run.mcap --robot servo_pendulum",
        "run.mcap",
        files={"run.mcap": b"\x89MCAP0\r\n"},
    ),
    Bad(
        "a header of SQLite and junk behind it",
        "ingest {tmp}/run.db3 --robot servo_pendulum",
        "run.db3",
        files={"run.db3": b"SQLite format 3\x00" + b"\x11" * 4000},
    ),
    Bad(
        "a header of Parquet and junk",
        "ingest {tmp}/run.csv --robot servo_pendulum",
        "run.csv",
        files=_csv(b"PAR1" + b"x" * 500),
    ),
    Bad("a CSV of a header alone", INGEST, "run.csv", files=_csv(",".join(COLUMNS) + "\n")),
    Bad("a CSV of one row", INGEST, "run.csv", files=_csv("\n".join(bench_csv().splitlines()[:2]) + "\n")),
    Bad("a CSV without time", INGEST, "time", files=_csv(_without("time"))),
    Bad(
        "a CSV with words for numbers",
        INGEST,
        "'high'",
        files=_csv(_each("arm/position", lambda v: "high")),
    ),
    Bad("a CSV with rows of unequal length", INGEST, "run.csv", files=_csv(bench_csv() + "1,2,3\n")),
    Bad("a column that is missing", INGEST, "arm/target", files=_csv(_without("arm/target"))),
    Bad("a column of NaN", INGEST, "arm/position", files=_csv(_each("arm/position", lambda v: "nan"))),
    Bad("a column of infinities", INGEST, "arm/velocity", files=_csv(_each("arm/velocity", lambda v: "inf"))),
    Bad("a clock that runs back", INGEST, "clock", files=_csv(_at(100, "time", 0.2))),
    Bad("a clock that stands still", INGEST, "clock", files=_csv(_each("time", lambda v: min(v, 0.5)))),
    Bad(
        "degrees in a radian channel",
        INGEST,
        "degrees",
        files=_csv(_each("arm/position", lambda v: 57.3 * v * 4)),
    ),
    Bad("a setting that is no number", INGEST, "'soft'", files=_csv(_each("kp", lambda v: "soft"))),
    Bad(
        "the same column twice",
        INGEST,
        "arm/position",
        files=_csv(bench_csv().replace("arm/velocity", "arm/position", 1)),
    ),
    Bad(
        "a log of another robot",
        "ingest {tmp}/run.csv --robot emps",
        "slider/position",
        files=_csv(bench_csv()),
    ),
    Bad(
        "a name that stands for other data",
        INGEST + " --name bench",
        "'bench'",
        files=_csv(_each("supply", lambda v: 7.2)),
    ),
    Bad(
        "a log that is a pipe",
        INGEST,
        "neither a file",
        prepare=lambda tmp, registry: os.mkfifo(tmp / "run.csv"),
    ),
    Bad(
        "a log of more rows than are read",
        INGEST,
        "DYNREG_MAX_ROWS",
        files=_csv(bench_csv()),
        environment={"DYNREG_MAX_ROWS": "100"},
    ),
    Bad(
        "a log of more columns than are read",
        INGEST,
        "DYNREG_MAX_COLUMNS",
        files=_csv("time," + ",".join(f"c{i}" for i in range(100_001)) + "\n0\n"),
    ),
    Bad(
        "a bench log that is too deep",
        "ingest {tmp}/run.json --robot servo_pendulum",
        "run.json",
        files={"run.json": '{"entries": ' + "[" * 100_000},
    ),
    Bad(
        "a dataset whose info.json is a list",
        "ingest {tmp}/set --robot servo_pendulum",
        "info.json",
        files={"set/meta/info.json": "[]"},
    ),
    Bad("an empty name", INGEST + " --name=", "name", files=_csv(bench_csv()), status=2),
    Bad(
        "a robot that nobody knows",
        "ingest {tmp}/run.csv --robot robbie",
        "'robbie'",
        files=_csv(bench_csv()),
    ),
]

MAPS = [
    Bad("no such map", WITH_MAP, "map.toml", files=_csv(MAPPED)),
    Bad("a map that is not TOML", WITH_MAP, "map.toml", files=_map("[map]", "[map")),
    Bad(
        "a map that is no text", WITH_MAP, "map.toml", files={"run.csv": MAPPED, "map.toml": b"\xff\xfe\x00"}
    ),
    Bad("an empty map", WITH_MAP, "channels", files={"run.csv": MAPPED, "map.toml": ""}),
    Bad(
        "an unknown key in a map", WITH_MAP, "colour", files=_map('source = "q"', 'source = "q"\ncolour = 1')
    ),
    Bad("an unknown table in a map", WITH_MAP, "chanels", files=_map("[map]", "[chanels]\na = 1\n[map]")),
    Bad("a map of another robot", WITH_MAP, "'emps'", files=_map('"servo_pendulum"', '"emps"')),
    Bad("an unknown unit", WITH_MAP, "furlong", files=_map('source = "q"', 'source = "q"\nunit = "furlong"')),
    Bad(
        "a unit of something else", WITH_MAP, "'kg'", files=_map('source = "q"', 'source = "q"\nunit = "kg"')
    ),
    Bad(
        "a channel that the robot lacks", WITH_MAP, "leg/position", files=_map("arm/velocity", "leg/position")
    ),
    Bad("a source that the log lacks", WITH_MAP, "wheel", files=_map('source = "q"', 'source = "wheel"')),
    Bad("no source at all", WITH_MAP, "source", files=_map('source = "q"', "scale = 2.0")),
    Bad(
        "a scale that is no number",
        WITH_MAP,
        "scale",
        files=_map('source = "q"', 'source = "q"\nscale = "two"'),
    ),
    Bad(
        "a regular expression without a group",
        WITH_MAP,
        "groups",
        files=_map("[map]", "[settings.kp]\nfilename = 'kp\\d+'\n[map]"),
    ),
    Bad(
        "a pattern that searches for ever",
        f"ingest {{tmp}}/{'a' * 50}.csv --robot servo_pendulum --map {{tmp}}/map.toml",
        "DYNREG_MAX_PATTERN_SECONDS",
        files={
            f"{'a' * 50}.csv": MAPPED,
            **_map("[map]", "[settings.kp]\nfilename = '(?:a+)+(x)$'\n[map]"),
        },
        environment={"DYNREG_MAX_PATTERN_SECONDS": "1"},
    ),
    Bad(
        "a name as wide as the memory",
        WITH_MAP,
        "plain names",
        files=_map("[map]", "[episodes]\nname = '{kp:100000000000}'\n[map]"),
    ),
    Bad(
        "a scale that is not finite",
        WITH_MAP,
        "finite",
        files=_map('source = "q"', 'source = "q"\nscale = inf'),
    ),
    Bad(
        "a map that is a pipe",
        WITH_MAP,
        "map.toml",
        files=_csv(MAPPED),
        prepare=lambda tmp, registry: os.mkfifo(tmp / "map.toml"),
    ),
    Bad(
        "a broken regular expression",
        WITH_MAP,
        "regular expression",
        files=_map("[map]", "[settings.kp]\nfilename = '(kp'\n[map]"),
    ),
    Bad(
        "a setting that the robot lacks",
        WITH_MAP,
        "gravity",
        files=_map("[map]", "[settings.gravity]\nvalue = 9.8\n[map]"),
    ),
    Bad("episodes by nothing known", WITH_MAP, "moon", files=_map("[map]", '[episodes]\nby = "moon"\n[map]')),
    Bad(
        "an episode name that reaches into objects",
        WITH_MAP,
        "__class__",
        files=_map("[map]", '[episodes]\nname = "{kp.__class__}"\n[map]'),
    ),
    Bad("a clock that the log lacks", WITH_MAP, "stamp", files=_map("[map]", '[map]\ntime = "stamp"')),
    Bad("a unit of time that is none", WITH_MAP, "hours", files=_map("[map]", '[map]\ntime_unit = "hours"')),
]

ROBOTS = [
    Bad("no such robot", "populate robbie -n 4", "'robbie'"),
    Bad(
        "nearly the name of a robot folder here",
        "populate rover -n 4",
        "(here: 'my_rover'); write 'my_rover', which is nearest to it",
        files={"my_rover/robot.toml": ""},
    ),
    Bad("nearly a packaged name", "populate servo_pendulm -n 4", "write 'servo_pendulum', which is nearest"),
    Bad("no such folder", "robots check {tmp}/none", "none"),
    Bad("a folder without robot.toml", CHECK, "robot", files={"robot/model.xml": "<mujoco/>"}),
    Bad("a robot.toml that is not TOML", CHECK, "robot.toml", robot=(("[robot]", "[robot"),)),
    Bad(
        "an unknown key",
        CHECK,
        "'robot.colour'",
        robot=(('name = "servo_pendulum"', 'name = "servo_pendulum"\ncolour = "red"'),),
    ),
    Bad("a missing key", CHECK, "timestep", robot=(("timestep = 0.0025\n", ""),)),
    Bad("low above high", CHECK, "tip_mass", robot=(("low = 0.4\nhigh = 0.6", "low = 0.6\nhigh = 0.4"),)),
    Bad("a nominal value outside", CHECK, "tip_mass", robot=(("nominal = 0.49", "nominal = 0.9"),)),
    Bad("a log scale from 0", CHECK, "tip_mass", robot=(("low = 0.4", "low = 0.0"),)),
    Bad("a missing model", CHECK, "other.xml", robot=(('"model.xml"', '"other.xml"'),)),
    Bad("a model outside the folder", CHECK, "model", robot=(('"model.xml"', '"../model.xml"'),)),
    Bad("a model that is no MJCF", CHECK, "model.xml", robot=(), files={"robot/model.xml": "<mujoco><body"}),
    Bad(
        "`sets` without an operation",
        CHECK,
        "mj.body_mass",
        robot=(('"mj.body_mass[tip] ="', '"mj.body_mass[tip]"'),),
    ),
    Bad("`sets` of an unknown kind", CHECK, "warp", robot=(('"mj.body_mass[tip] ="', '"warp.factor =9"'),)),
    Bad(
        "`sets` with an unknown operation",
        CHECK,
        "mj.body_mass",
        robot=(('"mj.body_mass[tip] ="', '"mj.body_mass[tip] ^="'),),
    ),
    Bad("an unknown body in `sets`", CHECK, "head", robot=(("mj.body_mass[tip]", "mj.body_mass[head]"),)),
    Bad(
        "an unknown field in `sets`",
        CHECK,
        "body_colour",
        robot=(("mj.body_mass[tip]", "mj.body_colour[tip]"),),
    ),
    Bad(
        "an unknown port in `sets`",
        CHECK,
        "magnet",
        robot=(("port.friction.coulomb[arm]", "port.magnet.coulomb[arm]"),),
    ),
    Bad(
        "an action without a drive",
        CHECK,
        "moves no action",
        robot=(('name = "arm/target"', 'name = "leg/target"'),),
    ),
    Bad("a drive of an unknown joint", CHECK, "'leg'", robot=(('joint = "arm"', 'joint = "leg"'),)),
    Bad("a drive of an unknown type", CHECK, "steam", robot=(('"duty_servo"', '"steam"'),)),
    Bad("an unknown engine", CHECK, "warp", robot=(('"joint", "mujoco"', '"warp"'),)),
    Bad(
        "a control rate of 0", CHECK, "control_rate", robot=(("control_rate = 100.0", "control_rate = 0.0"),)
    ),
    Bad("a parameter twice", CHECK, "tip_mass", robot=(('name = "resistance"', 'name = "tip_mass"'),)),
    Bad("a number in quotes", CHECK, "nominal", robot=(("nominal = 0.49", 'nominal = "0.49"'),)),
    Bad(
        "a time step that never ends",
        CHECK,
        "'robot.timestep' = 1e-12",
        robot=(("timestep = 0.0025", "timestep = 1e-12"),),
    ),
    Bad("an infinite time step", CHECK, "finite", robot=(("timestep = 0.0025", "timestep = inf"),)),
    Bad(
        "lists in lists in a robot.toml",
        CHECK,
        "too deep",
        robot=(("[robot]", f"x = {'[' * 5000}{']' * 5000}\n[robot]"),),
    ),
    Bad(
        "a model that includes a file of the system",
        CHECK,
        "reads '/etc/hostname', which is not in the robot's folder",
        files={"robot/model.xml": '<mujoco><include file="/etc/hostname"/></mujoco>'},
    ),
    Bad(
        "a model that includes a file above",
        "ingest {tmp}/run.csv --robot {tmp}/robot",
        "reads '../heavy.xml'",
        files={
            "heavy.xml": '<mujocoinclude><option gravity="0 0 -1"/></mujocoinclude>',
            "robot/model.xml": '<mujoco><include file="../heavy.xml"/></mujoco>',
            "run.csv": "time\n0\n",
        },
    ),
    Bad(
        "a robot folder with a link in it",
        "populate {tmp}/robot -n 4",
        "is a link",
        robot=(("[robot]", "[robot]"),),
        prepare=lambda tmp, _: (tmp / "robot" / "notes.txt").symlink_to("/etc/hostname"),
    ),
    Bad(
        "a robot folder with a pipe in it",
        CHECK,
        "is no file",
        robot=(("[robot]", "[robot]"),),
        prepare=lambda tmp, _: os.mkfifo(tmp / "robot" / "pipe"),
    ),
    Bad(
        "a model that copies itself",
        CHECK,
        "DYNREG_MAX_BODIES",
        files={"robot/model.xml": f"<mujoco><worldbody>{COPIES}</worldbody></mujoco>"},
        environment={"DYNREG_MAX_BODIES": "100"},
    ),
    Bad(
        "a height field of many gigabytes",
        CHECK,
        "DYNREG_MAX_ROBOT_MEMORY",
        files={"robot/model.xml": f"<mujoco><asset>{FIELD}</asset></mujoco>"},
    ),
    Bad(
        "a model that attaches itself",
        CHECK,
        "MuJoCo ends on the robot's model (SIG",
        files={"robot/model.xml": ITSELF},
    ),
    Bad(
        "populate with a broken robot",
        "populate {tmp}/robot -n 4",
        "tip_mass",
        robot=(("nominal = 0.49", "nominal = 0.9"),),
    ),
    Bad("unknown ranges", "populate servo_pendulum -n 4 --ranges lunar", "'lunar'", 2),
]

ARGUMENTS = [
    Bad("no simulators", "populate servo_pendulum -n 0", "-n 0", 2),
    Bad("fewer than no simulators", "populate servo_pendulum -n -5", "-5", 2),
    Bad("how many simulators: a word", "populate servo_pendulum -n many", "'many'", 2),
    Bad("how many simulators: nothing", "populate servo_pendulum", "-n", 2),
    Bad("half a simulator", "populate servo_pendulum -n 2.5", "-n '2.5'; expected a whole number", 2),
    Bad("a power of ten", "populate servo_pendulum -n 1e3", "-n '1e3'; expected a whole number", 2),
    Bad(
        "a short option with its value attached", "populate servo_pendulum -nx", "-n 'x'; expected a whole", 2
    ),
    Bad("a budget that is no number", "query bench --budget=x", "--budget 'x'; expected a whole number", 2),
    Bad(
        "a goal that is no number", "calibrate leg --method btr --goal x", "--goal 'x'; expected a number", 2
    ),
    Bad("a goal of nan", "calibrate leg --method btr --goal nan", "--goal nan; expected a number", 2),
    Bad("a negative seed", "populate servo_pendulum -n 4 --seed -1", "--seed -1", 2),
    Bad("a negative number of threads", "populate servo_pendulum -n 4 --threads -1", "--threads -1", 2),
    Bad("no neighbours", "query bench -k 0", "-k 0", 2),
    Bad("more neighbours than simulators", "query bench -k 9", "9", 2),
    Bad("no budget", "query bench --budget 0", "--budget 0", 2),
    Bad("a budget below k", "query bench -k 5 --budget 3", "3", 2),
    Bad("an unknown distance", "query bench --distance hamming", "'hamming'", 2),
    Bad("an unknown verb", "quarry bench", "quarry", 2),
    Bad("an unknown option", "query bench --colour red", "--colour", 2),
    Bad("no recording", "query", "RECORDING", 2),
    Bad("an unknown recording", "query tuesday -k 3", "'tuesday'", 4),
    Bad("an unknown hash", "query 00000000 -k 3", "'00000000'", 4),
    Bad("an unknown population", "query bench -k 3 --population crowd", "'crowd'", 4),
    Bad("a log without its robot", "query {tmp}/run.csv -k 3", "run.csv", 2, files=_csv(bench_csv())),
    *(
        Bad(
            f"a map beside what is stored: {line.split()[0]}",
            f"{line} --map {{tmp}}/map.toml",
            "--map '{tmp}/map.toml' with recording 'bench', which is stored already",
            2,
            files={"map.toml": MAP},
        )
        for line in (
            "query bench",
            "diagnose bench @last",
            "calibrate bench",
            "compare bench",
            "drift bench",
            "gait bench",
            "navigate bench --visit 1,1",
        )
    ),
    Bad(
        "a log and a robot that is none",
        "query {tmp}/run.csv --robot robbie",
        "'robbie'",
        files=_csv(bench_csv()),
    ),
    Bad("hold out a setting that is none", "query bench -k 3 --hold-out gain=4", "gain", 2),
    Bad("hold out a value that is not there", "query bench -k 3 --hold-out kp=123", "123", 2),
    Bad("hold out a value that is no number", "query bench -k 3 --hold-out kp=soft", "soft", 2),
    Bad("hold out an unknown episode", "query bench -k 3 --hold-out e17", "e17", 2),
    Bad("hold out all episodes", "query bench -k 3 --hold-out e0,e1,e2,e3,e4", "e0,e1", 2),
    Bad("hold out a share above 1", "query bench -k 3 --hold-out 1.5", "1.5", 2),
    Bad("hold out everything", "query bench -k 3 --hold-out 1.0", "share 1", 2),
    Bad("an unknown method", "calibrate bench --method guess", "'guess'", 2),
    Bad("a calibration without simulations", "calibrate bench --budget 0", "--budget 0", 2),
    Bad("calibrate an unknown recording", "calibrate tuesday", "'tuesday'", 4),
    Bad("a staged calibration without a plan", "calibrate bench --method staged", "without a plan", 2),
    Bad(
        "a plan that nothing reads", "calibrate bench --plan {tmp}/p.toml", "--plan", 2, files={"p.toml": ""}
    ),
    Bad("a plan that is not there", STAGED, "p.toml", 2),
    Bad("a plan without stages", STAGED, "stages", 2, files={"p.toml": ""}),
    Bad("a plan of an unknown parameter", STAGED, "'mass'", 2, files=_plan('["mass"]')),
    Bad(
        "a plan whose stages overlap",
        STAGED,
        "overlap",
        2,
        files=_plan('["*"]', '["tip_mass"]'),
    ),
    Bad("show what is not there", "show tuesday", "'tuesday'", 4),
    Bad("a prefix of 3 digits", "show abc", "'abc'", 4),
    Bad("an unknown kind", "list --kind toys", "'toys'", 2),
    Bad("report of nothing", "report tuesday", "'tuesday'", 4),
    Bad("report before there is a result", "report @last", "result", 4),
    Bad("export of nothing", "export tuesday --to {tmp}/copy", "'tuesday'", 4),
    Bad("export to a folder that is there", "export bench --to {tmp}/copy", "copy", 2, files={"copy/x": ""}),
    Bad("export without a destination", "export bench", "--to", 2),
]

DIAGNOSE = "diagnose {tmp}/run.csv --robot servo_pendulum --threshold-runs 0 --horizon 2 --effects payload"


def _rows(keep: Callable[[int, int], bool]) -> str:
    """The bench log with the rows that `keep` (row of the episode, episode) says."""
    head, *rows = bench_csv().splitlines()
    return "\n".join([head, *(r for j, r in enumerate(rows) if keep(j % 200, j // 200))]) + "\n"


def _still(*columns: str) -> str:
    places = [COLUMNS.index(c) for c in columns]
    return bench_csv(lambda i, r: [0.25 if k in places else v for k, v in enumerate(r)])


DIAGNOSES = [
    Bad(
        "diagnose a log of two rows an episode",
        DIAGNOSE,
        "less than 10 steps",
        files=_csv(_rows(lambda i, e: i < 2)),
    ),
    Bad("diagnose a log of 0.05 s", DIAGNOSE, "less than 10 steps", files=_csv(_rows(lambda i, e: i < 5))),
    Bad("diagnose a log of 0.15 s", DIAGNOSE, "measured rows", files=_csv(_rows(lambda i, e: i < 16))),
    Bad(
        "diagnose one episode in one rollout",
        DIAGNOSE,
        "makes 1 rollout of 2 s",
        files=_csv(_rows(lambda i, e: e == 0)),
    ),
    Bad(
        "diagnose two episodes and hold one out",
        DIAGNOSE + " --hold-out e0",
        "no rollout remains for the select part",
        files=_csv(_rows(lambda i, e: e < 2)),
    ),
    Bad(
        "diagnose a log in which no command changes",
        DIAGNOSE,
        "commands never change",
        files=_csv(_still("arm/target")),
    ),
    Bad(
        "diagnose a robot that does not move",
        DIAGNOSE,
        "'arm/position'",
        files=_csv(_still("arm/position", "arm/velocity")),
    ),
    Bad("diagnose a log where nothing moves", DIAGNOSE, "never change", files=_csv(_still(*COLUMNS[1:4]))),
    Bad("diagnose a log without commands", DIAGNOSE, "arm/target", files=_csv(_without("arm/target"))),
    Bad(
        "diagnose a log that holds no command",
        DIAGNOSE,
        "arm/target",
        files=_csv(_each("arm/target", lambda v: "nan")),
    ),
    Bad(
        "diagnose a log with a handful of positions",
        DIAGNOSE,
        "measured rows",
        files=_csv(bench_csv(lambda i, r: r if i % 200 < 4 else [r[0], "nan", *r[2:]])),
    ),
    Bad(
        "diagnose the log of another robot",
        "diagnose {tmp}/run.csv --robot emps",
        "slider/position",
        files=_csv(bench_csv()),
    ),
    Bad(
        "diagnose a recording as one of another robot",
        "diagnose bench --robot emps",
        "lacks what robot 'emps'",
        2,
    ),
    Bad("diagnose a recording that is not there", "diagnose tuesday", "'tuesday'", 4),
    Bad("diagnose a log of no robot", "diagnose {tmp}/run.csv", "no robot", 2, files=_csv(bench_csv())),
    Bad("an effect that nobody knows", "diagnose bench --effects gremlins", "'gremlins'", 2),
    Bad("leave out an effect that nobody knows", "diagnose bench --without gremlins", "'gremlins'", 2),
    Bad(
        "effects that the robot cannot have",
        "diagnose bench --effects ground_friction --threshold-runs 0",
        "'ground_friction'",
        2,
    ),
    Bad(
        "an effect asked for and left out",
        "diagnose bench --effects payload --without payload",
        "'payload'",
        2,
    ),
    Bad("no effects at all", "diagnose bench --effects ,", "','", 2),
    Bad("no causes", "diagnose bench --max-causes 0", "--max-causes 0", 2),
    Bad("a tolerance of nothing", "diagnose bench --tolerance 0", "tolerance 0", 2),
    Bad("a horizon of nothing", "diagnose bench --horizon 0", "horizon 0", 2),
    Bad("a horizon below a step", "diagnose bench --horizon 0.001", "0.001", 2),
    Bad("a negative threshold", "diagnose bench --threshold-runs -1", "--threshold-runs -1", 2),
    Bad("an engine that the robot lacks", "diagnose bench --engine warp --threshold-runs 0", "'warp'", 2),
    Bad("start from what is not there", "diagnose bench --start wednesday", "'wednesday'", 4),
    Bad("start from a query that was not asked", "diagnose bench --start nearest", "no query", 4),
    Bad("diagnose and hold out an unknown episode", "diagnose bench --hold-out e17", "e17", 2),
    Bad(
        "report of a diagnosis into no folder", "diagnose bench --report {tmp}/none/page.html", "page.html", 2
    ),
]

SETTINGS = [
    Bad(
        "an unknown setting",
        "list --settings {tmp}/s.toml",
        "colour",
        2,
        files={"s.toml": 'colour = "red"\n'},
    ),
    Bad(
        "a setting of the wrong kind",
        "list --settings {tmp}/s.toml",
        "'k'",
        2,
        files={"s.toml": 'k = "five"\n'},
    ),
    Bad(
        "settings that are not TOML",
        "list --settings {tmp}/s.toml",
        "s.toml",
        2,
        files={"s.toml": "k = = 1\n"},
    ),
    Bad("no such settings", "list --settings {tmp}/s.toml", "s.toml", 2),
    Bad("a variable that is no number", "query bench", "DYNREG_K='abc'", 2, environment={"DYNREG_K": "abc"}),
    Bad("a variable out of range", "query bench", "DYNREG_K='0'", 2, environment={"DYNREG_K": "0"}),
]


def _populate_twice(tmp: Path, registry: Path) -> None:
    from tiny_registry import QUICK

    from dynreg import session

    with session.open(registry) as opened:
        opened.populate("servo_pendulum", 2, seed=1, training=QUICK, link=False)


def _another_robot(tmp: Path, registry: Path) -> None:
    from dynreg import session
    from dynreg.verbs.subjects import loaded_robot

    log = tmp / "other.csv"
    rows = (f"{0.005 * i:.3f},{0.01 * (i % 17)},{0.02 * (i % 5)},{0.3 * (i % 9)}\n" for i in range(400))
    log.write_text("time,carriage/position,carriage/velocity,carriage/force\n" + "".join(rows))
    with session.open(registry) as opened:
        robot = loaded_robot("emps")
        names = ["time", *robot.channels, *robot.actions]
        log.write_text(log.read_text().replace(log.read_text().splitlines()[0], ",".join(names), 1))
        opened.ingest(log, "emps", name="slide")


def _overwrite(name: str, data: bytes) -> Callable[[Path, Path], object]:
    return lambda tmp, registry: (registry / name).write_bytes(data)


def _cut_a_shard(tmp: Path, registry: Path) -> None:
    shard = sorted(registry.glob("shards/**/*.safetensors"))[0]
    shard.write_bytes(shard.read_bytes()[: shard.stat().st_size // 2])


def _newer_catalogue(tmp: Path, registry: Path) -> None:
    with sqlite3.connect(registry / "catalog.sqlite") as connection:
        connection.execute("INSERT INTO migrations VALUES ('999_from_the_future')")
    connection.close()


def _lose(name: str) -> Callable[[Path, Path], object]:
    return lambda tmp, registry: (registry / name).unlink()


REGISTRIES = [
    Bad("no registry there", "list --registry {tmp}/none", "none"),
    Bad("a query where there is no registry", "query bench --registry {tmp}/none", "none"),
    Bad("a registry that is a file", "list --registry {tmp}/file", "file", files={"file": "x"}),
    Bad(
        "populate into a file",
        "populate servo_pendulum -n 2 --registry {tmp}/file",
        "file",
        files={"file": "x"},
    ),
    Bad("a folder that is no registry", "list --registry {tmp}/folder", "folder", files={"folder/x": ""}),
    Bad(
        "ingest into a folder that is no registry",
        INGEST + " --registry {tmp}/folder",
        "folder",
        files={"folder/x": "", "run.csv": bench_csv()},
    ),
    Bad("verify where there is no registry", "verify --registry {tmp}/none", "none"),
    Bad(
        "a marker of a newer version",
        "list",
        "99",
        prepare=_overwrite("dynreg.json", b'{"format": "dynreg-registry", "version": 99}'),
    ),
    Bad("a marker that is junk", "list", "dynreg.json", 3, prepare=_overwrite("dynreg.json", b"\x00\xff")),
    Bad("a catalogue of a newer version", "list", "future", prepare=_newer_catalogue),
    Bad(
        "a catalogue that is junk",
        "list",
        "catalog.sqlite",
        3,
        prepare=_overwrite("catalog.sqlite", b"junk" * 3000),
    ),
    Bad(
        "verify a catalogue that is junk",
        "verify",
        "catalog",
        3,
        prepare=_overwrite("catalog.sqlite", b"junk" * 3000),
    ),
    Bad("a catalogue that is lost", "list", "catalog.sqlite", 3, prepare=_lose("catalog.sqlite")),
    Bad("a shard cut in half", "query bench -k 3", "shard", 3, prepare=_cut_a_shard),
    Bad("verify with a shard cut in half", "verify", "shard", 3, prepare=_cut_a_shard),
    Bad("two populations and none named", "query bench -k 2", "--population", 2, prepare=_populate_twice),
    Bad("a recording of a robot without simulators", "query slide -k 3", "emps", 4, prepare=_another_robot),
    Bad(
        "a population of another robot",
        "query slide -k 3 --population servo_pendulum",
        "servo_pendulum",
        2,
        prepare=_another_robot,
    ),
]

GAITS = [
    Bad("a gait for a robot that does not walk", "gait bench --on nominal", "has no walking task"),
    Bad("a gait for an unknown recording", "gait nobody", "nobody", 4),
    Bad("a gait by an unknown method", "gait bench --method ants", "--method 'ants'", 2),
    Bad("an export of a gait that is none", "export @last --as csv --to g.csv", "gait", 4),
    Bad(
        "a gait file that is none",
        "export {tmp}/g.json --as csv --to g.csv",
        "is not a gait",
        2,
        files={"g.json": "{}"},
    ),
    Bad(
        "a log of a gait that is not there",
        INGEST + " --gait 0123abcd",
        "0123abcd",
        4,
        files={"run.csv": bench_csv()},
    ),
    Bad(
        "tasks without legs",
        CHECK,
        "there are tasks, but no [gait]",
        robot=(("[[actions]]", '[[tasks]]\nname = "forward"\n\n[[actions]]'),),
    ),
]

ALL = (*GAITS, *LOGS, *MAPS, *ROBOTS, *ARGUMENTS, *DIAGNOSES, *SETTINGS, *REGISTRIES)
