"""`dynreg robots init` and what follows it: where the folder goes, and which command comes next."""

import math
import re
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

ARM = """<mujoco><worldbody><body name="arm"><joint name="turn" axis="0 1 0" damping="0.1"/>
  <geom type="capsule" fromto="0 0 0 0 0 -0.1" size="0.01" mass="0.1"/></body></worldbody>
  <actuator><position joint="turn" kp="8" kv="0.3" forcerange="-2 2"/></actuator></mujoco>"""


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def arm(dynreg, here: Path) -> Path:
    """The folder of a robot that was drafted with a log at 100 Hz, whose clock is `time`."""
    (here / "arm.xml").write_text(ARM)
    (here / "run.csv").write_text(_moving([f"{k / 100}" for k in range(600)], "time"))
    assert dynreg(*"robots init arm.xml --log run.csv".split()).status == 0
    return here / "arm"


def test_one_command_leads_to_the_next(dynreg, here: Path) -> None:
    (here / "arm.xml").write_text(ARM)
    rows = [f"{n / 100},{n % 7 / 100},{n % 5 / 100}" for n in range(300)]
    (here / "run.csv").write_text("\n".join(["t_s,pos_turn,cmd_turn", *rows]))
    made = dynreg(*"robots init arm.xml --log run.csv".split())
    assert made.status == 0 and "next: dynreg robots check arm" in made.out, made
    checked = dynreg(*"robots check arm".split())
    assert checked.status == 0 and "next: dynreg ingest LOG --robot arm" in checked.out, checked
    stored = dynreg(*"ingest run.csv --robot arm --name monday".split())
    assert stored.status == 0 and "next: dynreg diagnose monday" in stored.out, stored


@pytest.mark.parametrize("model, folder", [("arm/robot.xml", "arm_robot"), ("so101.xml", "so101_robot")])
def test_a_folder_of_its_own_beside_the_models_and_under_no_name_that_is_taken(
    model: str, folder: str, dynreg, here: Path
) -> None:
    (here / model).parent.mkdir(exist_ok=True)
    (here / model).write_text(ARM)
    made = dynreg("robots", "init", model)
    assert made.status == 0 and (here / folder / "robot.toml").is_file(), made
    assert ("so101" in model) == (f'name = "{folder}"' in (here / folder / "robot.toml").read_text())
    again = dynreg("robots", "init", model)
    assert again.status != 0 and folder in again.err


def test_what_the_model_cannot_be_given_is_an_error_of_the_command(dynreg, here: Path) -> None:
    """Found out in the process that reads the model, and told as one of the command line."""
    (here / "arm.xml").write_text(ARM)
    made = dynreg("robots", "init", "arm.xml", "--free-base")
    assert made.status == 2 and "--free-base for arm.xml, an MJCF" in made.err, made
    assert not (here / "arm").exists()


@pytest.mark.parametrize(
    "wrong, told",
    [({"timestep": "timestap"}, 1), ({"timestep": "timestap", "[excitation]": "[excitatio]"}, 2)],
)
def test_the_check_tells_each_error_once(wrong: dict[str, str], told: int, dynreg, here: Path) -> None:
    (here / "arm.xml").write_text(ARM)
    dynreg("robots", "init", "arm.xml", "--to", "arm")
    toml = here / "arm" / "robot.toml"
    text = toml.read_text()
    for old, new in wrong.items():
        text = text.replace(old, new, 1)
    toml.write_text(text)
    ended = dynreg("robots", "check", "arm")
    both = " ".join(f"{ended.out} {ended.err}".split())
    assert ended.status == 1 and both.count("timestap") == 1 and both.count("error: ") == told, both
    assert f"{len(wrong)} error" in ended.out


def test_a_file_that_is_missing_is_told_by_the_place_where_it_was_looked_for(dynreg, here: Path) -> None:
    mesh = '<mujoco><compiler meshdir="./assets/"/><asset><mesh name="m" file="base.stl"/></asset>'
    (here / "arm.xml").write_text(ARM.replace("<mujoco>", mesh))
    made = dynreg("robots", "init", "arm.xml")
    assert made.status == 1 and "'assets/base.stl'" in made.err, made


def test_a_log_without_commands_is_said_to_have_none(dynreg, here: Path) -> None:
    (here / "arm.xml").write_text(ARM)
    rows = [f"{n / 100},{n % 7 / 100},{n % 5 / 100}" for n in range(300)]
    (here / "run.csv").write_text("\n".join(["t_s,pos_turn,effort_turn", *rows]))
    made = dynreg(*"robots init arm.xml --log run.csv".split())
    said = " ".join(made.out.split())
    assert "no column of commands was recognised" in said and "It holds effort_turn, pos_turn" in said
    assert "the log measures the torque" not in said


def _moving(times: list[str], clock: str, size: float = 1.0) -> str:
    """A log of the arm whose joint follows its command, with these stamps."""
    angles = [(size * math.sin(0.02 * k - 0.1), size * math.sin(0.02 * k)) for k in range(len(times))]
    rows = [f"{time},{went:.6f},{told:.6f}" for time, (went, told) in zip(times, angles, strict=True)]
    return "\n".join([f"{clock},pos_turn,cmd_turn", *rows])


@pytest.mark.parametrize(
    ("times", "told"),
    [
        ([f"{10 * k}" for k in range(600)], "looks like milliseconds; expected seconds in column 'time'"),
        ([f"{10**7 * (k + 17 * 10**10)}" for k in range(600)], "call the column time_ns"),
        ([f"{k + 1700}" for k in range(600)], "go up by 1: seconds (1 Hz) or milliseconds (1000 Hz)"),
        ([f"{2 * k}" for k in range(600)], "go up by 2: seconds (0.5 Hz) or milliseconds (500 Hz)"),
        (
            [f"{1767225600000 + k}" for k in range(600)],
            "go up by 1: seconds (1 Hz) or milliseconds (1000 Hz)",
        ),
        ([f"{100_000_000 + k}" for k in range(600)], "go up by 1: seconds (1 Hz) or milliseconds (1000 Hz)"),
        ([f"{k // 3 + k % 3}" for k in range(600)], "the clock runs back"),
        ([f"{k * 1e-5:.5f}" for k in range(600)], "no robot is logged so"),
        ([f"{k % 300 / 100}" for k in range(600)], "the clock runs back by 2.99 s"),
        ([f"{k // 300}" for k in range(600)], "the clock stands still"),
    ],
)
def test_a_log_whose_clock_tells_no_rate_ends_in_one_line(
    times: list[str], told: str, dynreg, here: Path
) -> None:
    (here / "arm.xml").write_text(ARM)
    (here / "run.csv").write_text(_moving(times, "time"))
    made = dynreg(*"robots init arm.xml --log run.csv".split())
    said = " ".join(made.err.split())
    assert made.status == 1 and told in said and "robot.toml" not in said, made
    assert not (here / "arm").exists()


@pytest.mark.parametrize(
    ("step", "clock", "rate"), [(10, "time_ms", "100"), (1, "time_ms", "500"), (1, "time_s", "1")]
)
def test_the_name_that_the_error_proposes_makes_the_clock_known(
    step: int, clock: str, rate: str, dynreg, here: Path
) -> None:
    """A log of 1000 Hz is drafted at 500 Hz."""
    (here / "arm.xml").write_text(ARM)
    (here / "run.csv").write_text(_moving([f"{step * k}" for k in range(600)], clock))
    made = dynreg(*"robots init arm.xml --log run.csv".split())
    assert made.status == 0 and f"at {rate} Hz" in made.out, made


def test_seconds_that_are_called_milliseconds_are_told_and_how_to_call_them(dynreg, here: Path) -> None:
    (here / "arm.xml").write_text(ARM)
    times = [f"{0.002 * k:.3f}" for k in range(600)]
    (here / "run.csv").write_text(_moving(times, "time_ms"))
    init = "robots init arm.xml --log run.csv".split()
    made = dynreg(*init)
    said = " ".join(made.err.split())
    assert (
        made.status == 1
        and "the name 'time_ms' says milliseconds, but then the median step is 2e-06 s" in said
    )
    assert "call the column time_s, or write it in the unit that its name says" in said
    (here / "run.csv").write_text(_moving(times, "time_s"))
    made = dynreg(*init)
    assert made.status == 0 and "at 500 Hz" in made.out, made


def test_a_map_drafted_from_nanoseconds_reads_them(dynreg, arm: Path, here: Path) -> None:
    (here / "ns.csv").write_text(_moving([f"{10**7 * (k + 17 * 10**10)}" for k in range(600)], "time"))
    told = dynreg(*"doctor ns.csv --robot arm --draft-map ns.toml".split())
    assert told.status == 0 and 'time_unit = "ns", by the steps of' in " ".join(told.out.split()), told
    stored = dynreg(*"ingest ns.csv --robot arm --map ns.toml".split())
    assert stored.status == 0 and "600 rows, 6.0 s, 100 Hz" in " ".join(stored.out.split()), stored


def test_a_drafted_map_with_which_a_log_cannot_be_ingested_ends_in_an_error(
    dynreg, arm: Path, here: Path
) -> None:
    (here / "back.csv").write_text(_moving([f"{k % 300 / 100}" for k in range(600)], "time"))
    for file in ("back.toml", "-"):
        told = dynreg("doctor", "back.csv", "--robot", "arm", "--draft-map", file)
        assert told.status == 1 and "the clock runs back" in told.err and "next:" not in told.out, told
    assert "time_unit" in (here / "back.toml").read_text()


@pytest.mark.parametrize(
    "times",
    [
        [f"{k + 0.5}" for k in range(600)],
        [f"{k + (0.25 if k == 7 else 0.0)}" for k in range(600)],
        [f"{1.7e9 + k:.0f}" for k in range(600)],
        [f"2026-01-05T{k // 3600:02}:{k // 60 % 60:02}:{k % 60:02}Z" for k in range(600)],
    ],
)
def test_a_slow_clock_that_tells_its_unit_is_no_error(times: list[str], dynreg, here: Path) -> None:
    (here / "arm.xml").write_text(ARM)
    (here / "run.csv").write_text(_moving(times, "time"))
    made = dynreg(*"robots init arm.xml --log run.csv".split())
    assert made.status == 0 and "at 1 Hz" in made.out, made


@pytest.mark.parametrize("every", [1, 5])
def test_rare_commands_beside_a_quick_clock_are_no_slow_clock(every: int, dynreg, here: Path) -> None:
    """A command each second, or each five."""
    (here / "arm.xml").write_text(ARM)
    told = [f"{k / 100},{0.01 * k:.4f},{0.01 * k if k % (100 * every) == 0 else ''}" for k in range(6000)]
    (here / "run.csv").write_text("\n".join(["time,pos_turn,cmd_turn", *told]))
    made = dynreg(*"robots init arm.xml --log run.csv".split())
    assert made.status == 0 and "at 100 Hz" in made.out, made


def test_of_two_clocks_without_a_unit_the_quicker_one_is_told(dynreg, here: Path) -> None:
    (here / "arm.xml").write_text(ARM)
    rows = np.arange(600.0)
    arrays = {
        "time": rows,
        "pos_turn": 0.01 * rows,
        "cmd_time": 2.0 * rows[:300],
        "cmd_turn": 0.02 * rows[:300],
    }
    np.savez(here / "run.npz", **arrays)
    made = dynreg(*"robots init arm.xml --log run.npz".split())
    assert made.status == 1 and "go up by 1" in " ".join(made.err.split()), made


@pytest.mark.parametrize("verb", ["doctor", "ingest"])
@pytest.mark.parametrize("clock", ["stamp_of_bench", "t_s"])
def test_a_clock_that_the_map_names_and_the_log_lacks_is_told_as_such(
    clock: str, verb: str, dynreg, arm: Path, here: Path
) -> None:
    """Not as a channel that the log lacks, which is what its map is for."""
    own = arm / "maps" / "log.toml"
    own.write_text(own.read_text().replace('time = "time"', f'time = "{clock}"'))
    ended = dynreg(verb, "run.csv", "--robot", "arm")
    said = " ".join(ended.err.split())
    assert ended.status == 1 and f"no column '{clock}', which the map names as the clock" in said, ended
    assert "one of 'time', 'pos_turn', 'cmd_turn'; correct `time` under [map]" in said
    assert "arm/maps/log.toml" in " ".join(f"{ended.out} {said}".split()).replace(" ", "").replace("\\", "/")
    own.write_text(own.read_text().replace(f'time = "{clock}"\ntime_unit = "s"\n', ""))
    assert dynreg(verb, "run.csv", "--robot", "arm").status == 0


def test_doctor_reads_a_log_by_the_map_of_its_robot_as_ingest_does(dynreg, arm: Path, here: Path) -> None:
    """What a check finds then is told, not that the log has none of the robot's columns."""
    (here / "back.csv").write_text(_moving([f"{k % 300 / 100}" for k in range(600)], "time"))
    for verb in ("doctor", "ingest"):
        ended = dynreg(verb, "back.csv", "--robot", "arm")
        assert ended.status == 1 and "the clock runs back by 2.99 s" in ended.err, ended


def test_a_clock_that_runs_back_is_told_what_to_do_once(dynreg, arm: Path, here: Path) -> None:
    (here / "back.csv").write_text(_moving([f"{k % 300 / 100}" for k in range(600)], "time"))
    for verb in (
        "doctor back.csv",
        "doctor back.csv --robot arm",
        "robots init arm.xml --to x --log back.csv",
    ):
        said = dynreg(*verb.split()).err
        assert len(re.findall("mend", said)) == 1 and said.count("split") == 1, said


def test_a_log_above_500_hz_is_said_to_be_thinned_with_advice_that_works(dynreg, here: Path) -> None:
    (here / "arm.xml").write_text(ARM)
    (here / "run.csv").write_text(_moving([f"{k / 700:.6f}" for k in range(900)], "time"))
    made = dynreg(*"robots init arm.xml --log run.csv".split())
    said, toml = " ".join(made.out.split()), here / "arm" / "robot.toml"
    assert "the log has 700 rows a second, and control_rate is 350 Hz, which takes one in 2" in said, made
    assert "of the log's stamps, of which it takes one in 2" in toml.read_text()
    stored = dynreg(*"ingest run.csv --robot arm".split())
    advice = re.compile(r"set control_rate = (\S+) in robot.toml, with a timestep of at most (\S+) s")
    rate, step = advice.search(said).groups()
    told = " ".join(stored.out.split())
    assert advice.search(told).groups() == (rate, step)
    assert "- info: run.csv" in told and "lie between those that are taken" in told and "warning" not in told
    text = re.sub("control_rate = .*", f"control_rate = {rate}", toml.read_text())
    toml.write_text(re.sub("timestep = .*", f"timestep = {step}", text))
    assert dynreg(*"robots check arm".split()).status == 0
    stored = dynreg(*"ingest run.csv --robot arm".split())
    assert stored.status == 0 and "899 rows" in stored.out and "dropped" not in stored.out, stored


def test_stamps_with_too_few_digits_are_said_to_be_so_with_advice_that_works(
    dynreg, arm: Path, here: Path
) -> None:
    (here / "coarse.csv").write_text(_moving([f"{k / 50:.1f}" for k in range(600)], "time"))
    init = "robots init arm.xml --log coarse.csv --to".split()
    told = "stamps repeat the one before: they are written to 0.1 s, and rows come about every 0.02 s"
    made = dynreg(*init, "two")
    assert made.status == 0 and told in " ".join(made.out.split()), made
    checked = dynreg(*"ingest coarse.csv --robot two".split())
    said = " ".join(checked.out.split())
    assert checked.status == 0 and told in said and "control_rate" not in said, checked
    step = float(re.search(r"as the number of the row times ([\d.]+)", said)[1].rstrip("."))
    (here / "coarse.csv").write_text(_moving([f"{k * step:.4f}" for k in range(600)], "time"))
    made = dynreg(*init, "three")
    assert "stamps repeat" not in made.out and "at 50 Hz" in made.out, made


@pytest.mark.parametrize(
    ("stamps", "told"),
    [
        ([f"{k / 100:.2f}" for k in range(600)], "correct time_unit under [map] if it is longer"),
        (
            [f"{10**7 * k}" for k in range(600)],
            "correct time_unit there if the signal is sampled at another rate",
        ),
    ],
)
def test_a_later_log_whose_clock_counts_otherwise_than_the_map_says_is_told_so(
    stamps: list[str], told: str, dynreg, here: Path
) -> None:
    (here / "arm.xml").write_text(ARM)
    (here / "run.csv").write_text(_moving([f"{10 * k}" for k in range(600)], "time_ms"))
    assert dynreg(*"robots init arm.xml --log run.csv".split()).status == 0
    (here / "later.csv").write_text(_moving(stamps, "time_ms"))
    for verb in ("ingest", "doctor"):
        ended = dynreg(verb, "later.csv", "--robot", "arm")
        assert ended.status == 1 and told in " ".join(ended.err.split()), ended


DATES = [
    *("11/29/2026 09:01:02.500", "29.11.2026 09:01", "09:01:02.5", "09:01:02", "2026-11-29 09:01:02,5"),
]


@pytest.mark.parametrize("first", DATES)
@pytest.mark.parametrize("verb", ["doctor", "robots init arm.xml --to two --log"])
def test_dates_that_are_not_read_are_told_with_a_form_that_is(
    verb: str, first: str, dynreg, here: Path
) -> None:
    (here / "arm.xml").write_text(ARM)
    (here / "odd.csv").write_text(_moving([f'"{first}"'] * 600, "time"))
    ended = dynreg(*verb.split(), "odd.csv")
    said = " ".join(ended.err.split())
    assert ended.status == 1 and "the time column 'time' does not hold numbers" in said, ended
    form = re.search(r"dates such as (\S+); write the column so, with the fractions of a second", said)[1]
    start = datetime.fromisoformat(form)
    dates = [(start + timedelta(seconds=k / 100)).isoformat(timespec="milliseconds") for k in range(600)]
    (here / "odd.csv").write_text(_moving(dates, "time"))
    assert dynreg(*verb.split(), "odd.csv").status == 0


def test_a_log_without_a_clock_is_told_how_to_get_one(dynreg, here: Path) -> None:
    (here / "arm.xml").write_text(ARM)
    (here / "odd.csv").write_text(_moving([f"{k}" for k in range(600)], "sample"))
    init = "robots init arm.xml --log odd.csv".split()
    ended = dynreg(*init)
    said = " ".join(ended.err.split())
    assert ended.status == 1 and "no column that looks like time among 3: 'sample'" in said, ended
    assert "add a column time: the number of the row times the seconds between two rows" in said
    (here / "odd.csv").write_text(_moving([f"{k * 0.01}" for k in range(600)], "time"))
    assert dynreg(*init).status == 0


def test_a_later_log_in_degrees_is_told_by_the_stops_of_the_model(dynreg, here: Path) -> None:
    """The draft's own log is in rad; doctor drafts a map for the other one that says its unit."""
    (here / "arm.xml").write_text(ARM.replace('name="turn"', 'name="turn" range="-80 80"'))
    times = [f"{k / 100}" for k in range(600)]
    (here / "run.csv").write_text(_moving(times, "time"))
    dynreg(*"robots init arm.xml --log run.csv".split())
    assert dynreg(*"ingest run.csv --robot arm".split()).status == 0
    (here / "later.csv").write_text(_moving(times, "time", 180 / math.pi))
    stored = dynreg(*"ingest later.csv --robot arm --map arm/maps/log.toml".split())
    assert stored.status == 1 and "41 x its limit; degrees?" in " ".join(stored.err.split()), stored
    drafted = dynreg(*"doctor later.csv --robot arm --draft-map -".split())
    assert drafted.out.count('unit = "deg"') == 2, drafted
