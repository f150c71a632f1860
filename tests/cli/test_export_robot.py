"""`dynreg export ID --as robot`, on a real registry."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from dynreg import session
from dynreg.cli.schemas import model_of
from dynreg.sim.config import SimConfig
from dynreg.sim.robot import load_robot


@pytest.fixture
def stored(registry_folder: Path, tmp_path: Path, monkeypatch) -> tuple[Path, str]:
    """A registry, and the id of a simulator with effects in it."""
    monkeypatch.chdir(tmp_path)
    robot = load_robot("servo_pendulum")
    effects = {"load_friction": {"coefficient": 0.2}, "payload": {"share": 0.1}}
    values = robot.space.as_dict(robot.space.nominal) | {"tip_mass": 0.51}
    config = SimConfig(robot.hash, robot.name, values, effects).as_dict()
    folder = shutil.copytree(registry_folder, tmp_path / "registry")
    with session.open(folder) as opened:
        return folder, opened.registry.put_simulator(config | {"lineage": {"made_by": "diagnose"}})


@pytest.fixture
def put_simulator(stored) -> Callable[[dict], str]:
    """Stores a nominal servo with effects, and returns its id."""

    def put(effects: dict) -> str:
        robot = load_robot("servo_pendulum")
        config = SimConfig(robot.hash, robot.name, robot.space.as_dict(robot.space.nominal), effects)
        with session.open(stored[0]) as opened:
            return opened.registry.put_simulator(config.as_dict())

    return put


def test_a_simulator_becomes_a_robot_that_can_be_used(stored, dynreg, tmp_path: Path) -> None:
    registry, identity = stored
    ended = dynreg("export", identity[:12], "--as", "robot", "--to", "taken", "--registry", registry)
    assert (ended.status, ended.err) == (0, "")
    assert (
        "effect_payload" in ended.out and "load_friction" in ended.out and "robots check taken" in ended.out
    )
    assert max(map(len, ended.out.splitlines())) <= 100
    made = load_robot(tmp_path / "taken")
    assert made.space.as_dict(made.space.nominal)["tip_mass"] == 0.51
    told = (tmp_path / "taken" / "README.md").read_text(encoding="utf-8").splitlines()[0]
    assert told == f"# servo_pendulum, simulator {identity[:12]}" and made.name.endswith(f"_{identity[:8]}")
    assert dynreg("show", made.name.rpartition("_")[2], "--registry", registry).status == 0
    assert dynreg("robots", "check", "taken").status == 0


def test_an_effect_in_neither_file_is_told_loudly(stored, dynreg) -> None:
    registry, identity = stored
    ended = dynreg("export", identity, "--as", "robot", "--to", "taken", "--registry", registry, "--quiet")
    told = " ".join(ended.out.split())
    assert "warning: load_friction is in neither file: the exported robot does not have it." in told
    assert f"dynreg compare RECORDING --with nominal,{identity[:12]}" in told and "dynreg effects" in told
    assert told.count("warning:") == 1 and "payload is in" not in told
    ended = dynreg("export", identity, "--as", "robot", "--to", "again", "--registry", registry, "--json")
    assert json.loads(ended.out)["warning"].startswith("load_friction is in neither file")


def test_an_effect_that_robot_toml_lacks_is_told_and_one_that_both_have_is_not(
    stored, dynreg, put_simulator
) -> None:
    registry, _ = stored
    pushed = put_simulator({"force_offset": {"torque": 0.05}})
    ended = dynreg("export", pushed, "--as", "robot", "--to", "pushed", "--registry", registry)
    assert "warning: force_offset is in mujoco.xml alone" in " ".join(ended.out.split())
    whole = put_simulator({"payload": {"share": 0.1}})
    ended = dynreg("export", whole, "--as", "robot", "--to", "whole", "--registry", registry)
    assert "warning" not in ended.out


def test_which_file_to_open_is_told(stored, dynreg) -> None:
    registry, identity = stored
    ended = dynreg("export", identity, "--as", "robot", "--to", "taken", "--registry", registry)
    told, model = " ".join(ended.out.split()), Path("taken") / "model.xml"
    assert f"In plain MuJoCo open {Path('taken') / 'mujoco.xml'}. {model} is the uncorrected model" in told
    assert ended.out.endswith("\n")


def test_a_result_means_the_simulator_that_it_recommends(stored, dynreg) -> None:
    registry, identity = stored
    with session.open(registry) as opened:
        recording = opened.show("bench").id
        found = {"calibrated_simulator": None, "extended_simulator": identity}
        opened.registry.put_result("diagnosis", recording, found)
        result = opened.registry.latest("diagnosis").id
        opened.registry.put_result("drift", recording, {})
        none = opened.registry.latest("drift").id
    for number, ref in enumerate(("diagnosed", result[:12])):
        to = f"taken{number}"
        ended = dynreg("export", ref, "--as", "robot", "--to", to, "--registry", registry, "--json")
        assert json.loads(ended.out)["simulator"] == identity
    ended = dynreg("export", none, "--as", "robot", "--to", "taken", "--registry", registry)
    assert ended.status == 4 and "tells no simulator" in ended.err


def test_without_a_calibration_the_word_names_what_a_diagnosis_calibrated(stored, dynreg) -> None:
    registry, identity = stored
    line = ("export", "calibrated", "--as", "robot", "--to", "taken", "--registry", registry)
    assert f"run `dynreg calibrate --registry {registry}`" in dynreg(*line).err
    with session.open(registry) as opened:
        found = {"calibrated_simulator": identity, "extended_simulator": None}
        opened.registry.put_result("diagnosis", opened.show("bench").id, found)
    ended = dynreg(*line)
    assert ended.status == 0 and f"simulator {identity[:12]}" in ended.out


def test_json_is_one_document_that_fits_its_schema(stored, dynreg) -> None:
    registry, identity = stored
    ended = dynreg("export", identity, "--as", "robot", "--to", "taken", "--registry", registry, "--json")
    document = json.loads(ended.out)
    model = model_of(document["schema"])
    assert json.loads(model.model_validate(document).to_json()) == document
    assert document["simulator"] == identity and document["mjcf"] == str(Path("taken") / "mujoco.xml")
    told = {effect["effect"]: effect for effect in document["effects"]}
    assert told["load_friction"]["values"] == {"coefficient": 0.2} and not told["load_friction"]["parameters"]
    assert not told["load_friction"]["mjcf"] and told["payload"]["mjcf"]


def test_an_entry_of_a_population_can_be_taken_too(stored, dynreg, tmp_path: Path) -> None:
    registry, _ = stored
    with session.open(registry) as opened:
        (population,) = opened.registry.populations()
        entry = opened.registry.load(population.id, ()).ids[3]
        values = opened.registry.load_entry(entry).values
    assert dynreg("export", entry, "--as", "robot", "--to", "taken", "--registry", registry).status == 0
    space = load_robot(tmp_path / "taken").space
    assert space.as_dict(space.nominal) == values


def test_the_form_is_a_registry_unless_asked(stored, dynreg, tmp_path: Path) -> None:
    registry, identity = stored
    for number, more in enumerate(((), ("--as", "registry"))):
        assert dynreg("export", identity, "--to", f"copy{number}", "--registry", registry, *more).status == 0
        with session.open(tmp_path / f"copy{number}", create=False) as copy:
            assert copy.show(identity).kind == "simulator"


@pytest.mark.parametrize(
    "line, status, says",
    [
        ("bench --as robot --to taken", 4, "bench"),
        ("ID ID --as robot --to taken", 2, "--as robot with 2 things"),
        ("ID --as robot --to registry", 2, "not taken"),
        ("ID --as toaster --to taken", 2, "toaster"),
    ],
)
def test_what_cannot_be_is_one_line(
    line: str, status: int, says: str, stored, dynreg, tmp_path: Path
) -> None:
    registry, identity = stored
    arguments = line.replace("ID", identity).split()
    ended = dynreg("export", *arguments, "--registry", registry)
    assert ended.status == status and ended.out == "" and says in ended.err and ended.err.count("\n") == 1
    assert not (tmp_path / "taken").exists()


def test_a_recording_is_no_simulator_and_what_to_name_is_said(stored, dynreg) -> None:
    for name in ("@last", "bench"):
        ended = dynreg("export", name, "--as", "robot", "--to", "taken", "--registry", stored[0])
        assert ended.status == 4 and f"'{name}' is a recording here, and no simulator" in ended.err
        assert "name one, such as diagnosed" in ended.err
