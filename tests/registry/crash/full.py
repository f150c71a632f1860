"""Every crash state and every refused change of every scenario: `python tests/registry/crash/full.py [SCENARIO ...]`.

Prints, for each scenario, how many states were replayed and how many changes refused, and what was wrong after them.
States are built on /dev/shm where there is one (syncs cost nothing there), else in the folder for temporary files.
"""

import argparse
import shutil
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # registry_contents

from checking import Tally, crash_states, record, refusals, replay_states  # noqa: E402
from scenarios import SCENARIOS  # noqa: E402


def main() -> int:
    """0 where nothing was wrong."""
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    asked.add_argument("scenarios", nargs="*", metavar="SCENARIO", help=f"some of {', '.join(SCENARIOS)}")
    asked.add_argument("--lines", type=int, default=5, help="so many lines of each kind of wrong are printed")
    asked.add_argument(
        "--share", type=float, default=1.0, help="of the states and refused changes, drawn at random"
    )
    told = asked.parse_args()
    memory = Path("/dev/shm")
    base = Path(tempfile.mkdtemp(dir=memory if memory.is_dir() else None))
    states, refused = Tally(), Tally()
    try:
        for name in told.scenarios or SCENARIOS:
            begun = time.process_time()
            recorded = record(SCENARIOS[name], base / name)
            here, there = Tally(), Tally()
            replay_states(recorded, crash_states(recorded.journal, told.share), base / name / "states", here)
            print(f"{name}: {len(recorded.journal.changes)} changes; crash states: {here}", flush=True)
            refusals(recorded, base / name / "refused", there, told.share)
            print(f"{name}: refused changes: {there}; {time.process_time() - begun:.0f} s", flush=True)
            for tally, whole in ((here, states), (there, refused)):
                whole.take(tally)
                for kind, lines in tally.wrong.items():
                    for line in list(lines.values())[: told.lines]:
                        print(f"  {kind}: {line}", flush=True)
            shutil.rmtree(base / name)
    finally:
        shutil.rmtree(base)
    print(f"crash states replayed: {states}\nwrites, syncs and renames refused: {refused}")
    return 1 if states.wrong or refused.wrong else 0


if __name__ == "__main__":
    sys.exit(main())
