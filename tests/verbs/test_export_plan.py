"""A stored plan becomes a file of commands, and nothing else does."""

import subprocess
import sys
from pathlib import Path

import made_up_navigation
import pytest

import dynreg
from dynreg.errors import NoMatchError, UsageError
from dynreg.session import Session


@pytest.fixture
def stored(tmp_path: Path) -> tuple[Session, str, str]:
    """A registry with a plan and a result of another kind, and their ids."""
    plan = made_up_navigation.navigation()
    with dynreg.open(tmp_path / "registry") as session:
        put = session.registry.put_result
        yield session, put("navigation", None, plan.model_dump(mode="json")), put("other", None, {"x": 1})


def test_a_stored_plan_is_written_as_its_csv_to_a_new_file(stored, tmp_path: Path) -> None:
    session, plan, other = stored
    path = tmp_path / "plan.csv"
    assert session.export_plan(plan[:10], path) == made_up_navigation.navigation()
    assert path.read_text() == made_up_navigation.navigation().csv
    with pytest.raises(UsageError, match="exists already"):
        session.export_plan(plan, path)
    with pytest.raises(UsageError, match="of kind 'other'; expected a plan of `dynreg navigate`"):
        session.export_plan(other, tmp_path / "other.csv")
    with pytest.raises(NoMatchError, match="nothing"):
        session.export_plan("nothing", tmp_path / "other.csv")
    assert not (tmp_path / "other.csv").exists()


def test_the_command_exports_a_plan_by_its_id(stored, tmp_path: Path) -> None:
    _, plan, _ = stored
    line = ["export", plan, "--as", "csv", "--to", "plan.csv", "--registry", str(tmp_path / "registry")]
    code = "from dynreg.cli.main import run; run()"
    done = subprocess.run(
        [sys.executable, "-c", code, *line], capture_output=True, text=True, cwd=tmp_path, timeout=100
    )
    assert done.returncode == 0 and "plan.csv: written" in done.stdout + done.stderr, done.stderr
    assert (tmp_path / "plan.csv").read_text() == made_up_navigation.navigation().csv
