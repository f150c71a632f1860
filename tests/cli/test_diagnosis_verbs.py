"""The verbs around a diagnosis: what they pass on, print and refuse."""

import json
from pathlib import Path

import made_up_diagnosis
import made_up_gait
import pytest

from dynreg.cli.schemas import model_of
from dynreg.data.recording import Recording
from dynreg.sim.robot import load_robot

VERBS = {
    "effects": ("effects",),
    "effects of a robot": ("effects", "servo_pendulum"),
    "diagnose": ("diagnose", "bench_monday"),
    "trial": ("trial", "servo_pendulum"),
    "excite": ("excite", "servo_pendulum", "--for", "payload,coulomb_friction", "-o", "next.csv"),
}


@pytest.mark.parametrize("line", VERBS.values(), ids=VERBS)
def test_json_is_one_document_that_fits_its_schema(line, dynreg, session) -> None:
    for arguments in (("--json", *line), (*line, "--json")):
        ended = dynreg(*arguments)
        assert ended.status == 0 and ended.err == ""
        document = json.loads(ended.out)
        model = model_of(document["schema"])
        assert json.loads(model.model_validate(document).to_json()) == document


@pytest.mark.parametrize("line", VERBS.values(), ids=VERBS)
def test_text_is_narrow_and_without_colour_codes(line, dynreg, session) -> None:
    ended = dynreg(*line)
    assert ended.status == 0 and ended.err == ""
    assert "\x1b" not in ended.out and "next: " in ended.out
    assert max(map(len, ended.out.splitlines())) <= 100


def test_diagnose_passes_its_options_on(dynreg, session) -> None:
    line = "diagnose bench --start nearest --hold-out kp=400 --effects payload,inertia --without backlash"
    line += " --max-causes 2 --engine joint --seed 3 --threshold-runs 5 --tolerance 2"
    line += (
        " --horizon 3 --robot leg --map m.toml --threads 2 --joints knee,hip_roll --windows 4 --ranker off"
        " --executor ray --address head:6379"
    )
    assert dynreg(*line.split()).status == 0
    ((verb, given, named),) = session.asked
    assert (verb, given) == ("diagnose", ("bench",)) and not session.created
    assert named == {
        "start": "nearest",
        "hold_out": "kp=400",
        "effects": ("payload", "inertia"),
        "without": ("backlash",),
        "max_causes": 2,
        "engine": "joint",
        "seed": 3,
        "threshold_runs": 5,
        "tolerance": 2.0,
        "horizon": 3.0,
        "joints": ("knee", "hip_roll"),
        "windows": 4,
        "ranker": "off",
        "robot": "leg",
        "log_map": Path("m.toml"),
        "threads": 2,
        "executor": "ray",
        "address": "head:6379",
        "progress": named["progress"],
    }


def test_what_diagnose_is_not_told_is_left_to_the_session(dynreg, session) -> None:
    import inspect

    from dynreg.diagnose.options import DiagnosisOptions
    from dynreg.session import Session

    assert dynreg("diagnose", "bench").status == 0
    named = session.asked[0][2]
    named.pop("progress")  # a line for each stage
    defaults = {n: p.default for n, p in inspect.signature(Session.diagnose).parameters.items()}
    assert named == {name: defaults[name] for name in named}
    stated = DiagnosisOptions()
    assert all(getattr(stated, name) == defaults[name] for name in stated.__dataclass_fields__)


@pytest.mark.parametrize("verdict", ["named", "ambiguous", "partly_explained", "unknown", "none"])
def test_a_finished_diagnosis_is_done_whatever_its_verdict(verdict: str, dynreg, session) -> None:
    session.answers["diagnose"] = made_up_diagnosis.diagnosis(verdict)
    ended = dynreg("diagnose", "bench_monday")
    assert (ended.status, ended.err) == (0, "")
    assert " ".join(session.answers["diagnose"].sentence.split()) in " ".join(ended.out.split())


@pytest.mark.parametrize("verb", ["calibrate", "diagnose", "compare", "gait"])
def test_a_log_given_by_path_may_be_the_first_thing_in_a_registry(verb: str, dynreg, session) -> None:
    session.answers["gait"] = made_up_gait.gait()
    dynreg(verb, "run.csv", "--robot", "servo_pendulum")
    assert session.asked[-1][0] == verb and session.created
    dynreg(verb, "gone.csv", "--robot", "servo_pendulum")
    assert not session.created, "no registry is made for a log that is not there"
    dynreg(verb, "run.csv")
    assert not session.created, "nor for a log of no robot"


@pytest.mark.parametrize("line", [VERBS["diagnose"], VERBS["trial"]], ids=["diagnose", "trial"])
def test_a_report_is_written_when_asked(line, dynreg, session, tmp_path: Path) -> None:
    assert dynreg(*line, "--report", tmp_path / "page.html").status == 0
    assert (tmp_path / "page.html").read_text(encoding="utf-8").startswith("<!doctype html>")


@pytest.mark.parametrize(
    "result", [made_up_diagnosis.diagnosis(), made_up_diagnosis.trials()], ids=["d", "t"]
)
def test_report_writes_the_page_of_a_stored_one(result, dynreg, session, tmp_path: Path) -> None:
    session.answers["result"] = result
    ended = dynreg("report", "@last", "--out", tmp_path / "page.html", "--json")
    assert json.loads(ended.out)["bytes"] == (tmp_path / "page.html").stat().st_size > 10_000


def test_trial_passes_its_options_on(dynreg, session) -> None:
    line = "trial servo_pendulum --effect backlash[arm]+payload --size weak -n 4 --seed 2 --seconds 30"
    line += " --truth independent --physics other --engine joint --threshold-runs 0 --threads 1"
    line += " --executor ray"
    dynreg(*line.split())
    ((verb, (robot,), named),) = session.asked
    assert verb == "trial" and robot.name == "servo_pendulum" and session.created
    assert named == {
        "hide": "chosen",
        "effects": ("backlash[arm]", "payload"),
        "size": "weak",
        "count": 4,
        "seed": 2,
        "seconds": 30.0,
        "truth": "independent",
        "physics": "other",
        "engine": "joint",
        "threshold_runs": 0,
        "threads": 1,
        "executor": "ray",
        "address": None,
        "progress": named["progress"],
    }


@pytest.mark.parametrize("flags, hide", [((), "drawn"), (("--none",), "nothing"), (("--all",), "every")])
def test_trial_hides_what_its_flag_says(flags, hide: str, dynreg, session) -> None:
    assert dynreg("trial", "servo_pendulum", *flags).status == 0
    assert session.asked[0][2]["hide"] == hide and session.asked[0][2]["effects"] == ()


@pytest.mark.parametrize("out", ["next.csv", "next.mcap"])
def test_excite_writes_commands_that_can_be_read_again(out: str, dynreg, session, tmp_path: Path) -> None:
    from dynreg.data.ingest import read_recording
    from dynreg.data.schema import ChannelSpec, RecordingSpec
    from dynreg.data.table import map_for

    line = ("excite", "servo_pendulum", "--for", "payload,coulomb_friction", "--seconds", "4", "--seed", "2")
    ended = dynreg(*line, "-o", tmp_path / out, "--json")
    ((verb, given, named),) = session.asked
    assert (verb, given[0].name) == ("excite", "servo_pendulum")
    assert named == {
        "between": ("payload", "coulomb_friction"),
        "seconds": 4.0,
        "seed": 2,
        "progress": named["progress"],
    }
    assert json.loads(ended.out)["file"] == str(tmp_path / out)
    commands: Recording = session.answers["excite"][0]
    spec = RecordingSpec("servo", (ChannelSpec("arm/target", "rad", "action"),), (), 100.0)
    again = read_recording(tmp_path / out, spec, map_for(commands) if out.endswith("mcap") else None)
    assert again.episodes[0].values == pytest.approx(commands.episodes[0].values)


def test_excite_lets_legs_hang_free(dynreg, session) -> None:
    ended = dynreg("excite", "quadruped", "--legs", "fl,rr", "--seconds", "30", "-o", "hanging")
    ((verb, given, named),) = session.asked
    assert (verb, given[0].name) == ("excite_legs", "quadruped")
    assert (named["legs"], named["seconds"], named["folder"]) == (("fl", "rr"), 30.0, Path("hanging"))
    assert "read hanging/README.md" in ended.out and "fl.csv" in ended.out and "182" in ended.out


def test_excite_finds_robots_that_the_registry_has(dynreg, session) -> None:
    """The command that a diagnosis of one's own robot prints said that there is no such robot."""
    session.answers["robot_folder"] = load_robot("servo_pendulum").folder
    for word in (("--for", "payload,inertia", "-o", "next.csv"), ("--legs", "all", "-o", "hanging")):
        assert dynreg("excite", "my_arm", *word).status == 0
        (looked_up, (asked,), _), (_, (robot,), _) = session.asked[-2:]
        assert (looked_up, asked, robot.name) == ("robot_folder", "my_arm", "servo_pendulum")


def test_effects_of_one_joint_may_be_told_apart(dynreg, session) -> None:
    dynreg("excite", "servo_pendulum", "--for", "backlash[a,b],payload", "-o", "next.csv")
    assert session.asked[0][2]["between"] == ("backlash[a,b]", "payload")


WRONG = [
    ("diagnose bench --max-causes 0", "--max-causes 0"),
    ("diagnose bench --threshold-runs -1", "--threshold-runs -1"),
    ("diagnose bench --seed -1", "--seed -1"),
    ("diagnose bench --effects ,", "--effects ','"),
    ("diagnose bench --max-causes many", "many"),
    ("trial servo_pendulum --none --all", "--none and --all"),
    ("trial servo_pendulum --effect payload --none", "--effect and --none"),
    ("trial servo_pendulum -n 0", "-n 0"),
    ("trial servo_pendulum --size huge", "huge"),
    ("trial servo_pendulum --seconds -3", "--seconds -3"),
    ("trial servo_pendulum --effect rust", "rust"),
    (
        "trial servo_pendulum --effect load_friction+load_friction",
        "effect 'load_friction' twice in one robot",
    ),
    ("trial servo_pendulum --effect backlash[arm]+payload+backlash[arm]", "effect 'backlash[arm]' twice"),
    ("trial servo_pendulum --truth independent --effect payload+payload", "effect 'payload' twice"),
    ("trial servo_pendulum --effect=", "--effect '', in which a name is missing"),
    ("trial servo_pendulum --effect payload+", "--effect 'payload+', in which a name is missing"),
    ("excite servo_pendulum --for payload -o a.csv", "payload"),
    ("excite servo_pendulum --for payload,payload -o a.csv", "two different"),
    ("excite servo_pendulum --for payload,inertia -o a.txt", ".mcap"),
    ("excite servo_pendulum --for payload,inertia -o none/a.csv", "existing folder"),
    ("excite servo_pendulum --for payload,inertia", "--out"),
    ("excite servo_pendulum -o a.csv", "--legs"),
    ("excite quadruped --for payload,inertia --legs fl -o a", "leave one out"),
]


@pytest.mark.parametrize("line, says", WRONG, ids=[line for line, _ in WRONG])
def test_what_cannot_be_is_one_line_and_exits_2(line: str, says: str, dynreg, session) -> None:
    ended = dynreg(*line.split())
    assert ended.status == 2 and ended.out == ""
    assert says in ended.err and "; expected " in ended.err and ended.err.count("\n") == 1
    assert session.asked == [] and not session.created


def test_an_unknown_robot_is_an_error_before_a_registry_is_made(dynreg, session) -> None:
    ended = dynreg("trial", "toaster")
    assert ended.status == 1 and "toaster" in ended.err and not session.created


def test_a_shell_is_offered_effects_also_in_lists() -> None:
    from dynreg.cli.completion import effect_names

    assert effect_names("load_f") == ["load_friction"]
    assert effect_names("payload,load_f") == ["payload,load_friction"]
    assert effect_names("payload+back") == ["payload+backlash"]


def test_the_library_is_listed_without_a_registry(dynreg, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    ended = dynreg("effects", "servo_pendulum")
    assert ended.status == 0 and "load_friction" in ended.out and "cannot act on servo_pendulum" in ended.out
    assert "similar to" not in ended.out and "similar to" in dynreg("effects", "--near").out
    assert list(tmp_path.iterdir()) == []
