"""Write the golden documents anew: all, or those of the cases that are named.

Each case is run in three fresh processes, twice on one thread and once on two; what differs is told, and the case's
file then stays as it was.

    python tests/golden/write.py [CASE ...]
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

from golden.cases import CASES, Place  # noqa: E402
from golden.comparing import NETWORKS, STRICT, brief, differences, fingerprint  # noqa: E402

THREADS = (1, 1, 2)


def main(names: list[str]) -> int:
    """Write these cases; 1 where one was not the same every time."""
    failed = []
    for name in names or CASES:
        print(f"{name} ...", flush=True)
        found = [made(name, threads) for threads in THREADS]
        within = NETWORKS if name == "compare_networks" else STRICT
        apart = [line for other in found[1:] for line in differences(found[0], other, within=within)]
        if apart:
            failed.append(name)
            print("\n".join([f"  not the same every time, {len(apart)} values:", *apart[:20]]), flush=True)
        else:
            store(name, found[0])
    store("machine", fingerprint())
    return 1 if failed else 0


def made(name: str, threads: int) -> dict:
    """The document of a case, made in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        here = [sys.executable, __file__, "--one", name, str(threads), folder]
        subprocess.run(here, check=True)
        return json.loads((Path(folder) / "made.json").read_text(encoding="utf-8"))


def one(name: str, threads: str, folder: str) -> None:
    """Run a case and leave its document in the folder."""
    data = Path(os.environ.get("DYNREG_DATA_DIR", HERE.parents[2] / "shared" / "data"))
    work = Path(folder) / "work"
    work.mkdir()
    document = CASES[name](Place(work, data if data.is_dir() else None, int(threads)))
    (Path(folder) / "made.json").write_text(json.dumps(brief(document)), encoding="utf-8")


def store(name: str, document: dict) -> None:
    """The document in its file, a line for each value so that a change can be read."""
    text = json.dumps(document, indent=1, ensure_ascii=False)
    (HERE / f"{name}.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        one(*sys.argv[2:])
    else:
        sys.exit(main(sys.argv[1:]))
