"""Writes what pages of docs/ hold of the program itself: help of commands, keys of files, JSON documents.

    python docs/hooks/made.py

A page holds it between `<!-- made: NAME WORDS -->` and `<!-- end -->`; `MADE[NAME]` says what stands there. A test
keeps the pages equal to the program.
"""

import re
from pathlib import Path

import commands
import documents
import reference

DOCS = Path(__file__).parents[1]
MADE = {
    "robot_file": reference.robot_file,
    "map_file": reference.map_file,
    "methods": reference.methods,
    "plan_file": reference.plan_file,
    "help": commands.help_of,
    "commands": commands.index,
}
_PART = re.compile(r"^(<!-- made: (\w+) ?([^\n]*?) -->)$(?:.*?^<!-- end -->$)", re.DOTALL | re.MULTILINE)


def pages() -> dict[str, str]:
    """{path below docs/: text} of every page that holds what is made, as it should be."""
    found = {}
    for path in sorted(DOCS.rglob("*.md")):
        text = path.read_text(encoding="utf-8")
        if _PART.search(text):
            found[path.relative_to(DOCS).as_posix()] = filled(text)
    for name in commands.names():
        found.setdefault(
            commands.page_of(name), filled(f"# dynreg {name}\n\n<!-- made: help {name} -->\n<!-- end -->\n")
        )
    return found | documents.pages()


def filled(text: str) -> str:
    """A page with all that is made in its place."""
    return _PART.sub(
        lambda part: f"{part[1]}\n\n{MADE[part[2]](*([part[3]] if part[3] else []))}\n\n<!-- end -->", text
    )


def main() -> None:
    """Write the pages that differ, and say which."""
    wanted = pages()
    for path in DOCS.glob("schemas/*.md"):
        if path.relative_to(DOCS).as_posix() not in wanted:
            path.unlink()
    for name, text in wanted.items():
        path = DOCS / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8")
            print(f"docs/{name}")


if __name__ == "__main__":
    main()
