"""The fuzzer's command: `make fuzz SECONDS=60 TARGETS=mcap,csv JOBS=2`.

Inputs are drawn by their number, so the same seed tries the same ones; a journal remembers how far it came.
"""

import argparse
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1]))  # made-up results, which the tests have
FOLDER = Path(__file__).parents[2] / ".fuzz"


def main() -> int:
    """Run the loop, try one file, or print what was run so far; 1 where something was found."""
    asked = _asked()
    from fuzzer.journal import Journal, table

    if asked.totals:
        print(table(Journal(asked.folder / "journal.jsonl", asked.seed).totals))
        return 0
    if asked.engine == "atheris":  # before the readers are imported, which it instruments on the way
        from fuzzer.guided import run_guided

        return run_guided(asked.folder, asked.targets, asked.seed, asked.seconds, asked.limit, asked.memory)
    from fuzzer.table import TARGETS
    from fuzzer.worker import Bounds

    bounds = Bounds(asked.limit, asked.memory)
    names = asked.targets.split(",") if asked.targets else list(TARGETS)
    unknown = [name for name in names if name not in TARGETS]
    if unknown:
        print(f"no target {unknown[0]!r}; there are {', '.join(TARGETS)}", file=sys.stderr)
        return 2
    if asked.file:
        from fuzzer.findings import alone

        verdict = alone(names[0], asked.file.read_bytes(), bounds)
        print(f"{verdict.kind}: {verdict.sign}\n{verdict.text}")
        return 0 if verdict.good else 1
    from fuzzer.findings import make_small
    from fuzzer.loop import Loop

    loop = Loop(asked.folder, names, asked.seed, bounds)
    try:
        loop.run(asked.seconds, asked.jobs)
    except KeyboardInterrupt:
        print("stopped; the same command goes on from here")
    print(table(loop.journal.totals))
    for path in loop.new:
        make_small(path, bounds)
    print(f"{len(loop.new)} new findings under {asked.folder}")
    return 1 if loop.new else 0


def _asked() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=60.0, help="how long to run")
    parser.add_argument("--targets", default="", help="names, with commas between; all where none is given")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--seed", type=int, default=0, help="of the inputs")
    parser.add_argument("--folder", type=Path, default=FOLDER, help="where the journal and the findings lie")
    parser.add_argument(
        "--limit", type=float, default=5.0, help="seconds of the processor that one input may take"
    )
    parser.add_argument("--memory", type=int, default=512, help="megabytes that one input may take")
    parser.add_argument(
        "--engine", choices=("own", "atheris"), default="own", help="atheris follows coverage"
    )
    parser.add_argument("--file", type=Path, help="try this one input on the target")
    parser.add_argument("--totals", action="store_true", help="print what the journal tells, and end")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
