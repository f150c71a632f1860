"""The hidden quadruped: its logs against its own recordings, its trials, and gaits that are not its own."""

import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from dynreg.data.readers import read_log as raw_log
from dynreg.data.recording import Recording
from dynreg.gait.space import gait_space
from dynreg.gait.tasks import progress
from dynreg.sim.excitation import excitation
from dynreg.sim.real import Spent
from dynreg.sim.robot import Robot, load_robot
from dynreg.verbs.subjects import read_log

EXAMPLES = Path(__file__).parents[1] / "examples"
SEED, EPISODES, RATE = 4, 3, 36.0  # the first two draws of this seed cannot walk


@pytest.fixture(scope="module")
def example() -> Iterator[ModuleType]:
    """The script as a module."""
    from importlib import import_module

    sys.path.insert(0, str(EXAMPLES))
    yield import_module("hidden_quadruped")
    sys.path.remove(str(EXAMPLES))


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("quadruped")


@pytest.fixture(scope="module")
def made(example, tmp_path_factory: pytest.TempPathFactory):
    return example.record(tmp_path_factory.mktemp("hidden") / "robot", seed=SEED, episodes=EPISODES)


@pytest.fixture(scope="module")
def own(example, robot) -> list[Recording]:
    """What the same robot's door tells of the same trials."""
    told = excitation(robot, seed=SEED, name="hidden_quadruped", episodes=EPISODES).actions
    real = example.hidden_robot(SEED)
    return [real.run(actions, RATE, f"run_{i:02}").recording for i, actions in enumerate(told)]


def trot(robot: Robot, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """Times (T,) [s] and commands (T, A) [rad] of the hand-written trot."""
    space, times = gait_space(robot), np.arange(round(seconds * RATE)) / RATE
    genes = space.feasible(space.from_unit(space.starts[:1]))
    return times, space.targets(genes, times)[0]


def write_csv(path: Path, columns: dict[str, np.ndarray]) -> Path:
    rows = zip(*columns.values(), strict=True)
    lines = [",".join(columns), *(",".join(x if isinstance(x, str) else f"{x:.6f}" for x in r) for r in rows)]
    path.write_text("\n".join(lines) + "\n")
    return path


def same(seen: Recording, own: list[Recording]) -> None:
    """The recording's episodes are those of the others: names, times, every channel."""
    assert len(seen.episodes) == len(own)
    for episode, recording in zip(seen.episodes, own, strict=True):
        (wanted,) = recording.episodes
        assert seen.channels == recording.channels and episode.name == wanted.name
        assert episode.time - episode.time[0] == pytest.approx(wanted.time, abs=1e-6)
        assert episode.values == pytest.approx(wanted.values, abs=1e-6)


def test_its_logs_are_read_back_as_its_own_recordings(made, own, robot) -> None:
    seen = read_log(made.logs, robot, made.log_map)
    same(seen, own)
    assert seen.begins() == pytest.approx([60.0 * trial for trial in range(EPISODES)], abs=1e-6)


def test_its_messages_are_those_of_a_robot(made, own, robot) -> None:
    """Joints by name, in an order that is not robot.toml's; rates of the body about x, y and z."""
    sources, seen = raw_log(made.logs[0]).sources, own[0].episodes[0].values
    channel = lambda name: pytest.approx(seen[:, own[0].names.index(name)], abs=1e-12)  # noqa: E731
    assert sources["/joint_states.position[0]"].values == channel("fl_elbow/position")
    assert sources["/joint_commands.position[rr_hip]"].values == channel("rr_hip/target")
    assert sources["/imu.rpy[1]"].values == channel("base/pitch")
    assert sources["/imu.gyroscope[2]"].values == channel("base/wz")
    assert sources["/odom.twist.twist.linear.x"].values == channel("base/vx")


def test_the_same_seed_gives_the_same_bytes_and_another_another_robot(made, example, tmp_path: Path) -> None:
    again = example.record(tmp_path / "again", seed=SEED, episodes=EPISODES)
    assert [a.read_bytes() for a in again.logs] == [b.read_bytes() for b in made.logs]
    assert again.secret == made.secret
    drawn = np.array([example.hidden_robot(seed).parameters for seed in (3, SEED, 5, 7)])
    assert drawn[1].tolist() == [*made.secret.values()]
    kinds = dict(zip(made.secret, (len({*column}) for column in drawn.T), strict=True))
    assert kinds.pop("action_rate") == 1 and made.secret["action_rate"] == RATE
    assert set(kinds.values()) == {4}


def test_the_secret_is_in_the_ranges_and_in_no_file(made, robot, example, tmp_path, capsys) -> None:
    low, high = robot.space.bounds.T
    values = robot.space.from_dict(made.secret)
    assert ((low <= values) & (values <= high)).all()
    assert sorted(made.logs[0].parent.iterdir()) == sorted(made.logs)
    topics = {"/imu", "/joint_commands", "/joint_states", "/odom"}
    assert {name.split(".")[0] for name in raw_log(made.logs[0]).sources} == topics
    assert example.main([str(tmp_path / "quiet"), "--seed", str(SEED)]) == 0
    assert "torque" not in capsys.readouterr().out


def test_it_can_walk(example, robot) -> None:
    """The hand-written trot brings it ahead at its own door, too."""
    trial = example.hidden_robot(SEED).run(trot(robot, 5.0)[1], RATE)
    assert not trial.fell and progress(trial.walk.base)[0][0, 0] > 0.5


def test_a_gait_is_played_once_on_the_same_robot(example, robot, own, tmp_path: Path, capsys) -> None:
    """Its log is read as the others are; its disturbances are those of the trial after the recorded ones."""
    folder = tmp_path / "robot"
    example.record(folder, seed=SEED, episodes=EPISODES)
    times, told = trot(robot, 1.5)
    columns = dict(zip(robot.actions, told.T, strict=True))
    gait = write_csv(tmp_path / "gait.csv", dict(sorted(columns.items())) | {"time": times})
    command = [str(folder), "--seed", str(SEED), "--play", str(gait)]
    assert example.main(command) == 0
    past = Spent(EPISODES, sum(r.episodes[0].duration for r in own))
    real = example.hidden_robot(SEED, past)
    trial = real.run(told.round(6), RATE, "trial")
    same(read_log(folder / "trial.mcap", robot, example.MAP), [trial.recording])
    ahead, left = (way[0, 0] for way in progress(trial.walk.base))
    out = capsys.readouterr().out
    assert "stood after 1.5 s" in out and f"{ahead:.2f} m ahead, {left:.2f} m left" in out
    assert f"{EPISODES + 1} trials and {real.spent.seconds:.1f} s" in out

    before = (folder / "trial.mcap").read_bytes()
    assert example.main(command) == 2
    assert "trial.mcap' is there already" in capsys.readouterr().err
    assert (folder / "trial.mcap").read_bytes() == before
    assert example.main([str(folder)]) == 2  # nor is a robot recorded over another

    # a trial whose log lies elsewhere is one more, and those there count
    for number in (1, 2):
        log = tmp_path / "trials" / f"trial_{number}_log.mcap"
        assert example.main([*command, "--log", str(log)]) == 0
        assert f"{EPISODES + 1 + number} trials" in capsys.readouterr().out and log.exists()


def test_a_fall_is_told(example, robot, tmp_path: Path, capsys) -> None:
    """Legs that are thrown up at once."""
    told = np.tile(np.array([0.0, 1.5, 1.3]), 4) * np.ones((72, 1))
    table = {"time": np.arange(72) / RATE} | dict(zip(robot.actions, told.T, strict=True))
    gait = write_csv(tmp_path / "gait.csv", table)
    assert example.main([str(tmp_path / "robot"), "--seed", str(SEED), "--play", str(gait)]) == 0
    assert capsys.readouterr().out.startswith("fell after ")


BAD = {
    "missing column": ("rr_elbow/target", None, "has no column of numbers 'rr_elbow/target'"),
    "text": ("rr_elbow/target", ["up"] * 36, "has no column of numbers 'rr_elbow/target'"),
    "another robot": ("tail/target", np.zeros(36), "has a column 'tail/target'"),
    "no time": ("time", None, "has no column that looks like time"),
    "a lost row": ("time", np.delete(np.arange(37), 9) / RATE, "row 10 of 'gait.csv' is at 0.277"),
    "another rate": ("time", np.arange(36) / 50.0, "expected 0.0277778 s: 36 commands a second"),
    "degrees": ("fl_hip/target", np.full(36, 7.0), "row 1 of 'gait.csv' tells fl_hip/target 7 rad"),
    "no number": ("fl_hip/target", np.r_[np.zeros(4), np.nan, np.zeros(31)], "row 5 of 'gait.csv' tells"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_table_that_is_not_its_gait_is_refused_in_one_line(
    name, example, robot, tmp_path: Path, capsys
) -> None:
    times, told = trot(robot, 1.0)
    columns = {"time": times} | dict(zip(robot.actions, told.T, strict=True))
    column, values, said = BAD[name]
    columns = {k: v for k, v in (columns | {column: values}).items() if v is not None}
    gait = write_csv(tmp_path / "gait.csv", columns)
    assert example.main([str(tmp_path / "robot"), "--play", str(gait)]) != 0
    out, err = capsys.readouterr()
    assert said in err and "; expected " in err and err.count("\n") == 1 and not out
    assert not (tmp_path / "robot").exists()  # nothing has moved


def test_folders_and_tables_that_are_none_are_refused(example, tmp_path: Path, capsys) -> None:
    assert example.main([str(tmp_path), "--play", str(tmp_path / "none.csv")]) != 0
    assert "there is no log" in capsys.readouterr().err
    (tmp_path / "file").touch()
    assert example.main([str(tmp_path / "file")]) == 2
    assert "cannot make folder" in capsys.readouterr().err
