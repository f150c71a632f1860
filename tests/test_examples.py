"""The demo and the Python example, end to end on the hidden servo; the hidden servo itself."""

import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import dynreg

EXAMPLES = Path(__file__).parents[1] / "examples"
SECONDS = 2.0  # of each run: a third of the real ones


@pytest.fixture(scope="module")
def examples() -> Iterator[dict[str, ModuleType]]:
    """The scripts as modules."""
    from importlib import import_module

    sys.path.insert(0, str(EXAMPLES))
    yield {name: import_module(name) for name in ("hidden_servo", "demo", "query_in_python", "make_picture")}
    sys.path.remove(str(EXAMPLES))


@pytest.fixture(scope="module")
def servo(examples: dict[str, ModuleType], tmp_path_factory: pytest.TempPathFactory):
    return examples["hidden_servo"].record(tmp_path_factory.mktemp("servo"), seconds=SECONDS)


def test_the_hidden_servo_is_the_same_for_the_same_seed(servo, examples, tmp_path: Path) -> None:
    again = examples["hidden_servo"].record(tmp_path / "again", seconds=SECONDS)
    assert [a.read_bytes() for a in servo.logs] == [b.read_bytes() for b in again.logs]
    other = examples["hidden_servo"].record(tmp_path / "other", seed=8, seconds=SECONDS)
    assert other.secret != servo.secret


def test_its_logs_are_read_by_the_map_beside_it(servo, examples) -> None:
    """Sixteen runs at four gains; the torque goes off in the drops alone; readings are coarse and noisy."""
    from dynreg.verbs.subjects import read_log

    robot = dynreg.load_robot("servo_pendulum")
    recording = read_log(servo.logs, robot, servo.log_map)
    assert len(recording.episodes) == 16
    assert {e.settings["kp"] for e in recording.episodes} == {100.0, 200.0, 400.0, 800.0}
    target, position, enabled = recording.columns(["arm/target", "arm/position", "arm/enabled"])
    for episode in recording.episodes:
        time, values = episode.time - episode.time[0], episode.values
        wanted = examples["hidden_servo"].commands(np.arange(0.0, SECONDS, 0.005))
        assert np.isclose(values[0, target], wanted[episode.name.split("_")[0]][0][0])
        assert (values[:, enabled].min() < 0.5) == episode.name.startswith("drop")
        assert time[-1] == pytest.approx(SECONDS, abs=0.02)
        assert np.abs(values[:, position]).max() < np.pi


def test_its_secret_lies_within_the_ranges_and_is_no_nominal_model(servo) -> None:
    for parameter in dynreg.load_robot("servo_pendulum").space.parameters:
        assert parameter.low < servo.secret[parameter.name] < parameter.high
        assert servo.secret[parameter.name] != pytest.approx(parameter.nominal, abs=1e-9)


def test_the_demo_from_an_empty_folder_to_the_page(examples, tmp_path: Path, monkeypatch, capsys) -> None:
    """Every command line ends well, the answer beats the nominal model, and the secret is shown at the end.

    Then the Python example and the picture on the registry that the demo made.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DYNREG_REGISTRY", "elsewhere")
    options = ["--n", "48", "--hidden", "--seconds", str(SECONDS), "--folder", str(tmp_path / "demo")]
    assert examples["demo"].main(options) == 0
    out = capsys.readouterr().out
    verbs = ["populate", "ingest", "list", "query", "show", "report"]
    assert [line.split()[2] for line in out.splitlines() if line.startswith("$ dynreg")] == verbs
    with dynreg.open("demo/registry", create=False) as registry:
        found = registry.result("@last")
    assert found.recording_name == "hidden" and found.gain.value > 0.5
    closing = " ".join(out.rpartition("$ dynreg report")[2].split())
    assert f"use the synthesised simulator {found.answer[:12]}" in closing
    assert closing.endswith("Look at demo/report.html in a browser.")
    assert all(f"\n  {name} " in out for name in found.answer_parameters)
    assert (tmp_path / "demo" / "report.html").stat().st_size > 10_000
    assert not Path("elsewhere").exists()

    logs = sorted(str(p) for p in (tmp_path / "demo" / "hidden").glob("*.mcap"))
    shared = ["--registry", "demo/registry", "--map", str(examples["hidden_servo"].MAP), "--n", "48"]
    examples["query_in_python"].main([*logs, *shared])
    assert f"use synthesised simulator {found.answer[:12]}" in capsys.readouterr().out
    examples["make_picture"].main(["demo/registry", "--out", "query.png"])
    assert Path("query.png").read_bytes().startswith(b"\x89PNG")


def test_a_command_that_fails_ends_the_demo_with_its_status(examples, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert examples["demo"].main(["--n", "0", "--hidden", "--seconds", "0.5", "--folder", "demo"]) == 2
    assert not Path("demo/report.html").exists()
