"""The graph on real cross-losses: recall and evaluations of Algorithm 1 and of what replaces it.

Quadrupeds of the bench population, n = 250 to 2000 in the index, a hundred more as queries. Distances are the
paper's cross-loss with held-out own losses, all pairs measured once as the oracle; each method then asks for
as few of them as it can. Quality is the share of what brute force gains over nodes at random (paper D, "about 90 %" of
brute force, says not of what).
"""

import argparse
import json
from dataclasses import asdict
from functools import partial
from pathlib import Path
from time import perf_counter

import numpy as np
from index_measure import METHODS, Measured, averaged, by_graph, by_landmarks, growths, hubs, measure_graph
from kept import RESULTS
from landmarks import build_landmarks, refine, search_landmarks

import dynreg
from dynreg.distance.cross_loss import CrossLoss
from dynreg.distance.population import judged_entries
from dynreg.index import GraphSettings, build
from dynreg.models.mlp import stack_of
from dynreg.neighbours.entries import make_entries
from dynreg.verbs.populations import load_population

HERE = Path(__file__).parent


def by_taught(
    nodes, to, queries: int, n: int, k: int, seed: int, *, m: int = 128, rerank: int = 170
) -> Measured:
    """Landmarks whose regressions learn from the links of the degree-capped graph too: no query pays for them."""
    graph = build(nodes, n, GraphSettings(seed=seed))
    landmarks = build_landmarks(nodes, n, seed=seed, m=m)
    a = np.concatenate([np.full(len(ids), i) for i, ids in enumerate(graph.neighbours)])
    b = np.concatenate(graph.neighbours)
    taught = refine(landmarks, np.concatenate([a, b]), np.concatenate([b, a]), np.tile(nodes.pairs(a, b), 2))
    found = search_landmarks(taught, to, queries, k, rerank=min(rerank, n - m))
    return found, graph.evaluations / n + m


TRIED = {
    **METHODS,
    "graph, ef 20": partial(by_graph, ef=20),
    "graph, ef 40": partial(by_graph, ef=40),
    "graph, f 14, cap 28": partial(by_graph, f=14, degree_cap=28),
    "landmarks 96, 100": partial(by_landmarks, m=96, rerank=100),
    "landmarks 128, 100": partial(by_landmarks, m=128, rerank=100),
    "landmarks 128, 170": partial(by_landmarks, m=128, rerank=170),
    "landmarks + links, 170": by_taught,
}


def distances(reg, population: str, count: int) -> np.ndarray:
    """(count, count) cross-losses between quadrupeds, those beyond the registered ones made on the way."""
    held = load_population(reg.registry, population, states=True)
    entries, stack = held.entries, held.stack[np.arange(len(held))]
    states = [entries.states[:count]]
    for first in range(len(held), count, 100):
        more = make_entries(held.shared, np.arange(first, min(first + 100, count)))
        states.append(more.states)
        stack = stack_of([stack, more.stack])
        print(f"  {min(first + 100, count)} simulated and trained", flush=True)
    stack = stack[np.arange(count)]
    judged = judged_entries(held.shared, np.concatenate(states), stack)
    return CrossLoss(stack, judged.inputs, judged.targets, judged.own).matrix()


def main() -> None:
    """Measure, print and write benchmarks/results/graph.json."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--sizes", type=int, nargs="+", default=[250, 500, 1000, 2000])
    parser.add_argument("--queries", type=int, default=100)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--registry", default=str(HERE / "registry"))
    parser.add_argument("--matrix", type=Path, help="keep the matrix here, and read it where it is")
    given = parser.parse_args()
    n = max(given.sizes)
    if given.matrix and given.matrix.exists():
        matrix = np.load(given.matrix, allow_pickle=False)
    else:
        with dynreg.open(given.registry) as reg:
            population = reg.populate("quadruped", 1000, link=False).population
            began = perf_counter()
            matrix = distances(reg, population, n + given.queries)
            print(f"{len(matrix)} quadrupeds made and compared in {perf_counter() - began:.0f} s")
        if given.matrix:
            np.save(given.matrix, matrix)
    nodes, queries = matrix[:n, :n], matrix[n : n + given.queries, :n]
    runs = [
        measure_graph(nodes, queries, sizes=given.sizes, k=5, seed=seed, methods=TRIED)
        for seed in range(given.seeds)
    ]
    rows = averaged(runs)
    print(
        f"\n{'method':22s} {'n':>5s} {'recall@5':>9s} {'quality':>8s} {'evaluations':>12s} {'insertion':>10s}"
    )
    for r in rows:
        print(
            f"{r.method:22s} {r.n:5d} {r.recall:9.3f} {r.quality:8.3f} {r.evaluations:12.1f} {r.insertion:10.1f}"
        )
    growth = {name: asdict(g) for name, g in growths(rows)} if len(given.sizes) > 2 else {}
    print("\ngrowth of evaluations: R2 of a + b log n, and of a + b n")
    for name, g in growth.items():
        by_log = f"{g['log_r2']:.3f} (rms {g['log_residual']:.1f})"
        by_n = f"{g['linear_r2']:.3f} (rms {g['linear_residual']:.1f})"
        print(f"{name:32s} log n {by_log}   n {by_n}")
    hub = hubs(nodes, 5)
    print(f"\nhubness of the true 5 nearest: {hub}")
    RESULTS.mkdir(exist_ok=True)
    document = {
        "rows": [asdict(r) for r in rows],
        "growth": growth,
        "hubness": hub,
    }
    (RESULTS / "graph.json").write_text(json.dumps(document, indent=1) + "\n")


if __name__ == "__main__":
    main()
