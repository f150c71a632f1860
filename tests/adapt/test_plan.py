"""A staged plan is read with errors that name the line, and matched to a robot and a recording."""

from pathlib import Path

import numpy as np
import pytest

from dynreg.adapt.plan import StageTable, read_plan, resolved
from dynreg.errors import UsageError

NAMES = ("motor_torque", "motor_gain", "friction")
EPISODES = ("air/sine", "air/square", "walk/slow", "walk/fast")
ALL = np.arange(4)
NONE = np.zeros(3, dtype=bool)


def read(folder: Path, *stages: str) -> tuple[StageTable, ...]:
    path = folder / "plan.toml"
    path.write_text("\n".join(f"[[stages]]\n{stage}" for stage in stages), encoding="utf-8")
    return read_plan(path)


def stage(name: str = "one", **told) -> StageTable:
    return StageTable(**{"name": name, "parameters": ["*"], **told})


def test_patterns_name_parameters_recordings_and_episodes() -> None:
    (one,) = resolved(
        [stage(parameters=["motor_*"], recordings=["walk", "square"])], NAMES, NONE, EPISODES, ALL
    )
    assert one.parameters.tolist() == [0, 1] and one.windows.tolist() == [1, 2, 3]


def test_a_name_with_brackets_names_itself() -> None:
    told = stage(recordings=["walk[1]"])
    (one,) = resolved([told], NAMES, NONE, ("walk[1]", "walk[2]"), np.arange(2))
    assert one.windows.tolist() == [0]


def test_a_first_step_beyond_what_the_searches_take_is_refused() -> None:
    with pytest.raises(ValueError, match="less than or equal to 0.3"):
        stage(step=0.8)


def test_what_is_held_out_or_known_is_in_no_stage() -> None:
    known = np.array([False, True, False])
    (one,) = resolved([stage()], NAMES, known, EPISODES, np.array([0, 3]))
    assert one.parameters.tolist() == [0, 2] and one.windows.tolist() == [0, 3]


def test_stages_may_share_parameters_where_recordings_or_losses_differ() -> None:
    air, ground = stage("air", recordings=["air"]), stage("ground", recordings=["walk"])
    again = stage("again", recordings=["air"], loss="joint")
    assert len(resolved([air, ground, again], NAMES, NONE, EPISODES, ALL)) == 3


@pytest.mark.parametrize(
    ("stages", "says"),
    [
        ([stage(parameters=["mass"])], "'mass', which matches nothing"),
        ([stage(recordings=["kick"])], "'kick', which matches nothing"),
        ([stage("a"), stage("b")], "'a' and 'b' overlap"),
    ],
)
def test_a_plan_that_does_not_fit_says_where(stages: list[StageTable], says: str) -> None:
    with pytest.raises(UsageError, match=says):
        resolved(stages, NAMES, NONE, EPISODES, ALL)


def test_a_stored_plan_may_call_a_search_by_its_former_name() -> None:
    assert stage(search="genetic").search == "ga" == stage(search="ga").search


def test_a_stage_whose_recordings_are_all_held_out_is_refused() -> None:
    with pytest.raises(UsageError, match="is held out"):
        resolved([stage(recordings=["walk"])], NAMES, NONE, EPISODES, np.array([0, 1]))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('name = "a"\nparameters = ["x"]\nloss = "guess"', "line 4.*loss"),
        ('name = "a"\nparameters = ["x"]\nsearch = "ants"', "plan.toml, line 4: stage 'a': search 'ants'"),
        (
            'name = "a"\nparameters = ["x"]\nmu = 30',
            "plan.toml, line 4: stage 'a': rho 2, mu 30, children 25",
        ),
        ('name = "a"\nparameters = []', "parameters"),
        (
            'name = "a"\nparameters = ["x"]\nsearch = "ga"',
            "plan.toml, line 4: stage 'a': search 'ga', population 25.*even population",
        ),
        ('name = "a"\nparameters = ["x"]\nshift = 0.1', "line 4: .*shift = 0.1, which means nothing to loss"),
        (
            'name = "a"\nparameters = ["x"]\nloss = "joint"\nrotation = 0.1',
            "line 5: .*rotation = 0.1, which means nothing to loss 'joint'; expected it with loss 'velocity'",
        ),
        (
            'name = "a"\nparameters = ["x"]\nsearch = "cma"\nmu = 3',
            "line 5: .*mu = 3, which means nothing to search 'cma'",
        ),
        ('name = "a"\nparameters = ["x"]\nsearch = "hill"\ncarry = 0.1', "line 5: .*'es' or 'cma'"),
        ('name = "a"', "parameters"),
    ],
)
def test_a_file_that_is_no_plan_says_why(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        read(tmp_path, text)


def test_two_stages_of_one_name_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="plan.toml, line 5: two stages are called 'a'"):
        read(tmp_path, *['name = "a"\nparameters = ["x"]'] * 2)


@pytest.mark.parametrize(
    ("stages", "says"),
    [
        (['name = "a"\nparameters = ["mass"]'], "plan.toml, line 3: stage 'a': parameters has 'mass'"),
        (
            ['name = "a"\nparameters = ["*"]\nrecordings = ["kick"]'],
            "plan.toml, line 4: .* recordings has 'kick'",
        ),
        (
            [f'name = "{name}"\nparameters = ["*"]' for name in "ab"],
            "plan.toml, line 6: .*'a' and 'b' overlap",
        ),
        (['name = "a"\nrecordings = ["walk"]\nparameters = ["*"]'], "plan.toml, line 3: .* is held out"),
    ],
)
def test_a_file_that_does_not_fit_says_in_which_line(tmp_path: Path, stages: list[str], says: str) -> None:
    with pytest.raises(UsageError, match=says):
        resolved(read(tmp_path, *stages), NAMES, NONE, EPISODES, np.array([0, 1]))
