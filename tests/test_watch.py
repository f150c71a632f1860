"""A recording beside a simulator to look at: poses and channels on one timeline, files for viewers, and the window."""

import json
import shutil
import weakref
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import mujoco
import numpy as np
import pytest
import tiny_registry

from dynreg import session
from dynreg.data.recording import Channel, Episode, Recording
from dynreg.data.topics import Topic, mcap
from dynreg.errors import UsageError
from dynreg.registry import Registry
from dynreg.sim.config import SimConfig
from dynreg.sim.layout import layout_of, observe
from dynreg.sim.robot import Robot, load_robot, packaged_robots
from dynreg.watch.foxglove import log
from dynreg.watch.frames import MEASURED, REST, SIMULATED, Frames, frames, poses, still
from dynreg.watch.rrd import body_poses, rrd
from dynreg.watch.window import at, draw_ghost, place


@pytest.fixture(scope="module")
def opened(registry_folder: Path, tmp_path_factory: pytest.TempPathFactory):
    folder = tmp_path_factory.mktemp("watch") / "registry"
    shutil.copytree(registry_folder, folder)
    with session.open(folder, create=False) as made:
        yield made


@pytest.fixture(scope="module")
def bench(opened) -> Frames:
    return opened.frames("bench")


def test_what_was_measured_and_simulated_lies_on_one_rising_timeline(opened, bench: Frames) -> None:
    recording = opened.recording("bench")
    assert (np.diff(bench.times) > 0).all()
    assert len(bench.times) == sum(len(e.time) for e in recording.episodes), "the first row of each is there"
    assert bench.times[-1] == pytest.approx(sum(e.duration for e in recording.episodes) + 4 * REST)
    angle = bench.channels["arm/position"]
    assert np.array_equal(bench.poses[MEASURED][:, 0], angle[MEASURED])
    assert np.array_equal(bench.poses[SIMULATED][:, 0], angle[SIMULATED])
    assert angle[MEASURED][0] == recording.episodes[0].values[0, recording.names.index("arm/position")]
    assert np.array_equal(bench.residuals()["arm/position"], angle[SIMULATED] - angle[MEASURED])


def test_a_result_about_no_recording_is_told_from_one_that_is(opened) -> None:
    identity = opened.registry.put_result("trial", None, {})
    with pytest.raises(UsageError, match="is a trial, about no recording; expected a recording, or a result"):
        opened.frames(identity)


def test_another_simulator_moves_otherwise(opened, bench: Frames) -> None:
    recording, robot = opened.recording("bench"), load_robot("servo_pendulum")
    heavy = {**robot.space.as_dict(robot.space.nominal), "tip_mass": 0.9}
    other = frames(robot, recording, SimConfig(robot.hash, robot.name, heavy))
    assert np.array_equal(other.poses[MEASURED], bench.poses[MEASURED])
    assert not np.allclose(other.poses[SIMULATED], bench.poses[SIMULATED])


def test_a_floating_base_stands_as_its_angles_say() -> None:
    robot = load_robot("quadruped")
    layout = layout_of(robot)
    rng = np.random.default_rng(4)
    states = rng.normal(0.0, 0.3, (5, len(robot.channels)))
    found = poses(robot, states)
    again = observe(layout, found, np.zeros((5, robot.model.nv)), len(robot.channels))
    moved = [
        i for i, name in enumerate(robot.channels) if name.endswith(("position", "roll", "pitch", "yaw"))
    ]
    assert len(moved) > 8 and np.allclose(again[:, moved], states[:, moved])


def test_a_base_on_wheels_drives_over_the_ground() -> None:
    robot = load_robot("diffdrive")
    states = np.zeros((2, len(robot.channels)))
    for name, value in (("x", 1.5), ("y", -0.5), ("yaw", np.pi / 2)):
        states[1, robot.channels.index(f"base/{name}")] = value
    where, turned = body_poses(robot.model, poses(robot, states))
    body = int(robot.model.joint("base").bodyid[0])
    assert np.allclose((where[1] - where[0])[body, :2], [1.5, -0.5])
    assert np.allclose(np.abs(turned[1, body]), [np.sqrt(0.5), 0, 0, np.sqrt(0.5)])


def standing(robot: Robot, rows: int, at: dict[str, float]) -> Recording:
    """A recording in which channels and commands have these values, the others 0."""
    names = (*robot.channels, *robot.actions)
    values = np.tile([at.get(name, 0.0) for name in names], (rows, 1))
    units = {c.name: c.unit for c in (*robot.file.channels, *robot.file.actions)}
    time = np.arange(rows) / robot.file.robot.control_rate
    return Recording(tuple(Channel(n, units[n]) for n in names), (Episode("a", time, values),))


@pytest.mark.parametrize("name", ["create", "diffdrive"])
def test_foxglove_gets_the_pose_of_a_base_on_wheels(name: str) -> None:
    robot = load_robot(name)
    places = {"base/x": 1.5, "base/yaw": np.pi / 2}
    found = messages(
        log(frames(robot, standing(robot, 60, places), SimConfig.of(robot, robot.space.nominal)))
    )
    pose = found["/measured/pose"][-1]["pose"]
    assert pose["position"]["x"] == 1.5 and pose["orientation"]["z"] == pytest.approx(np.sqrt(0.5))
    assert len(found["/simulated/pose"]) == len(found["/measured/pose"]) == 60
    assert ("/measured/joint_states" in found) == (name == "diffdrive"), "only this one has wheels as joints"


def test_the_end_of_an_episode_is_simulated_too() -> None:
    robot = load_robot("create")  # whose windows last 10 s
    found = frames(robot, standing(robot, 750, {}), SimConfig.of(robot, robot.space.nominal))
    assert len(found.times) == 750 and all(np.isfinite(poses).all() for poses in found.poses.values())


def test_where_nothing_can_be_simulated_the_measured_robot_is_shown_alone() -> None:
    robot = load_robot("servo_pendulum")
    recording = standing(robot, 100, {"arm/position": 0.3})
    (episode,) = recording.episodes
    values = episode.values.copy()
    values[:40, robot.channels.index("arm/velocity")] = np.nan  # no simulation can begin
    gap = replace(recording, episodes=(replace(episode, values=values),))
    found = frames(robot, gap, SimConfig.of(robot, robot.space.nominal))
    assert len(found.times) == 100 and (found.poses[MEASURED][:, 0] == 0.3).all()
    assert np.flatnonzero(np.isfinite(found.poses[SIMULATED][:, 0])).tolist() == [*range(40, 100)]
    told = messages(log(found))
    assert (len(told["/measured/joint_states"]), len(told["/simulated/joint_states"])) == (100, 60)
    data = mujoco.MjData(found.model)
    place(found, MEASURED, 0, data)
    place(found, SIMULATED, 0, data)
    assert data.qpos[0] == 0.3, "a robot that is not simulated yet stays where it is"


def test_what_was_not_measured_keeps_its_last_value() -> None:
    robot = load_robot("servo_pendulum")
    states = np.full((4, len(robot.channels)), np.nan)
    column = robot.channels.index("arm/position")
    states[1, column], states[3, column] = 0.5, 0.7
    assert poses(robot, states)[:, 0].tolist() == [0.5, 0.5, 0.5, 0.7]


def messages(data: bytes) -> dict[str, list[dict]]:
    from io import BytesIO

    from mcap.reader import make_reader

    out: dict[str, list[dict]] = {}
    for _, channel, message in make_reader(BytesIO(data)).iter_messages():
        out.setdefault(channel.topic, []).append(json.loads(message.data))
    return out


def test_foxglove_gets_both_robots_every_channel_and_its_residual(bench: Frames) -> None:
    found = messages(log(bench))
    topics = {
        "/measured/joint_states",
        "/simulated/joint_states",
        "/channels/arm/position",
        "/channels/arm/velocity",
    }
    assert {*found} == topics and len(found["/measured/joint_states"]) == len(bench.times)
    joints = found["/measured/joint_states"][5]
    assert joints["name"] == ["arm"] and joints["position"] == [bench.poses[MEASURED][5, 0]]
    one = found["/channels/arm/position"][5]
    assert one["residual"] == pytest.approx(one["simulated"] - one["measured"])
    assert log(bench) == log(bench)


def test_a_log_of_many_messages_holds_a_few_of_them_at_a_time() -> None:
    class Kept(dict):
        __hash__ = object.__hash__  # as a thing that can be counted

    alive, most = weakref.WeakSet(), []

    def told(first: float):
        for i in range(200):
            alive.add(message := Kept(measured=float(i)))
            most.append(len(alive))
            yield first + 0.01 * i, message

    topics = [Topic(f"/{name}", "dynreg.Channel", told(t)) for name, t in (("a", 0.5), ("b", 0.0))]
    found = messages(mcap(topics))
    assert max(most) <= 6
    assert {name: [m["measured"] for m in some] for name, some in found.items()} == {
        name: list(range(200)) for name in ("/a", "/b")
    }


def test_export_writes_a_recording_beside_a_simulator(opened, tmp_path: Path, dynreg_line) -> None:
    run = tmp_path / "run.mcap"
    assert dynreg_line("export", "bench", "--as", "foxglove", "--to", run) == 0
    assert "/channels/arm/position" in messages(run.read_bytes())
    assert dynreg_line("export", "bench", "--as", "csv", "--with", "nominal", "--to", tmp_path / "x") == 2
    assert (
        dynreg_line("export", "bench", "--as", "foxglove", "--with", "@answer", "--to", tmp_path / "x") == 4
    )
    assert [p.name for p in tmp_path.iterdir()] == ["run.mcap"]


@pytest.fixture
def dynreg_line(opened):
    from dynreg.cli.main import main

    return lambda *line: main([*map(str, line), "--registry", str(opened.path)])


def test_rerun_gets_both_robots_every_channel_and_its_residual(opened, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="rerun-sdk is not installed: no .rrd is written")
    opened.export_run("bench", tmp_path / "run.rrd", "rerun")
    data = (tmp_path / "run.rrd").read_bytes()
    assert data.startswith(b"RRF") and len(data) > 10_000
    for path in (
        "/measured/tip",
        "/simulated/tip",
        "/channels/arm/position/measured",
        "/residuals/arm/velocity",
    ):
        assert path.encode() in data


def test_a_slash_in_the_name_of_a_body_is_no_step_of_its_path() -> None:
    """Else Rerun would place the body in the frame of another one."""
    pytest.importorskip("rerun", reason="rerun-sdk is not installed: no .rrd is written")
    text = '<body name="arm{}"><joint/><geom size="0.1"/>{}</body>'
    bodies = text.format("", text.format("/link", ""))
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    data = rrd(Frames(model, -1, np.zeros(1), {MEASURED: np.zeros((1, 2))}, {}, {}), "run")
    assert rb"/measured/arm\/link" in data and b"/measured/arm/link" not in data


@pytest.mark.skipif(find_spec("rerun") is not None, reason="rerun-sdk is installed")
def test_without_rerun_one_line_says_how_to_get_it(opened, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"pip install 'dynreg\[rerun\]'"):
        opened.export_run("bench", tmp_path / "run.rrd", "rerun")
    assert not list(tmp_path.iterdir())


def test_without_a_display_a_view_says_what_to_do_instead(dynreg_line, monkeypatch, capsys) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert dynreg_line("view", "bench") == 1
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "no display" in said and "--as rerun" in said


def test_a_robot_is_viewed_without_a_simulator_beside_it(dynreg_line, monkeypatch, capsys) -> None:
    monkeypatch.setenv("DISPLAY", ":0")
    assert dynreg_line("view", "servo_pendulum", "--with", "nominal") == 2
    assert "--with nominal beside robot 'servo_pendulum'" in capsys.readouterr().err


def test_no_simulator_stands_beside_a_gait(opened, tmp_path: Path) -> None:
    identity = opened.registry.put_result("gait", None, {})
    with pytest.raises(UsageError, match="simulator 'nominal' beside gait"):
        opened.frames(identity, "nominal")
    with pytest.raises(UsageError, match="simulator 'nominal' beside gait"):
        opened.export_run(identity, tmp_path / "run.mcap", "foxglove", "nominal")


@pytest.mark.parametrize("seconds", ["0", "-2", "nan", "inf"])
def test_a_view_needs_time(dynreg_line, monkeypatch, capsys, seconds: str) -> None:
    monkeypatch.setenv("DISPLAY", ":0")
    assert dynreg_line("view", "bench", "--seconds", seconds) == 2
    said = capsys.readouterr().err
    assert f"--seconds {seconds}" in said and "above 0" in said


def test_a_view_shows_frames_by_their_times_and_begins_anew(bench: Frames) -> None:
    last = len(bench.times) - 1
    assert at(bench, 0.0) == 0 and at(bench, bench.times[7] + 1e-6) == 7
    assert at(bench, bench.times[-1] - 1e-6) == last - 1
    assert at(bench, bench.times[-1] + bench.times[3] + 1e-6) == 3
    assert at(still(load_robot("servo_pendulum")), 12.0) == 0


def test_the_measured_robot_is_a_pale_copy_in_the_scene(bench: Frames) -> None:
    data = mujoco.MjData(bench.model)
    place(bench, MEASURED, 9, data)
    assert data.qpos[0] == bench.poses[MEASURED][9, 0]
    scene = mujoco.MjvScene(bench.model, maxgeom=100)
    draw_ghost(bench.model, data, scene)
    moving = int((bench.model.geom_bodyid > 0).sum())
    assert scene.ngeom == moving and all(g.rgba[3] < 1.0 for g in scene.geoms[: scene.ngeom])


def test_the_simulator_begins_where_the_measurement_does() -> None:
    robot = load_robot("servo_pendulum")
    time = np.arange(50) / 100.0
    names = (*robot.channels, *robot.actions)
    values = np.zeros((50, len(names)))
    values[:, names.index("arm/position")] = values[:, len(robot.channels)] = 0.3
    recording = Recording(
        tuple(Channel(n, "1") for n in names), (Episode("a", time, values), Episode("b", time, values))
    )
    found = frames(robot, recording, SimConfig.of(robot, robot.space.nominal))
    assert found.poses[SIMULATED][0, 0] == 0.3 and found.times[-1] == pytest.approx(0.98 + REST)


def test_a_rest_of_hours_between_two_logs_is_cut_short() -> None:
    robot = load_robot("servo_pendulum")
    names = (*robot.channels, *robot.actions)
    episodes = tuple(
        Episode(name, begin + np.arange(50) / 100.0, np.zeros((50, len(names))))
        for name, begin in (("a", 0.0), ("b", 1.0), ("c", 9000.0))
    )
    recording = Recording(tuple(Channel(n, "1") for n in names), episodes)
    found = frames(robot, recording, SimConfig.of(robot, robot.space.nominal))
    assert np.diff(found.times).max() == pytest.approx(REST, abs=0.02)
    assert found.times[-1] == pytest.approx(1.49 + REST + 0.49, abs=0.03), "a rest of half a second stays"


def test_a_diagnosis_made_with_another_version_is_shown_with_that_version(tmp_path: Path) -> None:
    """A result's simulator brings its robot, where the recording fits it."""
    source = packaged_robots()["servo_pendulum"]
    folder = tmp_path / "newer"
    shutil.copytree(source, folder)
    (folder / "robot.toml").write_text(
        (source / "robot.toml").read_text(encoding="utf-8") + "# heavier\n", encoding="utf-8"
    )
    (tmp_path / "bench.csv").write_text(tiny_registry.bench_csv(), encoding="utf-8")
    other = load_robot(folder)
    with session.open(tmp_path / "registry") as made, Registry.open(made.path) as registry:
        made.ingest(tmp_path / "bench.csv", "servo_pendulum", name="bench")
        registry.put_robot(other.files, other.hash, other.name)
        simulator = registry.put_simulator(SimConfig.of(other, other.space.nominal).as_dict())
        document = {"calibrated_simulator": simulator, "extended_simulator": None}
        ref = registry.put_result("diagnosis", "bench", document)
        assert len(made.frames(ref).times) > 100
