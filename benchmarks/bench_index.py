"""Recall and cost of the index against brute force, on made-up entries or on stored distance matrices.

    python benchmarks/bench_index.py
    python benchmarks/bench_index.py --nodes nodes.npy --queries queries.npy    # (n, n) and (Q, n)

Prints each method at each size, averaged over seeds, how its cost grows with n, and the hubness.
"""

import argparse
import json
from dataclasses import asdict
from functools import partial
from pathlib import Path
from time import perf_counter

import numpy as np
from index_entries import MatrixDistance, SyntheticEntries
from index_measure import (
    METHODS,
    averaged,
    by_graph,
    growths,
    hubs,
    measure_graph,
)

from dynreg.index import NO_CAP, GraphSettings, build

BENCHED = {
    **METHODS,
    "graph, no cap": partial(by_graph, degree_cap=NO_CAP),
    "graph, ef 20": partial(by_graph, ef=20),
    "graph, ef 100": partial(by_graph, ef=100),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--synthetic", action="store_true", help="made-up entries (the default)")
    parser.add_argument("--nodes", type=Path, help="distances between nodes, (n, n) .npy")
    parser.add_argument("--queries", type=Path, help="distances from queries to nodes, (Q, n) .npy")
    parser.add_argument("--sizes", type=int, nargs="+", default=[250, 500, 1000, 2000])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("-k", type=int, default=5)
    parser.add_argument("--json", action="store_true", help="one JSON document instead of tables")
    options = parser.parse_args()
    if bool(options.nodes) != bool(options.queries):
        parser.error("give both --nodes and --queries, or neither for made-up entries")
    options.synthetic = options.synthetic or not options.nodes
    sizes, runs, tables = options.sizes, [], []
    for seed in range(options.seeds):
        nodes, queries = _load(options, max(sizes), seed)
        runs.append(measure_graph(nodes, queries, sizes=sizes, k=options.k, seed=seed, methods=BENCHED))
        tables.append(nodes)
    rows = averaged(runs)
    summary = {
        "rows": [asdict(row) for row in rows],
        "growth": {name: asdict(growth) for name, growth in growths(rows)} if len(sizes) > 2 else {},
        "hubness": hubs(tables[0], options.k),
        "overhead": overhead(tables[0]),
    }
    print(json.dumps(summary, indent=1) if options.json else _text(summary))


def overhead(matrix: np.ndarray) -> dict[str, float]:
    """Seconds to insert up to 1000 nodes whose distances are looked up, by nodes in a generation."""
    n = min(1000, len(matrix))
    seconds = {}
    for batch in (1, 32):
        started = perf_counter()
        build(MatrixDistance(matrix), n, GraphSettings(batch=batch))
        seconds[f"{n} insertions, batch {batch} [s]"] = perf_counter() - started
    return seconds


def _load(options: argparse.Namespace, n: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    if options.synthetic:
        entries = SyntheticEntries.draw(n + 100, seed=seed)
        return entries.matrix(slice(n), slice(n)), entries.matrix(slice(n, None), slice(n))
    return np.load(options.nodes, allow_pickle=False), np.load(options.queries, allow_pickle=False)


def _text(summary: dict) -> str:
    lines = [f"{'method':16}{'n':>7}{'recall':>8}{'quality':>9}{'evaluations':>13}{'insertion':>11}"]
    for row in summary["rows"]:
        lines.append(
            f"{row['method']:16}{row['n']:7d}{row['recall']:8.3f}{row['quality']:9.3f}"
            f"{row['evaluations']:13.0f}{row['insertion']:11.0f}"
        )
    lines.append(
        f"\n{'growth':26}{'per e-fold':>11}{'R2 log':>8}{'rms':>7}{'per node':>10}{'R2 n':>7}{'rms':>7}"
    )
    for name, fit in summary["growth"].items():
        lines.append(
            f"{name:26}{fit['log_slope']:11.1f}{fit['log_r2']:8.3f}{fit['log_residual']:7.1f}"
            f"{fit['linear_slope']:10.3f}{fit['linear_r2']:7.3f}{fit['linear_residual']:7.1f}"
        )
    lines.append(f"\n{'hubness':16}{'skewness':>9}{'largest':>9}{'never':>7}")
    for name, hub in summary["hubness"].items():
        lines.append(f"{name:16}{hub['skewness']:9.2f}{hub['largest']:9d}{hub['never']:7.3f}")
    return "\n".join([*lines, "", *(f"{name}: {value:.2f}" for name, value in summary["overhead"].items())])


if __name__ == "__main__":
    main()
