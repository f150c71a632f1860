"""Command lines run in this process, with the exit status and what went to stdout and stderr."""

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import made_up_comparison
import made_up_diagnosis
import made_up_results
import pytest
import tiny_registry

from dynreg.cli.call import Call
from dynreg.cli.main import main
from dynreg.errors import NoMatchError
from dynreg.session import Session
from dynreg.verbs import verify


@dataclass(frozen=True)
class Ended:
    """How a command line ended."""

    status: int
    out: str
    err: str


@dataclass
class RecordedSession:
    """Stands where a session would: answers with made-up results and keeps what it was asked."""

    path: Path
    created: bool = False
    asked: list[tuple] = field(default_factory=list)
    answers: dict = field(default_factory=dict)

    def __enter__(self) -> "RecordedSession":
        return self

    def __exit__(self, *error: object) -> None:
        pass

    @property
    def registry(self) -> "RecordedSession":
        return self

    def __getattr__(self, verb: str) -> Callable:
        def answer(*given: object, **named: object) -> object:
            self.asked.append((verb, given, named))
            found = self.answers[verb]
            if isinstance(found, BaseException):
                raise found
            return found

        return answer


@pytest.fixture
def dynreg(capsys: pytest.CaptureFixture[str]) -> Callable[..., Ended]:
    def run(*arguments: object) -> Ended:
        capsys.readouterr()
        status = main([str(a) for a in arguments])
        return Ended(status, *capsys.readouterr())

    return run


@pytest.fixture
def session(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> RecordedSession:
    """What every verb that opens a registry gets."""
    monkeypatch.chdir(tmp_path)
    for name in [name for name in os.environ if name.startswith("DYNREG_") and name != "DYNREG_DATA_DIR"]:
        monkeypatch.delenv(name)
    made = RecordedSession(Path("unopened"))
    made.answers = {
        "populate": made_up_results.population(),
        "ingest": made_up_results.recording(),
        "query": made_up_results.neighbours(),
        "calibrate": made_up_results.calibration(),
        "compare": made_up_comparison.comparison(),
        "diagnose": made_up_diagnosis.diagnosis(),
        "trial": made_up_diagnosis.trials(),
        "effects": made_up_diagnosis.effects_list(),
        "excite": (made_up_diagnosis.commands(), made_up_diagnosis.experiment()),
        "excite_legs": made_up_diagnosis.protocol(),
        "list": made_up_results.listing(),
        "show": made_up_results.entry(),
        "result": made_up_results.neighbours(),
        "export": made_up_results.listing(),
        "verify": made_up_results.verification(),
        "import_registry": made_up_results.imported(),
        "remove": made_up_results.removal(),
        "collect": made_up_results.collection(),
        "info": made_up_results.information(),
        "robot_folder": NoMatchError("no robot is called that", expected="a name", do="see `dynreg list`"),
        "missing": NoMatchError("'x' is not there", expected="a name", do="see `dynreg list`"),
    }

    def opened(call: Call, create: bool = False) -> RecordedSession:
        made.path, made.created = call.registry, create
        return made

    monkeypatch.setattr(Call, "open", opened)
    for verb in ("effects", "excite", "excite_legs"):  # which need no registry
        monkeypatch.setattr(Session, verb, staticmethod(getattr(made, verb)))
    monkeypatch.setattr(verify, "verification", made.verify)
    (tmp_path / "dynreg-registry").mkdir()
    (tmp_path / "run.csv").write_text(tiny_registry.bench_csv(), encoding="utf-8")
    return made
