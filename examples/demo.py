"""From an empty registry to the simulator that behaves like the servo on the bench: `make demo`.

Runs the command lines that it prints. The log is the measured XL330 bench of Rhoban/bam where DYNREG_DATA_DIR
(or ../shared/data) holds a copy, else a simulated servo whose parameters dynreg is not told.
"""

import argparse
import os
import shlex
import sys
import textwrap
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from glob import glob
from pathlib import Path

import hidden_servo

from dynreg import session
from dynreg.cli.main import main as dynreg
from dynreg.cli.output import WIDTH
from dynreg.report.neighbours import verdict
from dynreg.report.words import interval, number
from dynreg.results import Neighbours

ROOT = Path(__file__).parents[1]
NO_MATCH = 4  # the exit status of a query whose answer is far from the robot: told, and no reason to stop


@dataclass(frozen=True)
class Log:
    """What the demo looks at: the recording's name, how a shell names its files, the map and the secret."""

    name: str
    pattern: str
    log_map: Path | None = None
    secret: dict[str, float] | None = None


def main(arguments: list[str] | None = None) -> int:
    """Run the demo; the exit status is that of the first command that failed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--n", type=int, default=1000, help="simulators in the registry")
    parser.add_argument("--folder", type=Path, default=ROOT / "demo", help="where all of it is put")
    parser.add_argument("--hidden", action="store_true", help="the simulated servo, measured logs or not")
    parser.add_argument("--seconds", type=float, default=6.0, help="length of its runs")
    given = parser.parse_args(arguments)
    folder = _near(given.folder)
    folder.mkdir(parents=True, exist_ok=True)
    log = None if given.hidden else measured_log()
    log = log or hidden_log(folder, given.seconds)
    with _registry(folder / "registry") as registry:
        try:
            found = walk(log, given.n, folder / "report.html", registry)
        except SystemExit as stopped:
            return int(stopped.code or 0)
    _close(log, found, folder / "report.html")
    return 0


def measured_log() -> Log | None:
    """The XL330 bench's sixteen runs, or None where there is no copy."""
    data = Path(os.environ.get("DYNREG_DATA_DIR", ROOT.parent / "shared" / "data"))
    runs = data / "bam_xl330_pendulum" / "raw"
    if not any(runs.glob("*.json")):
        return None
    print("# measured: a Dynamixel XL330 servo swings a pendulum (Rhoban/bam), 16 runs of 6 s at four gains")
    return Log("xl330", str(_near(runs) / "*.json"))


def hidden_log(folder: Path, seconds: float) -> Log:
    """A simulated bench, recorded into MCAP files below `folder`."""
    print("# simulated: a servo with secret parameters, 16 runs at four gains, recorded to MCAP files")
    made = hidden_servo.record(folder / "hidden", seconds=seconds)
    return Log("hidden", str(folder / "hidden" / "*.mcap"), _near(made.log_map), made.secret)


def walk(log: Log, n: int, page: Path, registry: Path) -> Neighbours:
    """The session, command by command; SystemExit where one fails."""
    run("populate", "servo_pendulum", "-n", n)
    with_map = ("--map", log.log_map) if log.log_map else ()
    run("ingest", log.pattern, "--robot", "servo_pendulum", *with_map, "--name", log.name)
    run("list")
    run("query", log.name, "-k", 5, "--hold-out", "kp=400", may_end=(0, NO_MATCH))
    with session.open(registry, create=False) as opened:
        found = opened.result("@last")
    run("show", found.answer[:12])
    run("report", "@last", "--out", page)
    return found


def run(*words: str | int | Path, may_end: tuple[int, ...] = (0,)) -> None:
    """Print a command line and run it in this process, patterns of files spelled out as a shell does."""
    texts = [str(word) for word in words]
    print(f"\n$ dynreg {' '.join(t if '*' in t else shlex.quote(t) for t in texts)}", flush=True)
    status = dynreg([part for text in texts for part in (sorted(glob(text)) if "*" in text else [text])])
    if status not in may_end:
        sys.exit(status)


@contextmanager
def _registry(path: Path) -> Iterator[Path]:
    """The registry that the commands use, for as long as the demo runs."""
    before = os.environ.get("DYNREG_REGISTRY")
    print(f"\n$ export DYNREG_REGISTRY={path}")
    os.environ["DYNREG_REGISTRY"] = str(path)
    try:
        yield path
    finally:
        os.environ.pop("DYNREG_REGISTRY")
        if before is not None:
            os.environ["DYNREG_REGISTRY"] = before


def _close(log: Log, found: Neighbours, page: Path) -> None:
    if log.secret and found.synthesised:
        print("\nThe secret beside what the query found. Of ten 90 % intervals one may miss:\n")
        print(f"  {'parameter':18}{'secret':>10}   found")
        for name, estimate in found.synthesised.parameters.items():
            hit = estimate.low <= log.secret[name] <= estimate.high
            told = f"{interval(estimate)} {estimate.unit}"
            print(f"  {name:18}{number(log.secret[name]):>10}   {told}{'' if hit else '   <- missed'}")
    print("\n" + textwrap.fill(verdict(found), WIDTH))
    print(f"Look at {page} in a browser.")


def _near(path: Path) -> Path:
    """The path as one would type it here."""
    near = Path(os.path.relpath(path))
    return path if near.parts.count("..") > 2 else near


if __name__ == "__main__":
    sys.exit(main())
