"""What each verb passes on, prints, and answers with its exit status."""

import json
from pathlib import Path

import made_up_results
import pytest
import tiny_registry

from dynreg.cli.call import Call, Shared
from dynreg.cli.schemas import model_of
from dynreg.errors import NoMatchError
from dynreg.registry import ResultRecord

VERBS = {
    "robots": ("robots",),
    "robots list": ("robots", "list"),
    "robots check": ("robots", "check", "servo_pendulum"),
    "populate": ("populate", "servo_pendulum", "-n", "8"),
    "ingest": ("ingest", "run.csv", "--robot", "servo_pendulum"),
    "list": ("list",),
    "show": ("show", "@last"),
    "query": ("query", "bench_monday"),
    "calibrate": ("calibrate", "bench_monday"),
    "report": ("report", "@last"),
    "export": ("export", "bench_monday", "--to", "copy"),
    "rm": ("rm", "bench_monday"),
    "gc": ("gc", "--dry-run"),
    "verify": ("verify",),
    "info": ("info",),
}


@pytest.mark.parametrize("line", VERBS.values(), ids=VERBS)
def test_json_is_one_document_that_fits_its_schema(line, dynreg, session) -> None:
    for arguments in (("--json", *line), (*line, "--json")):
        ended = dynreg(*arguments)
        assert ended.status == 0 and ended.err == ""
        document = json.loads(ended.out)  # fails on anything before or after it
        model = model_of(document["schema"])
        assert json.loads(model.model_validate(document).to_json()) == document


@pytest.mark.parametrize("line", VERBS.values(), ids=VERBS)
def test_text_is_narrow_and_without_colour_codes(line, dynreg, session) -> None:
    ended = dynreg(*line)
    assert ended.status == 0 and ended.err == ""
    assert ended.out.strip()
    assert "\x1b" not in ended.out
    assert max(map(len, ended.out.splitlines())) <= 100


def test_populate_passes_its_options_on(dynreg, session) -> None:
    dynreg(*"populate quadruped -n 8 --seed 3 --ranges slow --no-link --threads 2".split())
    assert session.created
    ((verb, given, named),) = session.asked
    assert (verb, given) == ("populate", ("quadruped", 8))
    told = {"seed": 3, "ranges": "slow", "link": False, "threads": 2, "shard_size": 200}
    told |= {"effects": False, "like": None, "executor": "local", "address": None}
    told |= {"relink": False, "dry_run": False}
    assert named == told | {"progress": named["progress"]}


def test_a_population_beyond_the_limit_makes_no_registry(dynreg, session, monkeypatch) -> None:
    monkeypatch.setenv("DYNREG_MAX_ENTRIES", "1000")
    ended = dynreg("populate", "servo_pendulum", "-n", 2000)
    assert ended.status == 2 and "at most 1000" in ended.err and session.asked == [] and not session.created


def test_a_population_of_a_robot_with_a_recording_is_asked_about_it_next(dynreg, session) -> None:
    told = "populate servo_pendulum -n 8".split()
    assert "next: dynreg ingest LOG --robot servo_pendulum" in dynreg(*told).out
    session.answers["populate"] = session.answers["populate"].model_copy(update={"recording": "monday"})
    assert "next: dynreg query monday" in dynreg(*told).out


def test_the_command_after_a_dry_run_makes_what_was_told(dynreg, session) -> None:
    session.answers["take_away"] = None
    told = "populate servo_pendulum -n 8 --seed 3 --no-link".split()
    assert f"next: dynreg {' '.join(told)}\n" in dynreg(*told, "--dry-run").out


def test_a_population_with_effects_is_asked_by_its_id(dynreg, session) -> None:
    found = session.answers["populate"].model_copy(update={"recording": "monday"})
    session.answers["populate"] = found
    ended = dynreg(*"populate servo_pendulum -n 400 --effects --like monday".split())
    assert f"next: dynreg query monday --population {found.population[:12]}\n" in ended.out


def test_an_error_names_the_registry_and_the_settings_that_were_told(dynreg, session, tmp_path) -> None:
    (tmp_path / "lab.toml").write_text("k = 4\n")
    problem = NoMatchError(
        "no simulators", expected="some", do="run `dynreg populate arm -n 9`, or use others"
    )
    session.answers["query"] = problem
    told = dynreg("query", "monday", "--registry", "of the lab", "--settings", str(tmp_path / "lab.toml")).err
    assert (
        f"run `dynreg populate arm -n 9 --settings {tmp_path / 'lab.toml'} --registry 'of the lab'`, or"
        in told
    )


def test_flags_stand_before_a_remark_and_inside_backticks() -> None:
    here = Call(Shared(registry=Path("lab")), None).here
    assert here("dynreg compare monday  # no better") == "dynreg compare monday --registry lab  # no better"
    assert here("play it, then `dynreg ingest LOG`") == "play it, then `dynreg ingest LOG --registry lab`"
    assert here("dynreg list --registry other") == "dynreg list --registry other"
    assert here("install dynreg anew, see `dynreg --help`") == "install dynreg anew, see `dynreg --help`"


def test_what_is_not_stored_is_not_named_next(dynreg, session, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("dynreg.registry.opening.may_write", lambda path: False)
    assert "next:" in dynreg("query", "monday", "--registry", tmp_path / "none").out
    assert "next:" not in dynreg("query", "monday", "--registry", tmp_path).out


def test_a_word_that_is_no_path_is_no_bug(dynreg, session) -> None:
    session.answers["query"] = NoMatchError("nothing", expected="a recording", do="see `dynreg list`")
    ended = dynreg("query", "a" * 300, "--robot", "servo_pendulum")
    assert ended.status == 4 and "bug" not in ended.err


def test_ingest_reads_the_log_before_it_makes_a_registry(dynreg, session) -> None:
    assert dynreg("ingest", "none.csv", "--robot", "servo_pendulum").status == 1
    assert not session.created and session.asked == []
    assert dynreg("ingest", "run.csv", "--robot", "servo_pendulum", "--name", "monday").status == 0
    ((verb, (recording, robot), named),) = session.asked
    assert session.created and verb == "ingest" and callable(named.pop("progress"))
    assert named == {"name": "monday", "gait": None}
    assert robot.name == "servo_pendulum" and len(recording.episodes) == 5


def test_ingest_offers_the_question_that_needs_no_population(dynreg, session) -> None:
    ended = dynreg("ingest", "run.csv", "--robot", "servo_pendulum", "--name", "monday")
    name = made_up_results.recording().name
    lines = ended.out.splitlines()
    assert lines[-2:] == [f"next: dynreg query {name} -k 5", f"  or: dynreg diagnose {name}"]


@pytest.mark.parametrize("robot", ["first run", "b;c"])
def test_a_command_to_type_reads_the_same_in_a_shell(robot, dynreg, session) -> None:
    """A file with a space in its name was two words."""
    import shlex

    ended = dynreg("effects", robot)
    (line,) = [line for line in ended.out.splitlines() if line.startswith("next: ")]
    assert shlex.split(line)[1:] == ["dynreg", "trial", robot, "--effect", "EFFECT"]


def test_query_passes_its_options_on(dynreg, session) -> None:
    line = "query bench -k 7 --distance embedding --population p --no-replay --no-synthesise"
    dynreg(*line.split(), *"--hold-out kp=400 --budget 50 --robot leg --map m.toml --threads 2".split())
    assert not session.created
    ((verb, given, named),) = session.asked
    assert (verb, given) == ("query", ("bench",))
    assert named == {
        "k": 7,
        "distance": "embedding",
        "population": "p",
        "replay": False,
        "synthesise": False,
        "exact": False,
        "hold_out": "kp=400",
        "budget": 50,
        "robot": "leg",
        "log_map": Path("m.toml"),
        "threads": 2,
        "progress": named["progress"],
    }


def test_query_shows_the_verdict_and_every_part_of_the_answer(dynreg, session) -> None:
    out = dynreg("query", "bench_monday").out
    result = session.answers["query"]
    assert out.startswith("For bench_monday, use the synthesised simulator c0ffee")
    for words in ("nominal", "nearest", "replayed", "synthesised", "answer", "distance", "replay error"):
        assert words in out
    for name in result.nominal.parameters:
        assert name in out
    for neighbour in result.neighbours:
        assert f"#{neighbour.index}" in out
    assert "90 % interval" in out and "arm/velocity" in out and "cost: 1000 distance" in out
    assert "next: dynreg report @last" in out


def test_an_alarm_is_printed_with_the_result_and_exits_4(dynreg, session) -> None:
    session.answers["query"] = made_up_results.neighbours(fits=False)
    for line in (("query", "bench_monday"), ("query", "bench_monday", "--json")):
        ended = dynreg(*line)
        assert ended.status == 4
        assert "replay error 0.41" in ended.out
        assert ended.err.startswith("error: no simulator fits 'bench_monday'")
        assert len(ended.err.splitlines()) == 1 and "replay error 0.41" not in ended.err


def test_a_query_writes_a_report_when_asked(dynreg, session, tmp_path: Path) -> None:
    assert dynreg("query", "bench_monday", "--report", tmp_path / "page.html").status == 0
    assert (tmp_path / "page.html").read_text(encoding="utf-8").startswith("<!doctype html>")


def test_report_writes_where_it_says(dynreg, session, tmp_path: Path) -> None:
    ended = dynreg("report", "@last", "--out", tmp_path / "page.html", "--json")
    assert json.loads(ended.out)["bytes"] == (tmp_path / "page.html").stat().st_size


def test_verify_exits_3_on_faults(dynreg, session) -> None:
    session.answers["verify"] = made_up_results.verification(("shard 0: its file is lost",))
    ended = dynreg("verify")
    assert ended.status == 3
    assert "its file is lost" in ended.out
    assert "expected" in ended.err and "--repair" in ended.err


@pytest.mark.parametrize(
    "line",
    [
        "rm monday",
        "gc --dry-run",
        "verify",
        "import else",
        "ingest run.csv --robot servo_pendulum",
        "diagnose run",
        "list",
    ],
)
def test_the_next_command_is_of_the_same_registry(line, dynreg, session) -> None:
    session.answers["verify"] = made_up_results.verification(("shard 0: its file is lost",))
    ended = dynreg(*line.split(), "--registry", "of the lab")
    (told,) = [one for one in ended.out.splitlines() if one.startswith("next: ")]
    assert told.endswith(" --registry 'of the lab'")
    assert "verify --repair`" not in ended.err  # nor does an error leave it out


def test_rm_says_again_what_it_found_and_not_how_it_was_named(dynreg, session) -> None:
    (found, *_) = session.answers["remove"].items
    assert f"next: dynreg rm {found.id[:12]} --yes" in dynreg("rm", "@last").out


def test_calibrate_passes_its_options_on(dynreg, session) -> None:
    dynreg(*"calibrate bench --seed 2 --budget 40 --hold-out 0.25 --robot leg --map m.toml".split())
    ((verb, given, named),) = session.asked
    assert (verb, given) == ("calibrate", ("bench",))
    assert named == {
        "method": "cma",
        "seed": 2,
        "budget": 40,
        "hold_out": "0.25",
        "start": "nominal",
        "plan": None,
        "population": None,
        "resume": False,
        "threads": 0,
        **dict.fromkeys(("task", "trials", "seconds", "falls", "goal", "search")),
        "robot": "leg",
        "log_map": Path("m.toml"),
        "say": named["say"],
        "progress": named["progress"],
    }


# of stored calibrations, the newest first
QUESTIONS = {"newest": "another", "c0ffee": "own", "oldest": "own"}


def test_calibrate_takes_a_robot_and_a_folder_for_its_trials(dynreg, session) -> None:
    line = "calibrate leg --method btr --task forward --trials 30 --seconds 300.5 --falls 3 --goal 0.8"
    session.answers["calibrate"] = made_up_results.calibration().model_copy(update={"question": "own"})
    kept = {name: ResultRecord(name * 8, "calibration", "", {"question": q}) for name, q in QUESTIONS.items()}
    session.results_about, session.result = lambda *_: kept, kept.get
    ended = dynreg(*line.split(), "--trial", "tries", "--gait", "1f2e")
    assert ended.status == 0 and ended.out.endswith("next: dynreg report c0ffeec0ffee\n")
    ((verb, given, named),) = session.asked
    assert (verb, given) == ("calibrate", ("leg",)) and session.created
    told = {"task": "forward", "trials": 30, "seconds": 300.5, "falls": 3, "goal": 0.8, "method": "btr"}
    assert named == named | told | {"robot_door": Path("tries"), "gait": "1f2e"}
    assert dynreg(*"calibrate leg --method cma --falls 3".split()).status == 2


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("calibrate log --method cma --trial t", "--trial has no meaning for method 'cma'"),
        ("calibrate log --method cma --gait 1f2e", "--gait has no meaning for method 'cma'"),
        ("calibrate log --method btr --trial t --robot leg", "--robot 'leg' with method 'btr'"),
        ("calibrate leg --method cma", "method 'cma' needs a recording, and 'leg' is a robot"),
    ],
)
def test_what_does_not_fit_the_method_is_named_as_on_the_command_line(
    dynreg, tmp_path: Path, monkeypatch, line: str, said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    import dynreg as python

    python.open("dynreg-registry").close()
    ended = dynreg(*line.split())
    assert ended.status == 2 and said in ended.err and "robot_door" not in ended.err
    assert not (tmp_path / "t").exists()


def test_every_method_of_calibrate_may_be_chosen(dynreg, session) -> None:
    from dynreg.errors import OldWord
    from dynreg.methods.table import METHODS

    session.answers["results_about"] = ()
    for method, kind in METHODS.items():
        plan = ("--plan", "plan.toml") if "plan" in kind.needs else ()
        assert dynreg("calibrate", "bench", "--method", method, *plan).status == 0
        asked = [named for verb, _, named in session.asked if verb == "calibrate"]
        assert asked[-1]["method"] == method
    with pytest.warns(OldWord, match="'cmaes' is called 'cma' now"):
        assert dynreg("calibrate", "bench", "--method", "cmaes").status == 0
    assert session.asked[-1][2]["method"] == "cma"
    ended = dynreg("calibrate", "bench", "--method", "guess")
    assert ended.status == 2 and "one of nearest, synthesis, cma, hill, random" in ended.err


def test_info_works_where_there_is_no_registry_and_makes_none(dynreg, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    ended = dynreg("info", "--registry", "none", "--json")
    told = json.loads(ended.out)
    assert ended.status == 0 and not told["exists"] and told["holds"] == {} and "mujoco" in told["versions"]
    assert "rerun-sdk" in told["optional"] and not list(tmp_path.iterdir())
    assert "none there yet" in dynreg("info", "--registry", "none").out


def test_info_says_what_is_wrong_with_a_folder_that_is_no_registry(dynreg, tmp_path: Path) -> None:
    (tmp_path / "letters.txt").write_text("none of ours")
    ended = dynreg("info", "--registry", tmp_path)
    assert ended.status == 1 and str(tmp_path) in ended.err


def test_quiet_leaves_hints_out(dynreg, session) -> None:
    assert "next:" in dynreg("list").out
    assert "next:" not in dynreg("list", "--quiet").out
    assert "next:" not in dynreg("--quiet", "list").out


def test_doctor_prints_its_findings_and_exits_1_when_the_log_is_unusable(dynreg, tmp_path: Path) -> None:
    log = tmp_path / "run.csv"
    log.write_text("time,arm/position\n0,1\n0.01,2\n")
    ended = dynreg("doctor", log, "--robot", "servo_pendulum", "--json")
    document = json.loads(ended.out)
    assert ended.status == 1 and document["usable"] is False
    assert model_of(document["schema"]).model_validate(document).findings
    assert len(ended.err.splitlines()) == 1


def test_doctor_says_a_thing_once(dynreg, tmp_path: Path) -> None:
    log = tmp_path / "run.csv"
    log.write_text(tiny_registry.bench_csv(lambda i, row: [row[0], 40.0 + i % 3, *row[2:]]), encoding="utf-8")
    ended = dynreg("doctor", log, "--robot", "servo_pendulum")
    assert ended.status == 1 and (ended.out + ended.err).count("degrees?") == 1
    assert ended.err.startswith("error: run.csv, episode e0, arm/position and 4 places more: reaches ")
    assert ended.err.endswith("; set `unit`\n") and not ended.out.strip()
    ended = dynreg("doctor", tmp_path / "none.csv", log, "--robot", "servo_pendulum")
    assert ended.status == 1 and (ended.out + ended.err).count("there is no log") == 1
    document = json.loads(dynreg("doctor", log, "--robot", "servo_pendulum", "--json").out)
    assert sum("degrees?" in f["message"] for f in document["findings"]) == 5
    ended = dynreg("doctor", tmp_path / "none.csv")
    assert ended.status == 1 and not ended.out.strip()
    assert (
        ended.err
        == f"error: there is no log '{tmp_path}/none.csv'; expected an existing file; check the path\n"
    )


def test_doctor_says_when_nothing_is_wrong(dynreg, tmp_path: Path) -> None:
    log = tmp_path / "run.csv"
    log.write_text("time,x\n" + "".join(f"{0.01 * i:.2f},{(i * 7) % 11}\n" for i in range(300)))
    ended = dynreg("doctor", log)
    assert ended.status == 0 and "can be ingested" in ended.out


def test_doctor_lists_what_a_log_holds_before_any_robot_exists(dynreg, tmp_path: Path) -> None:
    log = tmp_path / "run.csv"
    log.write_text("time,pos_arm\n" + "".join(f"{0.01 * i:.2f},{(i * 7) % 11}\n" for i in range(300)))
    (topic,) = json.loads(dynreg("doctor", log, "--json").out)["contents"]
    assert topic == {
        "log": "run.csv",
        "topic": "",
        "type": "",
        "messages": 300,
        "rate": pytest.approx(100.0),
        "begin": 0.0,
        "end": pytest.approx(2.99),
        "signals": ["pos_arm"],
        "units": {},
    }
    assert "pos_arm" in dynreg("doctor", log).out


def test_doctor_drafts_a_map_that_ingest_takes(dynreg, tmp_path: Path) -> None:
    """To a file that was not there, or to stdout alone; it never writes over a file."""
    log, drafted = tmp_path / "run.csv", tmp_path / "map.toml"
    renamed = {"arm/position": "pos_arm", "arm/velocity": "vel_arm", "arm/target": "cmd_arm"}
    text = tiny_registry.bench_csv(lambda i, row: row)
    for name, column in renamed.items():
        text = text.replace(name, column)
    log.write_text(text, encoding="utf-8")
    ended = dynreg("doctor", log, "--robot", "servo_pendulum", "--draft-map", drafted)
    assert ended.status == 0 and "map written to" in ended.out and "next: dynreg ingest" in ended.out
    assert dynreg("ingest", log, "--robot", "servo_pendulum", "--map", drafted).status == 0
    again = dynreg("doctor", log, "--robot", "servo_pendulum", "--draft-map", drafted)
    assert again.status == 1 and "is there already" in again.err
    told = dynreg("doctor", log, "--robot", "servo_pendulum", "--draft-map", "-")
    assert told.status == 0 and told.out == drafted.read_text(encoding="utf-8")
    assert dynreg("doctor", log, "--map", drafted, "--draft-map", "-").status == 2


def test_doctor_finds_the_packaged_map_of_a_bench_log(dynreg, data_dir: Path) -> None:
    log = sorted((data_dir / "bam_xl330_pendulum" / "raw").glob("*.json"))[0]
    assert dynreg("doctor", log, "--robot", "servo_pendulum").status == 0
    assert dynreg("doctor", log, "--robot", "emps").status == 1


def test_the_choices_offered_are_those_of_the_layers_below() -> None:
    from dynreg.cli import completion
    from dynreg.sim.robot import packaged_robots
    from dynreg.verbs.list import KINDS

    assert completion.KINDS == KINDS
    assert completion.robot_names("") == sorted(packaged_robots())


def test_a_shell_is_offered_the_names_of_a_registry(registry_folder, monkeypatch: pytest.MonkeyPatch) -> None:
    from dynreg.cli import completion

    monkeypatch.setenv("DYNREG_REGISTRY", str(registry_folder))
    assert completion.recording_names("ben") == ["bench"]
    assert "servo_pendulum" in completion.stored_names("")
    monkeypatch.setenv("DYNREG_REGISTRY", str(registry_folder / "missing"))
    assert completion.recording_names("") == []


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("calibrate quadruped --method cma", "method 'cma' needs a recording, and 'quadruped' is a robot"),
        ("calibrate quadruped --method btr", "method 'btr' without a robot to try"),
        ("calibrate quadruped --method btr --falls 0 --trial t", "--falls 0"),
    ],
)
def test_calibrate_ends_with_status_2_where_a_robot_or_a_recording_is_missing(
    line: str, says: str, dynreg, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    ended = dynreg(*line.split())
    assert ended.status == 2 and says in ended.err and len(ended.err.splitlines()) == 1
    assert not list(tmp_path.iterdir()), "nothing is made"
