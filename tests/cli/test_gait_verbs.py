"""`dynreg gait`, and what is done with a gait: exported, ingested back, shown as a page."""

import json
from pathlib import Path

import made_up_gait
import pytest

from dynreg.cli.schemas import model_of
from dynreg.errors import NoMatchError, OldWord, PictureError


@pytest.fixture
def asked(session):
    session.answers |= {"gait": made_up_gait.gait(), "export_gait": made_up_gait.gait()}
    session.answers["gait_rounds"] = made_up_gait.rounds()
    return session


def test_gait_passes_its_options_on(dynreg, asked) -> None:
    line = (
        "gait yard -k 3 --on synthesised --method hill --accept mean --task turn --rollouts 90 --patience 20"
    )
    more = "--no-packaged --resume --seed 4 --robot quadruped --map m.toml --population p --threads 2"
    assert dynreg(*line.split(), *more.split()).status == 0
    ((verb, given, named),) = asked.asked
    assert (verb, given) == ("gait", ("yard",))
    assert named == {
        "k": 3,
        "on": "synthesised",
        "method": "hill",
        "accept": "mean",
        "task": "turn",
        "rollouts": 90,
        "patience": 20,
        "packaged": False,
        "resume": True,
        "seed": 4,
        "robot": "quadruped",
        "log_map": Path("m.toml"),
        "population": "p",
        "threads": 2,
        "progress": named["progress"],
    }


def test_a_settings_file_may_tell_what_does_nothing_in_these_simulators(dynreg, asked) -> None:
    Path("dynreg.toml").write_text("k = 9\n")
    for line, k in (("--on nominal", 5), ("--on nominal -k 7", 7), ("--on random", 9), ("", 9)):
        assert dynreg("gait", "yard", *line.split()).status == 0
        assert asked.asked[-1][2]["k"] == k


def test_gait_answers_in_json_and_in_tables(dynreg, asked) -> None:
    document = json.loads(dynreg("gait", "yard", "--json").out)
    assert model_of(document["schema"]).model_validate(document) == asked.answers["gait"]
    ended = dynreg("gait", "yard")
    assert ended.status == 0 and max(map(len, ended.out.splitlines())) <= 100
    for words in ("yard_monday: the gait succeeded", "0.9 m in the worst", "amplitude_shoulder", "242 gaits"):
        assert words in ended.out
    asked.answers["gait"] = made_up_gait.gait(fell=True)
    assert "fell in 1 of 3" in dynreg("gait", "yard").out
    noted = made_up_gait.gait().model_copy(update={"notes": ("in 2 of 3 simulators",)})
    asked.answers["gait"] = noted
    assert "note: in 2 of 3 simulators" in dynreg("gait", "yard").out
    assert asked.asked[-1][2]["accept"] is None  # the session chooses


def test_old_words_of_a_gait_still_work(dynreg, asked) -> None:
    with pytest.warns(OldWord, match="'cmaes' is called 'cma' now"):
        assert dynreg("gait", "yard", "--method", "cmaes").status == 0
    with pytest.warns(OldWord, match="'neighbours' is called 'nearest' now"):
        assert dynreg("gait", "yard", "--on", "neighbours").status == 0
    assert [one[2]["method"] for one in asked.asked] == ["cma", "cma"]
    assert asked.asked[-1][2]["on"] == "nearest"


def test_trials_in_turn_are_asked_for_and_told(dynreg, asked) -> None:
    ended = dynreg(*"gait yard --on synthesised --trial trials --trials 4 --falls 2 --map m.toml".split())
    ((verb, given, named),) = asked.asked
    assert ended.status == 0 and (verb, given) == ("gait_rounds", ("yard", Path("trials")))
    wanted = {"trials": 4, "falls": 2, "on": "synthesised", "log_map": Path("m.toml"), "robot": None}
    assert wanted.items() <= named.items()
    named["say"]("play it")
    for words in ("3 trials on the robot, 1 with a fall", "of trial 3, reached 2.5 m", "yard_monday trial 2"):
        assert words in ended.out
    assert "note: the log before trial 2 did not tell where to seek" in ended.out
    assert "note: the gait of trial 3 is number 3 of the gaits in the robot's folder" in ended.out
    assert "next: dynreg export 2a2a2a2a2a2a --as python --to gait.py" in ended.out
    document = json.loads(dynreg("gait", "yard", "--trial", "trials", "--json").out)
    assert model_of(document["schema"]).model_validate(document) == asked.answers["gait_rounds"]
    asked.answers["gait_rounds"] = made_up_gait.rounds((True, True))
    ended = dynreg("gait", "yard", "--trial", "trials")
    assert "2 with a fall. No gait stood." in ended.out
    assert "next: dynreg diagnose 'yard_monday trial 2'" in ended.out


def test_where_nothing_is_close_the_status_is_4(dynreg, asked) -> None:
    asked.answers["gait"] = NoMatchError("nothing close", expected="a", do="run `dynreg diagnose yard`")
    ended = dynreg("gait", "yard")
    assert ended.status == 4 and "dynreg diagnose yard" in ended.err


def test_an_interrupted_search_exits_130(dynreg, asked) -> None:
    asked.answers["gait"] = KeyboardInterrupt()
    assert dynreg("gait", "yard").status == 130


@pytest.mark.parametrize(
    "line, says",
    [
        ("gait yard --method ants", "one of cma, hill, random"),
        ("gait yard --accept max", "one of min, mean, quantile"),
        ("gait yard -k 0", "-k 0"),
        ("gait yard --rollouts 0", "--rollouts 0"),
        ("gait yard --film walk.mp4", "ends in .gif or .png"),
        ("gait yard --film nowhere/walk.gif", "cannot write 'nowhere/walk.gif'"),
        ("gait yard --trials 2", "--trials 2 without --trial; expected a folder"),
        ("gait yard --falls 1", "--falls 1 without --trial"),
        ("gait yard --trial trials --film walk.gif", "--film 'walk.gif' with --trial"),
        ("gait yard --trial trials --trials 0", "--trials 0"),
        ("export a b --as python --to c", "one thing"),
        ("export a --as python --licence mit --to c", "leave --licence out"),
        ("export a --as svg --to c", "svg"),
    ],
)
def test_misuse_is_refused_before_a_registry_is_opened(line: str, says: str, dynreg, asked) -> None:
    ended = dynreg(*line.split())
    assert ended.status == 2 and says in ended.err and asked.asked == []


@pytest.mark.parametrize("form", ["csv", "mcap", "python", "gif", "png", "foxglove"])
def test_export_as_commands(form: str, dynreg, asked) -> None:
    assert dynreg("export", "@last", "--as", form, "--to", "gait.out").status == 0
    assert asked.asked == [("export_gait", ("@last", Path("gait.out"), form), {})]


def test_a_film_is_drawn_of_what_was_found(dynreg, asked) -> None:
    ended = dynreg("gait", "yard", "--film", "walk.gif", "--json")
    assert ended.status == 0 and "walk.gif: written" in ended.err
    assert json.loads(ended.out)["schema"] == "dynreg/gait/2"
    assert asked.asked[1] == ("export_gait", (asked.answers["gait"], Path("walk.gif"), "gif"), {})


def test_where_nothing_can_be_drawn_a_note_says_so_and_the_gait_is_there(dynreg, asked) -> None:
    asked.answers["export_gait"] = PictureError("no picture", expected="an OpenGL", do="install EGL")
    ended = dynreg("gait", "yard", "--film", "walk.gif")
    assert ended.status == 0 and "note: no picture; expected an OpenGL; install EGL" in ended.err
    assert "yard_monday" in ended.out
    ended = dynreg("export", "@last", "--as", "gif", "--to", "walk.gif")
    assert ended.status == 1 and "install EGL" in ended.err


def test_ingest_names_the_gait_that_was_played(dynreg, asked) -> None:
    ended = dynreg("ingest", "run.csv", "--robot", "servo_pendulum", "--gait", "@last")
    assert ended.status == 0 and "--as foxglove --to run.mcap" in ended.out
    named = asked.asked[0][2]
    assert callable(named.pop("progress")) and named == {"name": None, "gait": "@last"}


def test_the_page_of_a_gait(dynreg, asked, tmp_path: Path) -> None:
    asked.answers["result"] = made_up_gait.gait()
    assert dynreg("report", "@last", "--out", tmp_path / "page.html").status == 0
    assert "yard_monday" in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_the_real_thing_from_a_log_to_a_module(dynreg, tmp_path: Path, monkeypatch, registry_folder) -> None:
    """On the servo bench, which does not walk: one line, nothing stored."""
    before = sorted(p.name for p in (registry_folder / "results").glob("*"))
    ended = dynreg("gait", "bench", "--on", "nominal", "--registry", registry_folder)
    assert ended.status == 1 and "robot 'servo_pendulum' has no walking task" in ended.err
    assert sorted(p.name for p in (registry_folder / "results").glob("*")) == before
