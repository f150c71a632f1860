"""Files of ranges that are not to be trusted blindly: what warns, what examples refuse, what is not written."""

import shutil
import tomllib
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
import secret_servo
from rich.console import Console

from dynreg import session
from dynreg.errors import NoMatchError, UsageError
from dynreg.report.ranges_file import tables
from dynreg.results.ranges import RangesFile
from dynreg.session import Session
from dynreg.sim.robot import load_robot


@pytest.fixture
def changed(servos, tmp_path: Path):
    """Stores a changed copy of the first secret's answer, as the newest about its recording; gives the id."""
    folder = shutil.copytree(servos.registry.path, tmp_path / "copy")
    with session.open(folder) as opened:

        def store(**changes: object) -> tuple[Session, str]:
            record = opened.registry.result(opened.registry.results_about("neighbours", "secret 0")[0])
            document = dict(record.document)
            kept = changes.pop("synthesised", {})
            if document["synthesised"] and kept is not None:
                kept = {k: v for k, v in (document["synthesised"] | kept).items() if v is not None}
            return opened, opened.registry.put_result(
                "neighbours", record.recording_id, document | changes | {"synthesised": kept}
            )

        yield store


def test_a_result_of_an_older_version_has_intervals_alone(changed, asked, example, tmp_path: Path) -> None:
    opened, identity = changed(synthesised={"posterior": None})
    told = opened.export_ranges(identity, tmp_path / "old.toml")
    ranges = tomllib.loads((tmp_path / "old.toml").read_text(encoding="utf-8"))
    assert not told.correlated and "older version" in told.notes[0] and "older version" in ranges["notes"][0]
    assert ranges["correlations"] == np.eye(7).tolist()
    now = asked[0].answer.synthesised.posterior
    for i, q in enumerate(ranges["free"]):
        if q["draw"] == "uniform":
            assert q["interval"] == q["limits"] and now.names[i] in now.untold
        else:
            assert q["centre"] == pytest.approx(now.centre[i], abs=1e-9)
            assert q["deviation"] == pytest.approx(now.deviations[i], rel=1e-9)


def test_a_robot_that_no_simulator_fits_is_told_loudly(changed, example, tmp_path: Path) -> None:
    opened, identity = changed(fits=False, alarm="far off")
    told = opened.export_ranges(identity, tmp_path / "bad.toml")
    text = (tmp_path / "bad.toml").read_text(encoding="utf-8")
    assert not told.reliable and told.warning.startswith("Do not rely on these intervals")
    assert f"# WARNING: {told.warning}" in text and tomllib.loads(text)["reliable"] is False
    with pytest.raises(ValueError, match="Do not rely"):
        example.read(tmp_path / "bad.toml")


def test_a_query_that_is_not_clearly_better_than_nominal_says_so_in_its_file(
    changed, asked, example, tmp_path: Path, capsys
) -> None:
    gain = asked[0].answer.gain.model_dump()
    opened, identity = changed(gain=gain | {"low": -0.1})
    told = opened.export_ranges(identity, tmp_path / "unclear.toml")
    assert told.reliable and told.warning.startswith("No simulator here is clearly better than nominal")
    assert f"# WARNING: {told.warning}" in (tmp_path / "unclear.toml").read_text(encoding="utf-8")
    example.read(tmp_path / "unclear.toml")
    assert told.warning in capsys.readouterr().out
    assert not opened.export_ranges("secret 1", tmp_path / "clear.toml").warning


def test_an_unended_search_gives_no_reliable_ranges(changed, tmp_path: Path) -> None:
    opened, identity = changed(fits=None, misfit=34.0, misfit_limit=1.5, alarm=None)
    told = opened.export_ranges(identity, tmp_path / "unended.toml")
    assert not told.reliable and "the search had not ended" in told.warning


def test_a_recording_means_its_newest_result(changed, tmp_path: Path) -> None:
    opened, identity = changed(k=2)
    assert opened.export_ranges("secret 0", tmp_path / "a.toml").result == identity
    assert opened.export_ranges("@answer", tmp_path / "b.toml").result == identity


def test_what_is_no_posterior_is_refused(servos, asked, changed, tmp_path: Path) -> None:
    taken = tmp_path / "taken.toml"
    taken.write_text("mine")
    with pytest.raises(UsageError, match=r"taken\.toml"):
        servos.export_ranges("secret 0", taken)
    assert taken.read_text() == "mine"
    servos.ingest(secret_servo.record(secret_servo.values_of(70), 70, steps=50), "servo_pendulum", name="new")
    calibration = servos.calibrate("new", method="random", budget=2)
    assert calibration.method == "random"
    with pytest.raises(NoMatchError, match="no query or diagnosis"):
        servos.export_ranges("new", tmp_path / "none.toml")
    other = servos.registry.latest("calibration").id
    with pytest.raises(UsageError, match="'calibration'"):
        servos.export_ranges(other, tmp_path / "none.toml")
    opened, identity = changed(synthesised=None)
    with pytest.raises(NoMatchError, match="made no simulator"):
        opened.export_ranges(identity, tmp_path / "none.toml")
    assert not (tmp_path / "none.toml").exists()


def test_a_model_without_an_effect_is_not_trained_on_unless_that_is_asked_for(
    diagnosed, example, tmp_path: Path, capsys
) -> None:
    """The parameters made room for the effect: without it they are another robot's."""
    path = tmp_path / "ranges.toml"
    told = diagnosed.export_ranges("load_friction", path)
    assert told.reliable and not told.complete_in_model and told.incomplete.startswith("load_friction: ")
    assert "the ranges of a query" in told.incomplete and told.incomplete in tables_text(told)
    text = path.read_text(encoding="utf-8")
    assert "`at_bound` tells of `value` alone" in text and "`centre` is the middle of the draws" in text
    assert f"# WARNING: {told.incomplete}" in text and tomllib.loads(text)["complete_in_model"] is False
    with pytest.raises(ValueError, match="no field of a MuJoCo model"):
        example.read(path)
    assert example.read(path, without_effects=True)["incomplete"] == told.incomplete
    assert "not applied: load_friction" in capsys.readouterr().out
    whole = diagnosed.export_ranges("payload", tmp_path / "whole.toml")
    assert whole.complete_in_model and not whole.incomplete
    example.read(tmp_path / "whole.toml")


def test_the_example_refuses_what_does_not_go_together_in_one_line(
    diagnosed, example, tmp_path: Path
) -> None:
    """Another robot's model, a file that is missing, and one of something else."""
    file, other = str(tmp_path / "ranges.toml"), str(load_robot("quadruped").folder / "model.xml")
    diagnosed.export_ranges("payload", file)
    (tmp_path / "wrong.toml").write_text("a = 1")
    for words, told in (
        ((file, other), "another model"),
        ((str(tmp_path / "none.toml"), other), "none.toml"),
        ((file, str(tmp_path / "none.xml")), "none.xml"),
        ((str(tmp_path / "wrong.toml"), other), "no file of"),
    ):
        with pytest.raises(SystemExit, match=told) as refused:
            example.main(list(words))
        assert "\n" not in str(refused.value)


def tables_text(told: RangesFile) -> str:
    """What the command prints of a file."""
    console = Console(width=1000, record=True, file=StringIO())
    console.print(tables(told))
    return console.export_text()
