"""A small registry of the servo bench and secret servos that were asked about in it, made once."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import secret_servo
from secret_servo import ENTRIES, TRAINING

from dynreg import session
from dynreg.data.recording import Recording
from dynreg.results import Neighbours
from dynreg.session import Session

SECRETS = 6


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
