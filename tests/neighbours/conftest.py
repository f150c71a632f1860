"""A small registry of the servo bench and secret servos that were asked about in it, made once."""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import secret_servo
from secret_servo import ENTRIES, TRAINING

from dynreg import session
from dynreg.data.recording import Recording
from dynreg.evidence.truth import hide, log_of, protocol
from dynreg.results import Neighbours
from dynreg.session import Session
from dynreg.sim.effects import term
from dynreg.sim.robot import load_robot

SECRETS = 6
EXAMPLES = Path(__file__).parents[2] / "examples"


@dataclass(frozen=True)
class Asked:
    """One secret servo, its recording, and what a query said of it."""

    values: np.ndarray
    recording: Recording
    answer: Neighbours


@pytest.fixture(scope="session")
def populated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A registry with 24 linked simulators in one shard; work on copies of it to change them."""
    path = tmp_path_factory.mktemp("servos") / "registry"
    with session.open(path) as opened:
        opened.populate("servo_pendulum", ENTRIES, training=TRAINING)
    return path


@pytest.fixture(scope="session")
def servos(populated: Path) -> Iterator[Session]:
    """The registry, open; tests may add recordings and results."""
    with session.open(populated, create=False) as opened:
        yield opened


@pytest.fixture(scope="session")
def asked(servos: Session) -> list[Asked]:
    """Secret servos with their answers."""
    out = []
    for seed in range(SECRETS):
        values = secret_servo.values_of(seed)
        recording = secret_servo.record(values, seed)
        known = servos.ingest(recording, "servo_pendulum", name=f"secret {seed}")
        out.append(Asked(values, recording, servos.query(known)))
    return out


@pytest.fixture(scope="session")
def example() -> Iterator[ModuleType]:
    sys.path.insert(0, str(EXAMPLES))
    yield import_module("randomise_mjmodel")
    sys.path.remove(str(EXAMPLES))


@pytest.fixture(scope="session")
def diagnosed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    """A registry with diagnoses of servos that hide one effect, by its name."""
    robot = load_robot("servo_pendulum")
    plan = protocol(robot, seed=1, seconds=20.0)
    with session.open(tmp_path_factory.mktemp("diagnosed") / "registry") as opened:
        for key in ("payload", "load_friction"):
            log = log_of(robot, hide(robot, (term(key),), "strong", 11), plan)
            opened.ingest(log, "servo_pendulum", name=key)
            assert opened.diagnose(key, effects=(key, "cogging"), threshold_runs=0).verdict == "named"
        yield opened
