"""What a recording looks like, by a population of simulators that carry one effect each, under the same commands."""

import time

import numpy as np

from dynreg.diagnose.ranking.guide import Guide
from dynreg.diagnose.threshold import commands, same, stretched
from dynreg.errors import UsageError, command
from dynreg.evidence.lockstep import counted, run
from dynreg.progress import Progress
from dynreg.registry import PopulationRecord
from dynreg.results.causes import Causes, LikelyCause
from dynreg.results.result import Cost
from dynreg.sim.effects import term
from dynreg.verbs.effect_populations import held, posed
from dynreg.verbs.query import QuerySettings
from dynreg.verbs.settings import flags
from dynreg.verbs.subjects import Recorded, word_for

# Settings that it reads, and the distance, which a settings file tells to every query.
READ = ("k", "population", "threads", "distance")


def looks_like(
    asked: Recorded, record: PopulationRecord, settings: QuerySettings, progress: Progress | None = None
) -> Causes:
    """The causes of the entries nearest to a recording.

    Raises UsageError where its commands are others, and for settings that mean nothing to simulators with effects.
    """
    began, report = time.perf_counter(), progress or (lambda *_: None)
    if ignored := flags(settings, without=READ):
        raise UsageError(
            f"{' '.join(ignored)} with population {record.id[:12]}",
            expected="settings of a query of simulators with effects: they have a hold-out of their own, and are all "
            "compared",
            do="leave it out, or fill a population of models with `dynreg populate`",
        )
    report("compare", 0, 1)
    given = posed(asked, record.seed, settings.threads)
    told = commands(given.problem.data)
    if record.robot_hash != asked.robot.hash or not same(told, stretched(record.arrays["bank.actions"])):
        word = word_for(asked.registry, asked.robot)
        raise UsageError(
            f"population {record.id[:12]} has other commands than {asked.name!r}",
            expected="entries that were simulated under the recording's own commands",
            do=f"run `{command('populate', word, '--effects', '--like', asked.name, '-n', 2000)}`",
        )
    population, ids, _ = held(asked.registry, record.id)
    guide, model = Guide(population), given.problem.model
    search = guide.ranking(model, given.problem.data, given.problem.terms)
    ranking, rollouts = run(counted(search), threads=settings.threads)
    nearest = np.argsort(-ranking.cosines, kind="stable")[: settings.k]
    names = np.array(["", *population.terms])[population.carried + 1]
    causes = []
    for one in ranking.causes:
        own = np.flatnonzero(names == one.key)
        if not len(own):
            continue
        cause = term(one.key) if one.key else None
        causes.append(
            LikelyCause(
                effect=cause.effect.id if cause else "",
                joints=cause.joints if cause else (),
                bodies=cause.bodies if cause else (),
                belief=one.share,
                near=float(np.mean(names[nearest] == one.key)),
                cosine=one.cosine,
                entry=ids[own[int(ranking.cosines[own].argmax())]],
            )
        )
    report("compare", 1, 1)
    return Causes(
        robot=asked.robot.name,
        population=record.id,
        recording=asked.recording.id,
        recording_name=asked.name,
        entries=len(population),
        k=settings.k,
        causes=tuple(causes),
        resemblance=ranking.resemblance,
        outside=ranking.outside,
        size=ranking.size,
        noise=ranking.noise,
        cost=Cost(evaluations=len(population), rollouts=rollouts, seconds=time.perf_counter() - began),
    )
