"""Gaits of other families, from a recording to a file: the document's table plays them all."""

import runpy
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import toy_dog
from mcap.reader import make_reader

from dynreg import session
from dynreg.gait.play import commands
from dynreg.gait.space import gait_space
from dynreg.gait.tasks import task_of
from dynreg.report.html import page
from dynreg.results import Gait
from dynreg.session import Session
from dynreg.sim.real import SimulatedRobot
from dynreg.sim.robot import Robot, load_robot

MORE = '[[motions]]\nname = "kick"\n[[tasks]]\nname = "kick"\nmotion = "kick"\nseconds = 1.5\n'
KINDS = {"forward": "locus", "kick": "poses"}


@pytest.fixture(scope="module")
def dog(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    walking = toy_dog.walking().replace("seconds = 10.0", "seconds = 1.5")
    return load_robot(toy_dog.folder(tmp_path_factory.mktemp("robots") / "dog", walking, MORE))


@pytest.fixture(scope="module")
def opened(dog: Robot, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    still = np.tile(gait_space(dog).pose, (30, 1))
    log = SimulatedRobot(dog, dog.space.nominal, seed=1).run(still, dog.rate).recording
    with session.open(tmp_path_factory.mktemp("families") / "registry") as made:
        made.ingest(log, dog, name="log")
        yield made


@pytest.fixture(scope="module")
def found(opened: Session) -> dict[str, Gait]:
    return {task: opened.gait("log", on="nominal", task=task, rollouts=22, threads=1) for task in KINDS}


@pytest.mark.parametrize("task", KINDS)
def test_the_table_of_the_document_is_what_its_genes_tell(task: str, found, opened: Session, dog) -> None:
    gait = found[task]
    space = gait_space(dog, task_of(dog, task).motion)
    genes = space.from_dict({name: g.value for name, g in gait.genes.items()})
    times, told = commands(gait)
    assert gait.kind == KINDS[task] and space.problems(genes) == ()
    assert np.allclose(told, space.targets(genes[None], times)[0], atol=1e-9)
    later = np.arange(400) / 40.0
    assert np.allclose(
        space.faded(space.table(genes).at(later), later) if space.ramp else space.table(genes).at(later),
        space.targets(genes[None], later)[0],
        atol=1e-9,
    )
    assert (gait.frequency is None) == (task == "kick") and gait.ramp == space.ramp
    assert Gait.model_validate_json(gait.to_json()) == gait


@pytest.mark.parametrize("task", KINDS)
def test_every_form_of_export_holds_the_same_commands(
    task: str, found, opened: Session, tmp_path, monkeypatch
) -> None:
    gait, drawn = found[task], {}
    times, told = commands(gait)
    monkeypatch.setattr(
        "dynreg.verbs.export_gait.draw", lambda model, poses, rate, at, form: drawn.update(at=at) or b"drawn"
    )
    for form in ("csv", "mcap", "python", "foxglove", "gif", "png"):
        opened.export_gait(gait, tmp_path / f"gait.{form}", form)
    table = np.genfromtxt(tmp_path / "gait.csv", delimiter=",", skip_header=1)
    assert np.allclose(table[:, 1:], told, atol=1e-6)
    assert np.allclose(angles(tmp_path / "gait.mcap"), told) and len(drawn["at"]) == 4
    assert np.allclose(angles(tmp_path / "gait.foxglove"), told, atol=1e-9)
    module = runpy.run_path(str(tmp_path / "gait.python"))
    names = [action.action.split("/")[0] for action in gait.joints]
    said = np.array([[module["targets"](t)[name] for name in names] for t in times])
    assert np.allclose(said, told)
    moved = []
    clock = [0.0]
    module["play"](lambda _, angle: moved.append(angle), 3.0, lambda: clock[0], lambda s: None)
    assert np.allclose(moved[-len(names) :], [j.rest for j in gait.joints])


def angles(path: Path) -> np.ndarray:
    import json

    with open(path, "rb") as file:
        messages = [(c.topic, json.loads(m.data)) for _, c, m in make_reader(file).iter_messages()]
    return np.array([m["position"] for topic, m in messages if topic == "/joint_commands"])


def test_the_run_of_a_document_is_simulated_to_the_last_bit(found, opened: Session, tmp_path) -> None:
    for task, gait in found.items():
        frames = opened.registry.put_result("gait", gait.recording, gait.to_dict())
        poses = opened.frames(frames).poses["simulated"]
        trial = gait.trials[0]
        steps = np.round(np.array(trial.time) * gait.rate).astype(int)
        assert np.array_equal(poses[steps, :2], np.stack([trial.x, trial.y], axis=1)), task


def test_a_page_is_drawn_of_each(found) -> None:
    for task, gait in found.items():
        text = page(gait)
        assert ("steps a second" in text) == (task == "forward") and "fl_knee/target" in text
