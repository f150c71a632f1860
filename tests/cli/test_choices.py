"""A setting with a choice that there is not is misuse, wherever it is found out: exit status 2, and the choices."""

import re
import shutil
from pathlib import Path

import pytest


@pytest.mark.parametrize(
    "line, choice",
    [
        ("diagnose bench --engine bullet", "joint"),
        ("trial servo_pendulum --engine bullet", "joint"),
        ("populate leg -n 2 --ranges bullet", "no named ranges"),
        ("query bench --distance bullet", "one_sided"),
        ("query bench --hold-out bullet", "kp=400"),
        ("calibrate bench --method bullet", "cma"),
        ("compare bench --models bullet", "kinematic"),
        ("diagnose bench --effects bullet", "dynreg effects"),
        ("trial servo_pendulum --effect bullet", "dynreg effects"),
        ("trial servo_pendulum --size bullet", "weak"),
        ("trial servo_pendulum --truth bullet", "independent"),
        ("trial servo_pendulum --physics bullet", "other"),
        ("trial servo_pendulum --truth independent --effect bullet", "stribeck_friction"),
        ("excite servo_pendulum --for payload,bullet -o next.csv", "dynreg effects"),
        ("excite servo_pendulum --for payload,backlash -o next.bullet", ".csv"),
        ("gait bench --film next.bullet", ".gif"),
        ("export bench --as bullet --to next", "robot"),
        ("list --kind bullet", "recording"),
    ],
)
def test_a_choice_that_there_is_not_is_misuse(
    line: str, choice: str, dynreg, registry_folder: Path, tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(registry_folder, "registry")
    ended = dynreg(*line.split(), "--registry", "registry")
    assert ended.status == 2 and ended.out == "", ended.err
    assert re.fullmatch(r"error: .*bullet.*; expected .+; .+\n", ended.err) and choice in ended.err


def test_a_form_that_there_is_not_is_told_as_other_choices_are(dynreg, tmp_path: Path) -> None:
    for told in (["--as", "hdf5"], ["--as=hdf5"]):
        ended = dynreg("export", "bench", *told, "--to", str(tmp_path / "next"))
        assert ended.status == 2 and ended.err.startswith(
            "error: --as 'hdf5'; expected one of registry, robot, "
        )
        assert ended.err.endswith("; choose one of these\n") and "Value error" not in ended.err
