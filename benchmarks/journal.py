"""The journal of a long benchmark: a line of JSON for each finished step, so that a second start goes on."""

import json
import os
from pathlib import Path
from typing import Any

import portalocker


class Journal:
    """Lines of JSON under a head that says which table they are of; several processes may add to it.

    Raises SystemExit where the file is that of another table.
    """

    def __init__(self, path: Path, head: dict[str, Any]):
        self.path, self._head = path, json.loads(json.dumps(head))

    def begin(self) -> None:
        """Make the file, or leave out a last line that was not written to its end."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        text = self.path.read_text(encoding="utf-8") if self.path.is_file() else ""
        whole = text[: text.rfind("\n") + 1]
        if whole and json.loads(whole.splitlines()[0]) != self._head:
            raise SystemExit(f"{self.path} is the journal of another table: name another with --journal")
        temporary = self.path.with_suffix(".writing")
        temporary.write_text(whole or json.dumps(self._head) + "\n", encoding="utf-8")
        os.replace(temporary, self.path)

    def add(self, line: dict[str, Any]) -> dict[str, Any]:
        """Keep a line, on disk when this returns; the same as it will be read."""
        text = json.dumps(line) + "\n"
        with open(self.path, "ab", buffering=0) as file:
            portalocker.lock(file, portalocker.LockFlags.EXCLUSIVE)
            file.write(text.encode())
            os.fsync(file.fileno())
        return json.loads(text)

    def lines(self) -> list[dict[str, Any]]:
        """What was added, in that order."""
        return [json.loads(line) for line in self.path.read_text(encoding="utf-8").splitlines()[1:]]
