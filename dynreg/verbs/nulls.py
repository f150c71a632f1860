"""The simulated robots without an effect that set a threshold, diagnosed by the workers of an executor: one a job."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from dynreg.executor import Executor

if TYPE_CHECKING:
    from dynreg.diagnose.ranking.population import EffectPopulation
    from dynreg.evidence.lockstep import Search

Null = tuple[
    float, float, int
]  # score [nats], ratio, and how many simulations they took; see `threshold.null`


@dataclass
class HandedOut:
    """Scores that workers find: called with how many robots, it gives (score, ratio) of each, in order.

    Simulators with one effect each, where the search has such, go into each job.
    function : answers a `Null` for the `job` with the `number` of a robot. rollouts : simulations so far.
    """

    executor: Executor
    function: Callable[..., Null]
    job: Mapping[str, Any]
    rollouts: int = field(default=0, init=False)

    def __call__(self, runs: int, known: "EffectPopulation | None" = None) -> Iterator[tuple[float, float]]:
        told = dict(self.job)
        if known is not None:
            told["known"] = {"terms": known.terms, "arrays": known.as_arrays()}
        jobs = ({**told, "number": number} for number in range(runs))
        for score, ratio, rollouts in self.executor.map(self.function, jobs):
            self.rollouts += rollouts
            yield score, ratio


def null_of_diagnosis(
    robot: Mapping[str, Any],
    recording: Mapping[str, Any],
    start: Mapping[str, Any] | None,
    options: Mapping[str, Any],
    number: int,
    threads: int,
    known: Mapping[str, Any] | None = None,
) -> Null:
    """Robot `number` without an effect, under the commands of a recording.

    start : the simulator to begin from, as JSON. options : of `DiagnosisOptions`. known : the terms and arrays of the
    simulators with one effect each by which the diagnosis orders causes, where it has such.
    """
    from dynreg.diagnose.diagnose import posed
    from dynreg.diagnose.noise import own_noise
    from dynreg.diagnose.options import DiagnosisOptions
    from dynreg.diagnose.ranking.guide import Guide
    from dynreg.diagnose.ranking.population import EffectPopulation
    from dynreg.diagnose.threshold import null_seed, nulls_of
    from dynreg.sim.config import SimConfig
    from dynreg.verbs.plain import recording_from, robot_from

    built, asked = robot_from(robot), recording_from(recording)
    begun = None if start is None else SimConfig.from_dict(start)
    how = replace(DiagnosisOptions(**options), threads=threads, ranker="off")

    def found() -> "Search[list[tuple[float, float]]]":
        problem = yield from posed(built, asked, how, begun)
        if known is not None:
            guide = Guide(EffectPopulation.from_arrays(known["terms"], known["arrays"]))
            problem = replace(problem, guide=guide)
        noise = own_noise(built, problem.train_part(asked))
        return (yield from nulls_of(problem, noise, [null_seed(how.seed, number)]))

    return ran(found(), threads)


def ran(search: "Search[list[tuple[float, float]]]", threads: int) -> Null:
    """What the search for one robot finds, and how many simulations it took."""
    from dynreg.evidence.lockstep import counted, run

    ((score, ratio),), rollouts = run(counted(search), threads=threads)
    return score, ratio, rollouts
