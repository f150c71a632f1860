"""Random starts of the networks side by side, each worker a program of its own: MINPACK never lets go of Python's lock.

A pool of processes would run the caller's script again in every one of them where it has no main guard; a program that
is asked over its standard streams does not. Each does its algebra on one thread: there are as many as cores.
"""

import io
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np

ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")}
PACKAGES = Path(__file__).parents[2]

Part = tuple[np.ndarray, np.ndarray]


def side_by_side(
    known: Part, unseen: Part, jobs: Sequence[tuple[int, int]], *, seed: int, iterations: int, workers: int
) -> Iterator[tuple[np.ndarray, float] | None]:
    """For each job (axis, start), in their order, the weights (141,) and their validation error.

    known, unseen : standardised inputs (n, 5) and displacements (n, 3). None where a worker ended before its answer, or
    could not be started: the caller has to train that one.
    """
    shares = [jobs[first::workers] for first in range(workers)]
    with ExitStack() as stack:
        asked = [stack.enter_context(_asked(known, unseen, share, seed, iterations)) for share in shares]
        running = []
        for request in asked:
            running.append(_started(request))
            stack.callback(_ended, running[-1])
        for number in range(len(jobs)):
            worker = running[number % workers]
            line = worker.stdout.readline() if worker else b""
            found = json.loads(line) if line.endswith(b"\n") else None
            yield None if found is None else (np.array(found["weights"]), float(found["error"]))


def _asked(known: Part, unseen: Part, jobs: Sequence[tuple[int, int]], seed: int, iterations: int):
    """A file that holds what a worker is to do, from its begin."""
    named = {"inputs": known[0], "moved": known[1], "unseen_inputs": unseen[0], "unseen_moved": unseen[1]}
    out = tempfile.TemporaryFile()
    np.savez(out, jobs=np.array(jobs, dtype=int).reshape(-1, 2), how=np.array([seed, iterations]), **named)
    out.seek(0)
    return out


def _started(request) -> subprocess.Popen | None:
    paths = [str(PACKAGES), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = os.environ | ONE_THREAD | {"PYTHONPATH": os.pathsep.join(paths)}
    command = [sys.executable, "-P", "-m", "dynreg.timed.starts"]
    try:
        return subprocess.Popen(
            command, stdin=request, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=environment
        )
    except OSError:
        return None


def _ended(worker: subprocess.Popen | None) -> None:
    if worker:
        worker.kill()
        worker.stdout.close()
        worker.wait()


def main() -> None:
    """The worker: what to do from standard input, a line of JSON for each job to standard output."""
    from dynreg.timed.networks import trained

    with np.load(io.BytesIO(sys.stdin.buffer.read()), allow_pickle=False) as asked:
        table = {name: asked[name] for name in asked.files}
    seed, iterations = map(int, table["how"])
    for axis, start in table["jobs"].tolist():
        known = table["inputs"], table["moved"][:, axis]
        unseen = table["unseen_inputs"], table["unseen_moved"][:, axis]
        weights, error = trained(seed, axis, start, known, unseen, iterations)
        print(json.dumps({"weights": weights.tolist(), "error": error}), flush=True)


if __name__ == "__main__":
    main()
