"""Guided: a problem with simulators that carry one effect each under its commands, made once and then kept."""

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

KIND = "effects"  # of what the cache holds
VERSION = 1  # of the entries: a new one invalidates those that are kept
# Entries for each term, and the most of all. On the servo bench (31 terms) 640, 960, 1900 and 2900 entries name 98.6,
# 99.1, 99.8 and 99.8 % of held-out ones with three times the noise.
EACH, MOST = 60, 4000


def guided(
    problem: Problem,
    recording: Recording,
    options: DiagnosisOptions,
    cache: Cache | None = None,
    progress: Progress | None = None,
    count: int | None = None,
) -> Search[Problem]:
    """The problem with a guide, as far as the options ask for one; one that is made is kept in the cache.

    "auto" leaves it out where logs of one cause do not look alike (`Plan.alike`).
    count : entries of one that is made; None for the usual number.
    """
    if options.ranker == "off" or (options.ranker == "auto" and not problem.plan.alike):
        return problem
    noise = own_noise(problem.model.robot, problem.train_part(recording))
    found = kept(problem, noise, cache)
    if found is None and options.ranker == "make":
        count = usual_count(problem) if count is None else count
        report = progress or (lambda *_: None)
        report("entries", 0, count)
        robot = noisier(problem.model.robot, noise)
        found = yield from populated(
            *(problem.model, problem.data, problem.terms, robot, count, options.seed),
            lambda done: report("entries", done, count),
        )
        keep(found, problem, noise, cache)
    return problem if found is None else replace(problem, guide=Guide(found))


def usual_count(problem: Problem) -> int:
    """How many entries a guide of the problem has that is made for one diagnosis."""
    return min(EACH * (1 + len(problem.terms)), MOST)


def kept(problem: Problem, noise: Mapping[str, float], cache: Cache | None) -> EffectPopulation | None:
    """The largest population that the cache holds for the problem, under similar commands; None without one.

    noise : of the log's own sensors; see `own_noise`.
    """
    told, terms = commands(problem.data), [term.key for term in problem.terms]
    rows = (
        []
        if cache is None
        else (cache.cached(KIND, population_key(problem, noise)) or {"found": []})["found"]
    )
    like = [one for one in rows if same(told, np.array(one["commands"]))]
    if not like:
        return None
    return EffectPopulation.from_arrays(terms, _arrays(max(like, key=lambda one: one["entries"])["arrays"]))


def keep(found: EffectPopulation, problem: Problem, noise: Mapping[str, float], cache: Cache | None) -> None:
    """Keep a population in the cache, in place of smaller ones under similar commands."""
    if cache is None:
        return
    key, told = population_key(problem, noise), commands(problem.data)
    before = (cache.cached(KIND, key) or {"found": []})["found"]
    if any(one["entries"] > len(found) and same(told, np.array(one["commands"])) for one in before):
        return
    others = [one for one in before if not same(told, np.array(one["commands"]))]
    row = {"commands": told.tolist(), "entries": len(found), "arrays": _text(found.as_arrays())}
    cache.cache(KIND, key, {"found": [*others, row]})


def population_key(problem: Problem, noise: Mapping[str, float]) -> dict[str, Any]:
    """All that entries depend on besides the commands and their seed, as plain JSON."""
    own = key_of(replace(problem, guide=None), noise, 0, 0)
    return {name: value for name, value in own.items() if name != "plan"} | {"version": VERSION}


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
