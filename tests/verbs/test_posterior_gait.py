"""A gait that is sought in the query's answer and in draws that the recording does not tell from it."""

import re
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from secret_servo import TRAINING

from dynreg import session
from dynreg.data.names import episode_of
from dynreg.errors import NoMatchError
from dynreg.gait.had import Had
from dynreg.gait.near import DOUBT as NEAR
from dynreg.gait.seek import UNSEEN, Sought
from dynreg.gait.space import gait_space
from dynreg.gait.trials import Trials
from dynreg.results import Gait
from dynreg.session import Session
from dynreg.verbs import gait_searches, gait_simulators
from dynreg.verbs.gait import GaitSettings
from dynreg.verbs.gait import gait as seek
from dynreg.verbs.gaits import genes_of
from dynreg.verbs.subjects import Recorded, recorded

HOW = {"k": 2, "rollouts": 400, "threads": 1}


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory, brief, short_log) -> Iterator[Session]:
    """A registry with twelve simulators of a quadruped, and its log."""
    with session.open(tmp_path_factory.mktemp("posterior") / "registry") as made:
        made.ingest(short_log, brief, name="log")
        made.populate(brief, 12, training=TRAINING)
        yield made


@pytest.fixture(scope="module")
def found(opened: Session) -> Gait:
    return opened.gait("log", **HOW)


@pytest.fixture(scope="module")
def other(opened: Session) -> Gait:
    """Of another seed."""
    return opened.gait("log", seed=1, **HOW)


@pytest.fixture
def asked_before(found: Gait, opened: Session, monkeypatch: pytest.MonkeyPatch) -> Recorded:
    """The recording, whose query need not be asked again: it has the answer, and the draws, of `found`."""
    asked = recorded(opened.registry, "log", ingest=True)
    simulators = gait_simulators.simulators_named(asked, [t.simulator for t in found.trials])
    same = gait_simulators.Chosen(found.on, tuple(t.kind for t in found.trials), simulators, found.source)

    def chosen(of: Recorded, on: str, settings, many: int, seed: int, progress) -> gait_simulators.Chosen:
        assert (of, on, many, seed) == (asked, found.on, found.k, found.seed)
        return same

    monkeypatch.setattr(gait_simulators, "choose", chosen)
    return asked


def test_it_is_sought_in_the_answer_and_draws_about_it(found: Gait, opened: Session) -> None:
    answer = opened.registry.latest("neighbours")
    assert found.on == "posterior" and found.source == answer.id and found.accept == "mean"
    assert found.value == found.fitness.mean and found.k == GaitSettings(rollouts=400).most_chosen() == 6
    assert found.finals.runs > found.k and found.evaluations > 400 / found.k  # they took turns
    first, *others = (t.parameters for t in found.trials)
    told = answer.document["answer_parameters"]
    assert {n: v for n, v in first.items() if n != "action_rate"} == pytest.approx(
        {n: v for n, v in told.items() if n != "action_rate"}
    )
    assert all(p["torque"] != first["torque"] for p in others)
    assert {p["action_rate"] for p in (first, *others)} == {found.rate}  # known from the log
    assert (
        found.cost.rollouts <= HOW["rollouts"] + 8 * found.k
    )  # the answer's own run, and seven that predict a trial
    assert [t.kind for t in found.trials] == ["answer", *["posterior"] * 5]
    assert found.trials[0].simulator == answer.document["answer"] and found.shown == 0
    assert "on average in 6 simulators" in found.brief()
    lineage = opened.registry.simulator(found.trials[1].simulator)["lineage"]
    parts = answer.document["parts"]
    fitted = sorted({episode_of(name) for name in (*parts["fit"], *parts["select"])})
    shaped = {"recording": opened.recording("log").id, "episodes": fitted}
    assert lineage == {"made_by": "gait", "kind": "posterior"} | shaped and fitted


def test_the_same_seed_finds_the_same_and_another_draws_others(
    found: Gait, other: Gait, opened: Session
) -> None:
    again = opened.gait("log", **HOW)
    ids = [[t.simulator for t in one.trials] for one in (found, again, other)]
    assert again.genes == found.genes and ids[0] == ids[1]
    assert ids[0][0] == ids[2][0] and ids[0][1:] != ids[2][1:]  # the answer is the same
    assert opened.verify().clean


def test_once_one_walked_the_better_of_two_searches_is_taken_in_the_simulators_of_all_logs(
    found: Gait, other: Gait, opened: Session, asked_before, brief, monkeypatch: pytest.MonkeyPatch
) -> None:
    genes = tuple(gait_space(brief).from_dict(genes_of(found)).tolist())
    earlier = other.trials[1].simulator
    fell = tuple(1.01 * gene for gene in genes)
    had = Had((fell, genes), (0.1, 0.5), (False, True), simulators=(earlier,))
    compared, stages, again, own = [], [], [], Trials.again
    monkeypatch.setattr(Trials, "again", lambda self, *a, **how: again.append(how) or own(self, *a, **how))
    for taken in (False, True):
        told = lambda *given, taken=taken: compared.append(given) or taken  # noqa: E731
        monkeypatch.setattr("dynreg.verbs.gait_searches.new_does_more", told)
        gait = seek(asked_before, GaitSettings(**HOW), lambda *told: stages.append(told[0]), had=had)
        _, before, near, new = compared[-1]
        assert before == had.ordered((1, 0))  # the one that walked is the first
        assert not np.array_equal(near, new)
        assert [*genes_of(gait).values()] == pytest.approx([near, new][taken].tolist())
        # of five: the way to the gait nearby is looked at in all of them
        assert len(gait.trials) == 5 and gait.trials[-1].simulator == earlier
        assert gait.cost.rollouts <= HOW["rollouts"] + (3 + 2 + 2 * 2) * 40
        (many,) = re.findall(r"(\d+) gaits near the one that walked, and (\d+)", gait.notes[0])
        assert (
            gait.evaluations == int(many[taken]) and f"The {('first', 'second')[taken]} one" in gait.notes[0]
        )
    assert {"search 1 of 2", "search 2 of 2"} <= {*stages}
    # what both may bring is told alike
    assert [how["doubt"] for how in again if how.get("first") == UNSEEN] == [NEAR, NEAR]
    none = replace(had, walked=(False, False))
    alone = seek(asked_before, GaitSettings(**HOW), had=none)
    assert alone.trials[-1].simulator == earlier and len(compared) == 2
    assert not list((opened.path / "searches").glob("*"))


@pytest.mark.parametrize(("walked", "told"), [(True, [2, 0]), (False, [2])])
def test_the_first_search_alone_is_told_what_the_robot_has_had(
    walked: bool, told: list[int], found: Gait, asked_before, brief, monkeypatch: pytest.MonkeyPatch
) -> None:
    searches = []

    def spied(own: Callable[..., Sought]) -> Callable[..., Sought]:
        return lambda trials, settings, **how: searches.append(settings) or own(trials, settings, **how)

    for kind in ("seek_near", "seek"):
        monkeypatch.setattr(gait_searches, kind, spied(getattr(gait_searches, kind)))
    monkeypatch.setattr(gait_searches, "new_does_more", lambda *_: True)  # many runs, for what is not asked
    genes = tuple(gait_space(brief).from_dict(genes_of(found)).tolist())
    other = tuple(1.01 * gene for gene in genes)
    had = Had((other, genes), (0.1, 0.5), (False, walked))
    seek(asked_before, GaitSettings(**HOW), had=had)
    assert [len(one.tried) for one in searches] == told
    assert searches[0].tried == ((genes, other) if walked else (other, genes))  # from the one that walked


def test_the_second_search_goes_on_where_it_was_interrupted(
    found: Gait, opened: Session, asked_before, brief, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gait_searches, "new_does_more", lambda *_: True)  # so the second one's is the answer
    done = []
    genes = tuple(gait_space(brief).from_dict(genes_of(found)).tolist())
    had = Had((genes,), (0.5,), (True,))
    whole = seek(asked_before, GaitSettings(**HOW), had=had)

    def interrupt(stage: str, at: int, total: int) -> None:
        done.extend([at] if stage == "search 2 of 2" else [])
        if len(done) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        seek(asked_before, GaitSettings(**HOW), interrupt, had=had)
    gone_on = seek(asked_before, GaitSettings(**HOW, resume=True), had=had)
    kept = {"cost": whole.cost, "resumed": whole.resumed}
    assert gone_on.model_copy(update=kept) == whole and gone_on.cost.rollouts < whole.cost.rollouts
    assert not list((opened.path / "searches").glob("*"))


def test_where_no_simulator_is_close_the_query_is_kept_and_the_diagnosis_advised(
    opened: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    judged, before = gait_simulators.judged, len(opened.registry.ids("result"))
    far = lambda *a: judged(*a).model_copy(update={"fits": False, "alarm": "far off"})  # noqa: E731
    monkeypatch.setattr(gait_simulators, "judged", far)
    with pytest.raises(NoMatchError, match="far off.*dynreg diagnose log.*--on diagnosed"):
        opened.gait("log", **HOW)
    assert len(opened.registry.ids("result")) == before + 1
