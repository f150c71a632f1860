"""Guided: a problem with a population of simulators under its commands, made once and then taken from the cache."""

import base64
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from dynreg.data.recording import Recording
from dynreg.diagnose.noise import noisier, own_noise
from dynreg.diagnose.options import DiagnosisOptions
from dynreg.diagnose.problem import Problem
from dynreg.diagnose.ranking.guide import Guide
from dynreg.diagnose.ranking.population import EffectPopulation, populated
from dynreg.diagnose.threshold import Cache, commands, key_of, same
from dynreg.evidence.lockstep import Search
from dynreg.progress import Progress

KIND = "ranking"
VERSION = 1  # of the entries: a new one invalidates cached populations
# Entries for each term and for none, and the most of all. On the servo bench (31 terms) 640, 960, 1900 and 2900 entries
# name 98.6, 99.1, 99.8 and 99.8 % of held-out ones with three times the noise.
EACH, MOST = 60, 4000


def guided(
    problem: Problem,
    recording: Recording,
    options: DiagnosisOptions,
    cache: Cache | None = None,
    progress: Progress | None = None,
) -> Search[Problem]:
    """The problem with a guide, where the options ask for one and its plan gains by it."""
    if options.ranker == "off" or not problem.plan.guided:
        return problem
    return (yield from with_guide(problem, recording, options, entries(problem), cache, progress))


def entries(problem: Problem) -> int:
    """How many entries a guide of the problem has."""
    return min(EACH * (1 + len(problem.terms)), MOST)


def with_guide(
    problem: Problem,
    recording: Recording,
    options: DiagnosisOptions,
    count: int,
    cache: Cache | None = None,
    progress: Progress | None = None,
) -> Search[Problem]:
    """The problem with a guide of `count` entries, from the cache where it holds one for similar commands."""
    noise = own_noise(problem.model.robot, recording)
    key = population_key(problem, noise, count, options.seed)
    told, terms = commands(problem.data), [t.key for t in problem.terms]
    kept = [] if cache is None else (cache.cached(KIND, key) or {"found": []})["found"]
    for one in kept:
        if same(told, np.array(one["commands"])):
            return replace(problem, guide=Guide(EffectPopulation.from_arrays(terms, _arrays(one["arrays"]))))
    report = progress or (lambda *_: None)
    report("entries", 0, count)
    robot = noisier(problem.model.robot, noise)
    found = yield from populated(
        problem.model,
        problem.data,
        problem.terms,
        robot,
        count,
        options.seed,
        lambda done: report("entries", done, count),
    )
    if cache is not None:
        row = {"commands": told.tolist(), "arrays": _text(found.as_arrays())}
        cache.cache(KIND, key, {"found": [*kept, row]})
    return replace(problem, guide=Guide(found))


def population_key(problem: Problem, noise: Mapping[str, float], count: int, seed: int) -> dict[str, Any]:
    """All that the entries depend on besides the commands, as plain JSON."""
    own = key_of(replace(problem, guide=None), noise, 0, seed)
    return {k: v for k, v in own.items() if k != "plan"} | {"entries": count, "version": VERSION}


def _text(arrays: Mapping[str, np.ndarray]) -> dict[str, list[Any]]:
    """Arrays as plain JSON: type, shape, and the bytes in base64."""
    return {
        name: [a.dtype.str, list(a.shape), base64.b64encode(np.ascontiguousarray(a).tobytes()).decode()]
        for name, a in arrays.items()
    }


def _arrays(told: Mapping[str, list[Any]]) -> dict[str, np.ndarray]:
    return {
        name: np.frombuffer(base64.b64decode(text), dtype=np.dtype(kind)).reshape(shape)
        for name, (kind, shape, text) in told.items()
    }
