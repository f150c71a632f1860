"""Results in a notebook: one line each as text, axes when they are drawn, and no matplotlib before."""

import subprocess
import sys

import made_up_changes
import made_up_comparison
import made_up_diagnosis
import made_up_drift
import made_up_gait
import made_up_navigation
import made_up_results
import numpy as np
import pytest

from dynreg.data.recording import Channel, Episode, Recording
from dynreg.errors import UsageError
from dynreg.results import Result

pyplot = pytest.importorskip("matplotlib.pyplot")


@pytest.fixture(autouse=True)
def without_a_screen():
    pyplot.switch_backend("agg")
    yield
    pyplot.close("all")


def recording() -> Recording:
    time = np.arange(5) / 10.0
    values = np.stack([time, -time], axis=1)
    channels = (Channel("arm/position", "rad"), Channel("arm/velocity", "rad/s"))
    return Recording(channels, (Episode("a", time, values, {"kp": 400.0}), Episode("b", time, 2.0 * values)))


@pytest.mark.parametrize("result", made_up_results.every_kind(), ids=lambda r: type(r).__name__)
def test_a_result_says_itself_in_one_line(result: Result) -> None:
    said = repr(result)
    assert said.startswith(f"<{type(result).__name__} ") and said.endswith(">")
    assert "\n" not in said and len(said) < 300


def test_the_line_of_an_answer_has_the_answer() -> None:
    found = made_up_results.neighbours(k=3)
    assert repr(found) == f"<Neighbours of bench_monday: answer {found.answer[:12]}, 3 neighbours, fits>"
    assert repr(made_up_diagnosis.diagnosis()).startswith("<Diagnosis of ")


def test_a_recording_and_an_episode_say_themselves_in_one_line() -> None:
    made = recording()
    assert repr(made) == f"<Recording {made.id[:12]}: 2 episodes, 2 channels, 10 rows, 0.8 s, measured>"
    assert repr(made.episodes[0]) == "<Episode 'a': 5 rows, 0.4 s, kp=400>"
    shown = made._repr_html_()
    assert "arm/velocity [rad/s]" in shown and shown.count("<tr") == 3


def test_a_recording_draws_each_channel_in_its_unit() -> None:
    places = recording().plot(episode="b")
    assert [ax.get_ylabel() for ax in places] == ["arm/position [rad]", "arm/velocity [rad/s]"]
    assert np.array_equal(places[1].lines[0].get_ydata(), -2.0 * np.arange(5) / 10.0)
    assert places[0].get_xlabel() == "time [s]" and "b" in places[0].get_title()


def test_one_channel_goes_onto_the_axes_that_are_given() -> None:
    ax = pyplot.subplots()[1]
    assert list(recording().plot("arm/velocity", ax=ax)) == [ax] and len(ax.lines) == 1
    with pytest.raises(UsageError, match="2 channels for one axes"):
        recording().plot(ax=ax)
    with pytest.raises(UsageError, match="arm/effort.*arm/position"):
        recording().plot("arm/effort")


def test_an_answer_draws_what_was_measured_beside_it() -> None:
    found = made_up_results.neighbours()
    places = found.plot()
    assert len(places) == len(found.traces)
    assert {line.get_label() for line in places[0].lines} == {"measured", "nominal", "answer"}
    with pytest.raises(UsageError, match="no curves to draw"):
        found.model_copy(update={"traces": ()}).plot()


def test_a_diagnosis_draws_curves_and_the_ranking_with_what_a_cause_needs() -> None:
    found = made_up_diagnosis.diagnosis()
    assert len(found.plot()) == len(found.traces)
    (ax,) = found.plot("ranking")
    first = [r.key for r in found.ranking if r.round == 1]
    assert [label.get_text() for label in ax.get_yticklabels()] == first[::-1]
    assert ax.lines[0].get_xdata()[0] == found.threshold_nats


def test_a_gait_draws_its_way_in_every_simulator() -> None:
    found = made_up_gait.gait()
    (ax,) = found.plot()
    assert [list(line.get_xdata()) for line in ax.lines] == [t.x for t in found.trials]


def ends(ax) -> np.ndarray:
    """(n, 2, 2) of each interval on an axes: both ends, x and y."""
    (bars,) = [c for c in ax.containers[0].lines[2]]
    return np.array(bars.get_segments())


def test_a_comparison_draws_errors_over_the_horizon_with_their_intervals() -> None:
    found = made_up_comparison.arm()
    (ax,) = found.plot("elbow/position")
    assert [c.get_label() for c in ax.containers] == list(found.rollouts.names)
    scores = [found.rollouts.score("nominal", "elbow/position", s) for s in (0.1, 2.0)]
    assert np.allclose(ends(ax), [[(s.seconds, s.low), (s.seconds, s.high)] for s in scores])
    assert "[rad]" in ax.get_ylabel() and ax.get_xlabel() == "horizon [s]"
    assert "[spread]" in found.plot()[0].get_ylabel()
    with pytest.raises(UsageError, match="elbow/effort"):
        found.plot("elbow/effort")
    with pytest.raises(UsageError, match="no errors of simulators"):
        made_up_comparison.comparison(paths=False).plot()


def test_changes_are_drawn_before_and_after_with_their_intervals() -> None:
    found = made_up_changes.changes()
    places = found.plot()
    assert [ax.get_title() for ax in places] == [
        "payload[elbow] (mass) [kg], changed",
        "elbow_damping [N*m*s/rad]",
    ]
    after, before = (found.changed[0].values[when] for when in ("after", "before"))
    assert np.allclose(ends(places[0])[:, :, 0], [(after.low, after.high), (before.low, before.high)])
    (ax,) = found.plot("elbow_damping")
    assert found.plot("elbow_damping", ax=ax)[0] is ax


def test_a_drift_draws_factors_with_their_intervals_and_a_map() -> None:
    found = made_up_drift.drift()
    (ax,) = found.plot()
    shown = [p for p in found.patterns if p.name != "no change"][::-1]
    assert [label.get_text() for label in ax.get_yticklabels()] == [p.name for p in shown]
    assert np.allclose(ends(ax)[:, :, 0], [(p.low, p.high) for p in shown])
    (ax,) = found.plot("dtheta")
    assert len(ax.collections[0].get_offsets()) == len(found.cells)
    assert len(ax.lines[0].get_xdata()) == sum(c.shifts["dtheta"].rejected for c in found.cells)
    with pytest.raises(UsageError, match="no tested cells"):
        made_up_drift.drift("too little data").plot()


def test_nothing_is_drawn_with_before_something_is_drawn() -> None:
    code = "import sys, dynreg.results, dynreg.data.recording, dynreg.session; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 0


def test_a_plan_draws_its_path_some_drives_and_its_places() -> None:
    found = made_up_navigation.navigation(missed=True)
    (place,) = found.plot()
    drive, model, visited, missed, _ = place.lines
    assert np.array_equal(model.get_xdata(), found.way.x) and model.get_label() == "dynamic"
    assert np.array_equal(drive.get_ydata(), found.ways[0].y)
    assert [*visited.get_xdata()] == pytest.approx([0.35, 0.65, 0.65, 0.35, 0.35])
    assert [*missed.get_ydata()] == pytest.approx([-0.35, -0.35, -0.05, -0.05, -0.35])
    assert visited.get_color() != missed.get_color() and place.get_ylabel() == "to the left [m]"


def test_the_querys_answer_shows_a_gait_and_without_it_the_simulator_in_which_it_walks_least() -> None:
    found = made_up_gait.gait(fell=True)
    assert found.shown == 2
    first, second, third = found.trials
    for number, trials in enumerate(((first, second, third), (second, first, third))):
        trials = tuple(t.model_copy(update={"kind": "answer" if t is first else "posterior"}) for t in trials)
        assert found.model_copy(update={"trials": trials}).shown == number
