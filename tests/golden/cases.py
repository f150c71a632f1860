"""What is compared: one small function a case, through the public door alone, so that the inside may move.

Logs below `logs/` were simulated once and are kept: of robots that hide one effect, but for `walk`, `driven`,
`bank` and `wheels_before`; those of real robots are read from the folder of measured data.
"""

import contextlib
import io
import json
import re
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd
from tiny_registry import QUICK

import dynreg

LOGS = Path(__file__).parent / "logs"
UNITS = {
    "position": "rad",
    "velocity": "rad/s",
    "target": "rad",
    "velocity_command": "rad/s",
    "supply": "V",
    "x": "m",
    "y": "m",
    "vx": "m/s",
    "vy": "m/s",
    "vz": "m/s",
    "wx": "rad/s",
    "wy": "rad/s",
    "wz": "rad/s",
    "roll": "rad",
    "pitch": "rad",
    "yaw": "rad",
}
SETTINGS = ("kp", "added_mass", "stop_height")
Document = dict[str, Any]


@dataclass(frozen=True)
class Place:
    """Where a case may work: an empty folder, the measured data (None without), and on how many threads."""

    folder: Path
    data: Path | None
    threads: int = 1

    def open(self) -> dynreg.Session:
        """The case's registry."""
        return dynreg.open(self.folder / "registry")


class Skipped(Exception):
    """There is no measured data for this case."""


# ---- logs ----


def log(name: str) -> dynreg.Recording:
    """A stored log as a recording, as it is: nothing is resampled."""
    path = next(LOGS.glob(f"{name}.*"))
    frame = pd.read_parquet(path) if path.suffix == ".parquet" else pd.read_csv(path)
    names = [c for c in frame if c not in ("time", "episode", *SETTINGS)]
    constants = [c for c in frame if c in SETTINGS]
    episodes = []
    for episode, rows in frame.groupby("episode", sort=False):
        settings = {c: float(rows[c].iloc[0]) for c in constants}
        episodes.append(
            dynreg.Episode(str(episode), rows["time"].to_numpy(), rows[names].to_numpy(), settings)
        )
    channels = tuple(dynreg.Channel(c, UNITS.get(c.rpartition("/")[2], "1")) for c in names)
    return dynreg.Recording(channels, tuple(episodes), measured=False)


def measured(place: Place, pattern: str) -> list[Path]:
    """Logs of a real robot; Skipped where there are none."""
    found = sorted(place.data.glob(pattern)) if place.data else []
    if not found:
        raise Skipped(f"no {pattern} in DYNREG_DATA_DIR")
    return found


# ---- diagnoses ----


def diagnosed(place: Place, robot: str, name: str, **given: Any) -> Document:
    """A diagnosis of a stored log, by the default threshold."""
    with place.open() as registry:
        registry.ingest(log(name), robot, name=name)
        return registry.diagnose(name, threshold_runs=0, threads=place.threads, **given).to_dict()


def diagnose_servo(place: Place) -> Document:
    """A servo that cogs, read from its file; then what the registry shows of it."""
    with place.open() as registry:
        ingested = registry.ingest(LOGS / "servo.parquet", "servo_pendulum", name="bench")
        found = registry.diagnose(
            "bench",
            effects=("cogging", "payload", "load_friction"),
            hold_out="test_0,test_1",
            threshold_runs=0,
            threads=place.threads,
        )
    return {
        "recording": ingested.to_dict(),
        "diagnosis": found.to_dict(),
        "calibrated": said(place, "show", found.calibrated_simulator),
        "extended": said(place, "show", found.extended_simulator),
        "list": nameless(said(place, "list")),
    }


def diagnose_leg_air(place: Place) -> Document:
    """A leg in the air with play in its knee."""
    return diagnosed(place, "leg", "leg_air", effects=("backlash", "payload"), max_causes=1)


def diagnose_leg_ground(place: Place) -> Document:
    """A leg that stands and bears a load."""
    return diagnosed(place, "leg", "leg_ground", effects=("payload", "force_offset"), max_causes=1)


def diagnose_quadruped(place: Place) -> Document:
    """A quadruped on its feet that bears a load."""
    return diagnosed(place, "quadruped", "quadruped", effects=("payload",), max_causes=1)


def diagnose_diffdrive(place: Place) -> Document:
    """Two wheels that are not alike."""
    return diagnosed(
        place, "diffdrive", "diffdrive", effects=("wheel_gain", "command_delay", "command_deadband")
    )


def diagnose_xl330(place: Place) -> Document:
    """The real servo bench, four runs, by its packaged map."""
    logs = measured(place, "bam_xl330_pendulum/raw/*.json")[::4]
    with place.open() as registry:
        registry.ingest(logs, "servo_pendulum", name="xl330")
        return registry.diagnose(
            "xl330",
            effects=("load_friction", "cogging", "force_offset"),
            tolerance=5.0,
            threshold_runs=0,
            max_causes=1,
            windows=12,
            threads=place.threads,
        ).to_dict()


def diagnose_create(place: Place) -> Document:
    """The first minutes of the real Create, by its packaged map."""
    logs = measured(place, "utias_mrclam/*.parquet")
    with place.open() as registry:
        whole = registry.recording(registry.ingest(logs, "create").recording)
        (episode,) = whole.episodes
        parts = tuple(
            dynreg.Episode(name, episode.time[rows], episode.values[rows])
            for name, rows in (("first", slice(7000)), ("second", slice(7000, 14000)))
        )
        cut = dynreg.Recording(whole.channels, parts, whole.measured)
        registry.ingest(cut, "create", name="create")
        return registry.diagnose(
            "create",
            hold_out="second",
            effects=("turn_slowdown", "drive_inertia", "command_deadband"),
            threshold_runs=0,
            threads=place.threads,
        ).to_dict()


# ---- queries and calibrations ----


def query_servo(place: Place) -> Document:
    """A servo in a small population by every distance, and what the registry shows of it."""
    asked = {"replay": False, "synthesise": False, "k": 4, "threads": place.threads}
    with place.open() as registry:
        made = registry.populate(
            "servo_pendulum", 24, training=replace(QUICK, base_configurations=16), threads=place.threads
        )
        for name in ("bank", "servo"):
            registry.ingest(log(name), "servo_pendulum", name=name)
        found = {
            distance: registry.query("bank", distance=distance, **asked).to_dict()
            for distance in ("one_sided", "embedding", "cross_loss", "trajectory", "replay")
        }
        found["whole"] = registry.query("bank", k=3, threads=place.threads).to_dict()
        found["other"] = registry.query("servo", hold_out="0.3", budget=12, threads=place.threads).to_dict()
        held = registry.verify().to_dict()
    return {
        "populated": made.to_dict(),
        "queries": found,
        "population": said(place, "show", made.population),
        "entry": said(place, "show", found["one_sided"]["neighbours"][0]["entry"]),
        "list": nameless(said(place, "list")),
        "verify": held,
    }


def query_diffdrive(place: Place) -> Document:
    """Two wheels by replay, and the diagnosis that starts from its answer."""
    with place.open() as registry:
        registry.populate("diffdrive", 8, training=QUICK, threads=place.threads)
        registry.ingest(log("diffdrive"), "diffdrive", name="wheels")
        found = registry.query("wheels", distance="replay", k=2, budget=12, threads=place.threads)
        missing = registry.diagnose(
            "wheels", start="@answer", effects=("wheel_gain",), threshold_runs=0, threads=place.threads
        )
        return {"query": found.to_dict(), "diagnosis": missing.to_dict()}


def calibrate(place: Place) -> Document:
    """A servo calibrated by searches, of which two find something better than the nominal."""
    with place.open() as registry:
        registry.ingest(log("servo"), "servo_pendulum", name="bench")
        return {
            method: registry.calibrate("bench", method=method, budget=budget, threads=place.threads).to_dict()
            for method, budget in (("cma", 150), ("ga", 120), ("random", 30))
        }


# ---- gaits ----


def brief_quadruped(folder: Path) -> Path:
    """A copy of the quadruped's folder in which every task lasts a second."""
    made = folder / "quadruped"
    shutil.copytree(dynreg.packaged_robots()["quadruped"], made)
    file = made / "robot.toml"
    head, mark, tasks = file.read_text(encoding="utf-8").partition("[[tasks]]")
    tasks = re.sub(r"^seconds = .*\n", "", tasks, flags=re.MULTILINE)
    tasks = re.sub(r"^(kind = .*)$", r"\1\nseconds = 1.0", tasks, flags=re.MULTILINE)
    file.write_text(head + mark + tasks, encoding="utf-8")
    return made


def gait_nominal(place: Place) -> Document:
    """A quadruped's gait in its nominal simulator, by each search."""
    with place.open() as registry:
        registry.ingest(log("walk"), brief_quadruped(place.folder), name="walk")
        return {
            method: registry.gait(
                "walk", on="nominal", method=method, rollouts=22, threads=place.threads
            ).to_dict()
            for method in ("cma", "hill", "random")
        }


def gait_neighbours(place: Place) -> Document:
    """A quadruped's gait in the nearest of a small population, and the query before it."""
    robot = brief_quadruped(place.folder)
    with place.open() as registry:
        registry.populate(robot, 6, training=QUICK, threads=place.threads)
        registry.ingest(log("walk"), robot, name="walk")
        found = registry.query("walk", distance="replay", k=2, budget=12, threads=place.threads)
        gait = registry.gait("walk", on="nearest", k=2, rollouts=22, threads=place.threads).to_dict()
    gait["source"] = ""  # the result of its query, whose id holds how long that took
    return {"query": found.to_dict(), "gait": gait}


# ---- wheels ----


def drift(place: Place) -> Document:
    """Wheels of which the left one has become slower."""
    with place.open() as registry:
        registry.ingest(log("wheels_before"), "diffdrive", name="before")
        registry.ingest(log("wheels_after"), "diffdrive", name="after")
        return {
            "drift": registry.drift("after", splits=20).to_dict(),
            "welch": registry.drift("after", "before", splits=0, welch=True, cells=10).to_dict(),
        }


def compared(place: Place, models: Sequence[str], simulators: Sequence[str]) -> Document:
    """Models of two wheels on the last commands of a log."""
    with place.open() as registry:
        registry.ingest(log("driven"), "diffdrive", name="driven")
        given = {"starts": 1, "generations": 4, "threads": place.threads}
        return registry.compare("driven", models=models, simulators=simulators, **given).to_dict()


def compare(place: Place) -> Document:
    """Closed forms, a table and the nominal simulator."""
    return compared(place, ("kinematic", "dynamic", "table"), ("nominal",))


def compare_networks(place: Place) -> Document:
    """Both kinds of networks, whose fits round differently from run to run."""
    return compared(place, ("kinematic", "network", "mlp"), ())


# ---- trials and experiments ----


def trial(place: Place) -> Document:
    """Two hidden robots, one with an effect that was drawn and one with none."""
    settings = {"seconds": 12.5, "threshold_runs": 0, "threads": place.threads}
    with place.open() as registry:
        return {
            hide: registry.trial("diffdrive", hide=hide, count=count, seed=3, **settings).to_dict()
            for hide, count in (("drawn", 2), ("nothing", 1))
        }


def excite(place: Place) -> Document:
    """Commands that tell two effects apart."""
    told, found = dynreg.Session.excite("servo_pendulum", ("payload", "coulomb_friction"), seconds=2.0)
    return {
        "experiment": found.to_dict(),
        "commands": [
            {"name": e.name, "settings": dict(e.settings), "values": e.values.round(9).T.tolist()}
            for e in told.episodes
        ],
    }


def effects(place: Place) -> Document:
    """The library of effects, and which of them a quadruped can have."""
    return {robot: said(place, "effects", robot) for robot in ("quadruped",)}


# ---- the command line ----


def said(place: Place, *words: str) -> Document:
    """What a command prints with --json, in the case's registry."""
    from dynreg.cli.main import main

    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        status = main(["--registry", str(place.folder / "registry"), "--json", *words])
    assert status == 0, (words, status)
    return json.loads(out.getvalue())


def nameless(listing: Document) -> Document:
    """A list without the ids of results, which hold how long these took."""
    hidden = [{**item, "id": ""} if item["kind"] == "result" else item for item in listing["items"]]
    return {**listing, "items": hidden}


CASES: dict[str, Callable[[Place], Document]] = {
    function.__name__: function
    for function in (
        diagnose_quadruped,
        diagnose_leg_air,
        diagnose_leg_ground,
        diagnose_xl330,
        diagnose_create,
        diagnose_diffdrive,
        diagnose_servo,
        query_servo,
        query_diffdrive,
        calibrate,
        gait_nominal,
        gait_neighbours,
        drift,
        compare,
        compare_networks,
        trial,
        excite,
        effects,
    )
}
