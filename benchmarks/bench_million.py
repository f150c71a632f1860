"""The vector index alone at a million embeddings: memory, core time to build and to ask, recall.

    python benchmarks/bench_million.py [--registry FOLDER] [--n 10000 100000 1000000]

A mixture of Gaussians is fitted to the embeddings of a population; the million and the queries are drawn from it.
Queries are no members. Exact search is the truth. Each size is built in a process of its own. Memory is what an index
holds once it is built, as Linux tells of the process; hnswlib builds on one thread, as a registry does.
"""

import argparse
import json
import multiprocessing
import os
import time
from pathlib import Path
from typing import Any

import numpy as np
from kept import RESULTS, keep
from sklearn.mixture import GaussianMixture

import dynreg
from dynreg.index import vector_index
from dynreg.rng import stream_seed
from dynreg.verbs.populations import load_population

SEED, ENTRIES, ROBOT = 20261126, 1000, "quadruped"
COMPONENTS, QUERIES, K = 8, 200, 5
HERE = Path(__file__).parent


def main() -> None:
    """Measure every size, print the table and keep it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--registry", type=Path, default=HERE / "registry-million")
    parser.add_argument("--n", type=int, nargs="+", default=[10_000, 100_000, 1_000_000])
    given = parser.parse_args()
    own = embeddings(given.registry)
    mixture = GaussianMixture(COMPONENTS, reg_covar=1e-6, random_state=0).fit(own)
    print(f"{len(own)} embeddings of {own.shape[1]} numbers, {COMPONENTS} Gaussians")
    rows = []
    for n in given.n:
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            rows.append(pool.apply(measured, (mixture, n)))
        print(json.dumps(rows[-1]), flush=True)
    keep(RESULTS / "million.json", {"entries": len(own), "rows": rows}, parser, given)


def embeddings(folder: Path) -> np.ndarray:
    """(M, D) embeddings of a population of quadrupeds, which is made where it is not there yet."""
    with dynreg.open(folder) as session:
        identity = session.populate(ROBOT, ENTRIES).population
        return np.asarray(load_population(session.registry, identity).vectors)[:ENTRIES]


def measured(mixture: GaussianMixture, n: int) -> dict[str, Any]:
    """Seconds, bytes and recall of both kinds of index over n vectors."""
    vectors, queries = drawn(mixture, n, "members"), drawn(mixture, QUERIES, "queries")
    row: dict[str, Any] = {"n": n, "vectors GB": vectors.nbytes / 1e9}
    found = {}
    for kind in ("exact", "hnsw"):
        row[kind], found[kind] = indexed(kind, vectors, queries)
    hits = [len(set(a) & set(b)) for a, b in zip(found["exact"], found["hnsw"], strict=True)]
    return row | {"recall": float(np.mean(hits)) / K}


def indexed(kind: str, vectors: np.ndarray, queries: np.ndarray) -> tuple[dict[str, float], np.ndarray]:
    """Seconds and bytes of an index, which is gone when this returns, and the ids (Q, K) that it finds."""
    before, index = held(), vector_index(vectors.shape[1], kind=kind, seed=SEED)
    began = time.process_time()
    index.add(vectors)
    built, more = time.process_time() - began, held() - before
    ids, _ = index.nearest(queries, K)
    return {"build core s": built, "query ms": timed(index, queries), "GB held": more}, ids


def drawn(mixture: GaussianMixture, n: int, name: str) -> np.ndarray:
    """(n, D) float32 vectors of the mixture, by a seed of this name."""
    mixture.random_state = stream_seed(SEED, name, n) % 2**32
    vectors = mixture.sample(n)[0].astype(np.float32)
    return vectors[np.random.default_rng(stream_seed(SEED, "order", name, n)).permutation(n)]


def timed(index, queries: np.ndarray) -> float:
    """Milliseconds of a core for one query, asked alone: the median of 50."""
    seconds = []
    for query in queries[:50]:
        began = time.process_time()
        index.nearest(query[None], K)
        seconds.append(time.process_time() - began)
    return 1e3 * float(np.median(seconds))


def held() -> float:
    """Memory that this process has now [GB]; the most that it had would hide what fits into what drawing has freed."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e9


if __name__ == "__main__":
    main()
