"""The demo and the Python example, end to end on the hidden servo; the hidden servo itself."""

import re
import sys
from collections.abc import Iterator
from functools import partial
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


@pytest.fixture
def quick_training(monkeypatch: pytest.MonkeyPatch) -> None:
    """Entries whose models are trained for a moment: the demo's story does not need better ones."""
    from dynreg.distance import population

    quick = partial(population.Training, epochs=1, base_configurations=16, base_epochs=3)
    monkeypatch.setattr(population, "Training", quick)


def test_the_demo_from_an_empty_folder_to_the_cause_and_its_page(
    examples, quick_training, tmp_path: Path, monkeypatch, capsys
) -> None:
    """Every command line ends well, the hidden effect is named, and the secret is shown beside it.

    Then the Python example and the picture on the registry that the demo made.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DYNREG_REGISTRY", "elsewhere")
    options = ["--n", "24", "--hidden", "--seconds", str(SECONDS), "--folder", str(tmp_path / "demo")]
    assert examples["demo"].main([*options, "--effects", "load_friction,backlash"]) == 0
    out = capsys.readouterr().out
    verbs = ["populate", "ingest", "query", "diagnose", "report"]
    assert [line.split()[2] for line in out.splitlines() if line.startswith("$ dynreg")] == verbs
    with dynreg.open("demo/registry", create=False) as registry:
        found, answer = registry.result("@last"), registry.show("@answer").id
    assert [cause.effect for cause in found.causes] == ["load_friction"]
    secret, _, closing = out.rpartition("$ dynreg report")[2].partition("Cause: ")
    assert closing.startswith("load_friction (") and closing.endswith(
        "Look at demo/report.html in a browser.\n"
    )
    assert found.error.extended < 0.5 * found.error.nominal
    assert f"{found.error.nominal:.3g} rad (nominal)" in closing and "with the cause." in " ".join(
        closing.split()
    )
    assert re.search(r"^  load_friction +0.15 +0.1", secret, re.MULTILINE)
    assert all(f"\n  {name} " in secret for name in found.parameters)
    assert (tmp_path / "demo" / "report.html").stat().st_size > 10_000
    assert not Path("elsewhere").exists()

    examples["make_picture"].main(["demo/registry", "--out", "story.png"])
    assert Path("story.png").read_bytes().startswith(b"\x89PNG")
    logs = sorted(str(p) for p in (tmp_path / "demo" / "hidden").glob("*.mcap"))
    shared = ["--registry", "demo/registry", "--map", str(examples["hidden_servo"].MAP), "--n", "24"]
    examples["query_in_python"].main([*logs, *shared])
    assert answer[:12] in capsys.readouterr().out


def test_a_command_that_fails_ends_the_demo_with_its_status(examples, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert examples["demo"].main(["--n", "0", "--hidden", "--seconds", "0.5", "--folder", "demo"]) == 2
    assert not Path("demo/report.html").exists()
