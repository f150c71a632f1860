"""From an empty registry to the cause that makes a simulation wrong: `make demo`.

Runs the command lines that it prints. The log is the measured XL330 bench of Rhoban/bam where DYNREG_DATA_DIR
(or ../shared/data) holds a copy. Elsewhere it is a simulated servo with hidden parameters and a hidden effect, and the
secret is shown beside the answer.
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
from dynreg.report.words import interval, number
from dynreg.results import Diagnosis

ROOT = Path(__file__).parents[1]
NO_MATCH = 4  # the exit status of a query whose answer is far from the robot: told, and no reason to stop
LOAD_FRICTION = 0.15  # of the simulated servo: between the medium size of the effect and the strong one


@dataclass(frozen=True)
class Log:
    """What the demo looks at: the recording's name, how a shell names its files, and what only a simulation knows.

    tolerance : factor on the nameplate's tolerances. secret : parameters and the effect's size.
    """

    name: str
    pattern: str
    tolerance: float
    log_map: Path | None = None
    secret: dict[str, float] | None = None


def main(arguments: list[str] | None = None) -> int:
    """Run the demo; the exit status is that of the first command that failed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--n", type=int, default=200, help="simulators in the registry")
    parser.add_argument("--folder", type=Path, default=ROOT / "demo", help="where all of it is put")
    parser.add_argument("--hidden", action="store_true", help="the simulated servo, measured logs or not")
    parser.add_argument("--seconds", type=float, default=6.0, help="length of its runs")
    parser.add_argument("--effects", help="the effects that may be named; all by default")
    given = parser.parse_args(arguments)
    folder = _near(given.folder)
    folder.mkdir(parents=True, exist_ok=True)
    log = None if given.hidden else measured_log()
    log = log or hidden_log(folder, given.seconds)
    with _registry(folder / "registry") as registry:
        try:
            found = walk(log, given.n, folder / "report.html", registry, given.effects)
        except SystemExit as stopped:
            return int(stopped.code or 0)
    _close(log, found, folder / "report.html")
    return 0


def measured_log() -> Log | None:
    """The XL330 bench's sixteen runs, or None where there is no copy."""
    data = Path(os.environ.get("DYNREG_DATA_DIR", ROOT.parent / "shared" / "data"))
    runs = data / "bam_xl330_pendulum" / "raw"
    if not any(runs.glob("*.json")):
        print(f"# no real logs in {_near(data)}: a simulated servo stands in")
        return None
    print("# measured: a Dynamixel XL330 servo swings a pendulum (Rhoban/bam), 16 runs of 6 s at four gains")
    return Log("xl330", str(_near(runs) / "*.json"), tolerance=5.0)  # the bench's nameplate is a guess


def hidden_log(folder: Path, seconds: float) -> Log:
    """A simulated bench with a hidden effect, recorded into MCAP files below `folder`."""
    print(
        "# simulated: a servo with a hidden effect and hidden parameters, 16 runs at four gains, in MCAP files"
    )
    made = hidden_servo.record(folder / "hidden", seconds=seconds, load_friction=LOAD_FRICTION)
    secret = made.secret | {"load_friction": LOAD_FRICTION}
    return Log("hidden", str(folder / "hidden" / "*.mcap"), 1.0, _near(made.log_map), secret)


def walk(log: Log, n: int, page: Path, registry: Path, effects: str | None = None) -> Diagnosis:
    """The session, command by command; SystemExit where one fails."""
    run("populate", "servo_pendulum", "-n", n)
    with_map = ("--map", log.log_map) if log.log_map else ()
    run("ingest", log.pattern, "--robot", "servo_pendulum", *with_map, "--name", log.name)
    run("query", log.name, "--hold-out", "kp=400", may_end=(0, NO_MATCH))
    print("\n# What do all of these simulators lack? About a minute of two cores:")
    told = ("--tolerance", f"{log.tolerance:g}") if log.tolerance != 1.0 else ()
    some = ("--effects", effects) if effects else ()
    run("diagnose", log.name, "--hold-out", "kp=400", *told, *some)
    run("report", "@last", "--out", page)
    with session.open(registry, create=False) as opened:
        return opened.result("@last")


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


def _close(log: Log, found: Diagnosis, page: Path) -> None:
    if log.secret:
        _reveal(log.secret, found)
    print()
    for line in story(found):
        print(textwrap.fill(line, WIDTH, subsequent_indent="  "))
    print(f"Look at {page} in a browser.")


def story(found: Diagnosis) -> list[str]:
    """The cause, and the held-out error before and after it."""
    if not found.causes:
        return [f"No cause was named. {found.sentence}"]
    error, told = found.error, found.causes[0]
    causes = ", ".join(cause.key for cause in found.causes)
    before = f"{number(error.nominal)} {error.unit} (nominal), {number(error.calibrated)} {error.unit} (calibrated)"
    return [
        f"Cause: {causes} ({told.title}).",
        f"Held-out error of {error.channel}: {before}, {number(error.extended)} {error.unit} with the cause.",
    ]


def _reveal(secret: dict[str, float], found: Diagnosis) -> None:
    """The secret of the simulated servo beside what was found."""
    sizes = {cause.key: next(iter(cause.parameters.values())) for cause in found.causes}
    print("\nThe secret beside the answer. The servo ran on another engine than the diagnosis:\n")
    print(f"  {'':18}{'secret':>10}   found")
    for name, value in sorted(secret.items(), key=lambda item: item[0] != "load_friction"):
        estimate = (sizes | dict(found.parameters)).get(name)
        if estimate is None:
            print(f"  {name:18}{number(value):>10}   not named")
            continue
        hit = estimate.low <= value <= estimate.high
        print(
            f"  {name:18}{number(value):>10}   {interval(estimate)} {estimate.unit}{'' if hit else '   <- missed'}"
        )


def _near(path: Path) -> Path:
    """The path as one would type it here."""
    near = Path(os.path.relpath(path))
    return path if near.parts.count("..") > 2 else near


if __name__ == "__main__":
    sys.exit(main())
