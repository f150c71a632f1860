"""What a robot's log tells, and the simulators that the sources of gaits make of it.

`nearest` : the query's k nearest. `noisy` : these with the motor noise that its answer tells from the log, in place of
their own. `synthesised` : its one answer. `pulled` : this and neighbours, each moved most of the way to it.
`posterior` : this and draws that the log cannot tell apart from it (`neighbours.draws`), others for each search.
`hand` : see `hand_tuned`.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict
from functools import partial

import numpy as np
from gait_jobs import PULLED, Cells, Job, K
from hand_tuned import hand_tuned
from walkers import RATE, Walker, excited, named, stood_and_trotted

import dynreg
from dynreg.distance.table import AUTO
from dynreg.errors import DynregError
from dynreg.gait.trials import Simulators
from dynreg.neighbours.draws import drawn
from dynreg.neighbours.query import case_of, choose, distance_query
from dynreg.neighbours.retrieve import retrieve
from dynreg.neighbours.spending import Spending, usual_budget
from dynreg.replay.windows import errors
from dynreg.rng import stream, stream_seed
from dynreg.sim.effects import Terms, term
from dynreg.verbs.gait import MANY
from dynreg.verbs.populations import load_population

QUERIED = ("nearest", "hill", "synthesised", "pulled", "noisy", "posterior")
LOGS = {
    **dict.fromkeys((*QUERIED, "rounds"), "query"),
    **dict.fromkeys(("diagnosed", "calibrated"), "naming"),
    "hand": "tuning",
}
"""{source: the step that it needs}."""
POPULATION = 50
SEARCHES = 2  # in draws of their own, at most


def logged(job: Job, walker: Walker, journal: Cells, sources: tuple[str, ...]) -> dict[str, dict]:
    """{step: what it found} of a robot, with what the log must tell for these sources."""
    done = {step: found for (robot, step), found in journal.steps().items() if robot == walker.name}
    for source in sources:
        step = LOGS.get(source)
        if step and step not in done:
            done[step] = journal.timed(walker.name, step, partial(_MAKERS[step], job, walker))
    return done


def _queried(job: Job, walker: Walker) -> dict:
    """The query's k nearest, its one answer, whether or not it says that they fit, and what that leaves open.

    What `dynreg query` does without a word of it, for its replays tell a posterior that its document does not.
    """
    log, spent = excited(walker)
    with dynreg.open(job.registry, create=False) as reg:
        population = load_population(reg.registry, job.population, states=False)
    case = case_of(population, log, hold_out=None, threads=1, report=lambda *_: None)
    spending = Spending(K, usual_budget(walker.robot, K))
    chosen = choose(case, retrieve(distance_query(case, spending), AUTO, guess=True), spending)
    space, kinds, score = walker.robot.space, chosen.candidates, chosen.replays.score
    told = case.data.values_of(chosen.replays.unit[chosen.answer])
    found = sorted((i for i, c in enumerate(kinds) if c.entry is not None), key=lambda i: score[i])
    nearest = population.entries.values[[kinds[i].entry for i in found[:K]]]
    pulled = space.from_unit(space.to_unit(told) + PULLED * (space.to_unit(nearest) - space.to_unit(told)))
    posterior = [
        drawn(case, chosen, MANY, stream_seed(walker.seed, "draws", i) % 2**31) for i in range(SEARCHES)
    ]
    both = np.stack([told, walker.parameters])
    answers, truths = errors(case.replayer.residuals(both, case.data.parts.chosen)).mean(axis=1)
    return {
        "spent": asdict(spent),
        "truth": float(truths / answers),
        "fits": chosen.judgement.fits,
        "kind": kinds[chosen.answer].kind,
        "nearest": nearest.tolist(),
        "synthesised": [told.tolist()],
        "pulled": [told.tolist(), *pulled[: K - 1].tolist()],
        "posterior": [values.tolist() for values in posterior],
    }


def _diagnosed(job: Job, walker: Walker) -> dict:
    """The diagnosis from the nameplate: its simulators with and without the causes; only why, where it could not."""
    log, spent = stood_and_trotted(walker)
    try:
        found = named(walker, log, job.needed, job.plan.effects)
    except DynregError as problem:
        return {"spent": asdict(spent), "problem": str(problem)}
    terms = found.extended.terms
    told = {t.key: v[0].tolist() for t, v in zip(terms.terms, terms.values, strict=True)} if terms else {}
    return {
        "spent": asdict(spent),
        "verdict": found.verdict,
        "nats": found.nats,
        "needed": job.needed,
        "causes": found.causes,
        "effects": told,
        "diagnosed": found.extended.values.tolist(),
        "calibrated": found.calibrated.values.tolist(),
    }


def _tuned(job: Job, walker: Walker) -> dict:
    """The simulator that is tuned by hand, on the log that the query reads."""
    log, spent = excited(walker)
    found = hand_tuned(walker.robot, log)
    return {"spent": asdict(spent), "hand": [found.values.tolist()], "errors": found.errors}


_MAKERS: Mapping[str, Callable[[Job, Walker], dict]] = {
    "query": _queried,
    "naming": _diagnosed,
    "tuning": _tuned,
}


def simulators(job: Job, walker: Walker, source: str, step: dict | None, number: int = 0) -> Simulators:
    """Those of a source. step : what the log told. number : of the search, for draws that are others in each."""
    space, terms = walker.robot.space, None
    rate, noise = (space.names.index(name) for name in ("action_rate", "motor_noise"))
    if source == "true":
        return walker.truth
    if source in ("nominal", "packaged"):
        values = space.nominal[None]
    elif source == "population":
        values = space.sample(0, POPULATION, stream_seed(walker.seed, "population") % 2**31)
    elif source == "random":
        with dynreg.open(job.registry, create=False) as reg:
            entries = reg.registry.load(job.population, ()).values
        values = entries[stream(walker.seed, "random").choice(len(entries), K, replace=False)]
    elif source == "posterior":
        values = step["posterior"][number]
    else:
        values = np.array(step["nearest" if source in ("hill", "noisy") else source])
        if source == "noisy":
            values[:, noise] = step["synthesised"][0][noise]
        if source == "diagnosed" and step["effects"]:
            told = step["effects"]
            terms = Terms(tuple(map(term, told)), tuple(np.array([v]) for v in told.values()))
    values = np.array(values, dtype=float)
    values[:, rate] = RATE
    return Simulators(values, terms)
