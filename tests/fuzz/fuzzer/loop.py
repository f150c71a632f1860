"""The loop: workers take spans of inputs in turn; one that dies or hangs is replaced, and its input is kept."""

import math
import os
import select
import signal
import time
from pathlib import Path

from fuzzer.findings import died, keep
from fuzzer.journal import Journal
from fuzzer.scratch import clear
from fuzzer.table import TARGETS
from fuzzer.target import WALL, Verdict, drawn
from fuzzer.worker import IDLE, Bounds, Worker

SPAN = 250  # inputs between two reports
SPANS = 60  # of one worker, before a fresh one takes its place
GRACE = 2.0 * WALL  # times the seconds of an input, after which a worker that does not answer is killed


class Loop:
    """A run of some targets in some processes until the seconds are over."""

    def __init__(self, folder: Path, targets: list[str], seed: int, bounds: Bounds):
        self.folder, self.targets, self.seed, self.bounds = folder, targets, seed, bounds
        self.journal = Journal(folder / "journal.jsonl", seed)
        self.new: list[Path] = []
        self._spent = dict.fromkeys(targets, 0.0)
        self._next = {name: t.next for name, t in self.journal.totals.items()}
        self._workers: dict[Worker, int] = {}
        self._rest: list[tuple[str, int, int]] = []  # of spans whose worker was lost

    def run(self, seconds: float, jobs: int, inputs: float = math.inf) -> None:
        """Run for so long, or so many inputs. Each target gets the same time: fast readers are tried more often."""
        end, begun = time.monotonic() + seconds, self._done()
        try:
            for number in range(jobs):
                self._start(number)
            while self._workers:
                ready, _, _ = select.select([w.reports for w in self._workers], [], [], 0.2)
                for worker in list(self._workers):
                    more = time.monotonic() < end and self._done() - begun < inputs
                    if worker.reports in ready:
                        self._hear(worker, more)
                    else:
                        self._watch(worker, more)
        finally:
            for worker in self._workers:
                os.kill(worker.pid, signal.SIGKILL)
                os.waitpid(worker.pid, 0)
                clear(worker.pid)

    def _start(self, number: int) -> None:
        worker = Worker(self.seed, self.bounds, self.folder / f"worker-{number}.log")
        self._workers[worker] = 0
        self._order(worker)

    def _done(self) -> int:
        return sum(total.inputs for total in self.journal.totals.values())

    def _order(self, worker: Worker) -> None:
        if self._rest:
            worker.give(*self._rest.pop())
            return
        name = min(self.targets, key=lambda n: (self._spent[n], self.targets.index(n)))
        first = self._next.get(name, 0)
        self._next[name] = first + SPAN
        self._spent[name] += 1e-3  # so that two workers do not ask for the same at once
        worker.give(name, first, SPAN)

    def _hear(self, worker: Worker, more: bool) -> None:
        report = worker.read()
        if not report:
            self._lost(worker, more)
            return
        findings = report.pop("findings")
        self.journal.add(report)
        self._spent[report["target"]] += report["cpu"]
        for index, kind, sign, text in findings:
            self._keep(report["target"], index, Verdict(kind, sign, text))
        self._workers[worker] += 1
        if more and self._workers[worker] < SPANS:
            self._order(worker)
        else:
            self._end(worker, more)

    def _watch(self, worker: Worker, more: bool) -> None:
        index, since = worker.at()
        if index != IDLE and since > GRACE * self.bounds.seconds:
            os.kill(worker.pid, signal.SIGKILL)
            self._lost(worker, more, Verdict("hang", f"{worker.target}: no answer, no Python", "killed"))

    def _lost(self, worker: Worker, more: bool, verdict: Verdict | None = None) -> None:
        """A worker is gone: its input is to blame, and another goes on with the one after it."""
        index, _ = worker.at()
        del self._workers[worker]
        _, status = os.waitpid(worker.pid, 0)
        clear(worker.pid)
        verdict = verdict or died(worker.target, status, worker.errors.read_text(errors="replace"))
        first, count = worker.span
        begun = {"target": worker.target, "first": first, "count": index + 1 - first, "cpu": 0.0}
        kinds = {"unheard": index - first, verdict.kind: 1}
        self.journal.add(begun | {"kinds": kinds, "peak_mb": 0, "grown_kb": 0, "longest": [0.0, index]})
        if first + count > index + 1:
            self._rest.append((worker.target, index + 1, first + count - index - 1))
        self._spent[worker.target] += self.bounds.seconds
        worker.close()
        self._keep(worker.target, index, verdict)
        self._replace(worker, more)

    def _end(self, worker: Worker, more: bool) -> None:
        del self._workers[worker]
        worker.close()
        os.waitpid(worker.pid, 0)
        clear(worker.pid)
        self._replace(worker, more)

    def _replace(self, worker: Worker, more: bool) -> None:
        number = int(worker.errors.stem.rpartition("-")[2])
        if more:
            self._start(number)

    def _keep(self, target: str, index: int, verdict: Verdict) -> None:
        data = drawn(TARGETS[target], self.seed, index)
        kept = keep(self.folder, target, data, verdict)
        if kept is not None:
            print(f"{target} input {index}: {verdict.kind}: {verdict.sign} -> {kept}", flush=True)
            self.new.append(kept)
