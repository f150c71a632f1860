"""Pages whose blocks are run: commands and Python, one after the other, in one registry.

A ```console block holds commands after `$ ` and what they print. A ```python block is a program of its own; what it
prints stands in the ```text block below it. A line `...` stands for lines that are left out. A command that ends with
`| head -N` or `> FILE` is run as a shell does. ```sh blocks are not run: they name files that a reader has.

    python tests/executed_pages.py README.md docs/tutorial.md

runs the pages in this order and writes what is printed into them (`make pages`: all of them).

What a page says and what is printed agree where their words are the same and in the same order. Seconds of the clock
are never compared. On the machine that wrote the pages, every number and every id is the same. Another processor rounds
in other ways: there a number may be off by `WITHIN` of itself or by `LAST` units of its last printed digit, and an id
that hangs on such numbers is another one, but the same other one wherever the pages have it.
"""

import io
import os
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter

ROOT = Path(__file__).parents[1]
QUICK = ("README.md", "docs/tutorial.md")  # run by `make test`
VERBS = (
    "populate",
    "ingest",
    "list",
    "show",
    "query",
    "report",
    "effects",
    "diagnose",
    "calibrate",
    "compare",
    "excite",
    "trial",
    "gait",
    "export",
    "doctor",
    "robots_init",
    "robots_list",
    "robots_check",
    "robots_copy",
    "drift",
    "navigate",
    "verify",
    "gc",
    "rm",
    "import",
)
SESSION = (
    *QUICK,
    "docs/python.md",
    "docs/datasets.md",
    "docs/wheeled.md",
    *(f"docs/verbs/{name}.md" for name in VERBS),
)
LANGUAGES = {"console", "python", "text", "sh", "toml", "json", "xml"}
NO_MATCH = 4  # the exit status of a query whose answer is far from the robot: the page tells it
WITHIN = 0.1
LAST = 2
_BLOCK = re.compile(
    r"^```(?P<language>console|python)\n(?P<body>.*?)^```\n(?P<text>\n```text\n.*?^```\n)?",
    re.DOTALL | re.MULTILINE,
)
# Seconds of the clock: the last column of a table whose head ends with "time [s]", and a number before " s" that
# - ends a line with "cost:" or "added in", or follows the simulations in it,
# - stands alone in its line,
# - is that of "a diagnosis".
_CLOCK = re.compile(
    r"(?:(?<=, )|(?<=in )|^)[\d.]+ s$|(?<=simulations, )[\d.]+ s(?=,)|[\d.]+ s(?= a diagnosis)"
    r"|(?<=of a diagnosis )[\d.]+(?= s$|$)"
)
_TIMED = re.compile(r"cost:|population |[\d.]+ s$|.* a diagnosis( [\d.]+)?( s)?$")
_ID = re.compile(r"[0-9a-f]{8,}")
_NUMBER = re.compile(r"[+-]?\d[\d,]*(?:\.\d+)?(?:e[+-]?\d+)?")
# An id may end a name, after its last underscore.
_TOKEN = re.compile(
    rf"(?<![^\W_])(?<!\.)(?P<id>{_ID.pattern})\b|(?<![\w.])(?P<number>{_NUMBER.pattern})"
    rf"|(?:(?!_{_ID.pattern}\b)[^\W\d])+|[^\w\s]|_"
)
_RULE = re.compile(r"─+")


@dataclass(frozen=True)
class Block:
    """A block of a page: commands, or Python; `at` is where it stands in the page's text."""

    language: str
    body: str
    at: tuple[int, int]


@dataclass
class Runner:
    """Runs blocks in a folder that looks like a checkout beside its data; `seconds` each command took."""

    folder: Path
    seconds: dict[str, float] = field(default_factory=dict)

    def printed(self, block: Block) -> str:
        """The block as it should stand: its code, and what that prints."""
        if block.language == "python":
            Path("page.py").write_text(block.body, encoding="utf-8")
            out = self.run("python page.py")
            said = f"\n```text\n{out}```\n" if out else ""
            return f"```python\n{block.body}```\n{said}"
        answers = [f"$ {line}\n{self.run(line)}" for line in commands(block.body)]
        return "```console\n" + "".join(answers) + "```\n"

    def run(self, line: str) -> str:
        """What a command line prints; an error is told with the command."""
        began = perf_counter()
        plain, file = line.partition(" > ")[::2]
        plain, lines = plain.partition(" | head -")[::2]
        out = _answer(plain)
        self.seconds[line] = perf_counter() - began
        if file:
            Path(file).write_text(out, encoding="utf-8")
            return ""
        told = [one.rstrip() for one in out.splitlines()]
        return "".join(f"{one}\n" for one in (told[: int(lines)] if lines else told))


def _answer(line: str) -> str:
    from dynreg.cli.main import main

    words = [
        path
        for word in shlex.split(line)
        for path in (sorted(map(str, Path().glob(word))) if "*" in word else [word])
    ]
    if words[0] == "python":
        ran = subprocess.run([sys.executable, *words[1:]], capture_output=True, text=True)
        assert ran.returncode == 0, f"{line}: {ran.stderr}"
        return ran.stdout
    if words[0] == "cat":
        return "".join(Path(word).read_text(encoding="utf-8") for word in words[1:])
    assert words[0] == "dynreg", line
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        status = main(words[1:])
    allowed = (0, NO_MATCH) if words[1] == "query" else (0,)
    assert status in allowed, f"{line}: exit status {status}: {err.getvalue()}"
    return out.getvalue()


def blocks(text: str) -> Iterator[Block]:
    """The blocks of a page that are run, in order."""
    for found in _BLOCK.finditer(text):
        yield Block(found["language"], found["body"], found.span())


def languages(text: str) -> list[str]:
    """What is said after the opening of each fence of a page, in order; "" of a bare one."""
    return [line.removeprefix("```").strip() for line in text.splitlines() if line.startswith("```")][::2]


def section(text: str, title: str) -> str:
    """A page's section with this title of the second level."""
    return text.partition(f"\n## {title}\n")[2].partition("\n## ")[0]


def commands(body: str) -> list[str]:
    """The command lines of a console block."""
    return [line[2:] for line in body.splitlines() if line.startswith("$ ")]


def run_page(runner: Runner, text: str) -> str:
    """The page with what its blocks print."""
    out, end = [], 0
    for block in blocks(text):
        old = text[block.at[0] : block.at[1]]
        out += [text[end : block.at[0]], shortened(old, runner.printed(block))]
        end = block.at[1]
    return "".join([*out, text[end:]])


def shortened(old: str, new: str) -> str:
    """`new` with the lines left out that `old` leaves out by `...`.

    A command's answer is shortened by itself; all of it stands where the line after `...` is no longer printed.
    """
    return "".join(map(_shortened, _answers(old), _answers(new)))


def _answers(block: str) -> list[str]:
    """The lines of a block, parted before each command."""
    return re.split(r"^(?=\$ )", block, flags=re.MULTILINE)


def _shortened(old: str, new: str) -> str:
    lines, told = old.splitlines(), new.splitlines()
    if "..." not in lines:
        return new
    out, at = [], 0
    for number, line in enumerate(lines):
        if line == "...":
            following = next(iter(lines[number + 1 :]), None)
            rest = [i for i in range(at, len(told)) if _alike(told[i], following)]
            if not rest:
                return new
            at = rest[0]
            out.append(line)
        else:
            if at >= len(told):
                return new
            out.append(told[at])
            at += 1
    return "\n".join([*out, *told[at:]]) + "\n"


def _alike(line: str, other: str | None) -> bool:
    """Whether two lines begin with the same words, whatever their numbers."""
    if other is None:
        return False
    (mine, its) = (
        [word for _, word in tokens([one]) if not _NUMBER.fullmatch(word)] for one in (line, other)
    )
    return mine[:3] == its[:3]


def comparable(lines: list[str]) -> list[str]:
    """Lines without the times of the clock."""
    out, table = [], False
    for line in lines:
        table = line.endswith("time [s]") or (table and bool(line.strip()) and not line.startswith("next:"))
        if table:
            line = re.sub(r" +[\d.]+$", " T", line)
        elif _TIMED.match(line):
            line = _CLOCK.sub(lambda found: "T s" if found[0].endswith("s") else "T", line)
        out.append(line.rstrip())
    return out


def tokens(lines: list[str]) -> list[tuple[int, str]]:
    """(line, token): ids, numbers, words and marks, wherever lines are wrapped and however wide columns are."""
    return [
        (number, found[0])
        for number, line in enumerate(lines)
        for found in _TOKEN.finditer(_RULE.sub("─", line))
    ]


def difference(page: str, old: str, new: str, *, strict: bool, ids: dict[str, str] | None = None) -> str:
    """The first difference between what a page says and what is printed; "" where there is none.

    ids : of the pages, with what was printed in their place so far; it grows. strict : on the machine of the pages.
    """
    ids = {} if ids is None else ids
    said, printed = (text.splitlines() for text in (old, new))
    mine, its = tokens(comparable(said)), tokens(comparable(printed))
    for (at, one), (where, other) in zip(mine, its, strict=False):
        if not _same(one, other, strict, ids):
            return f"{page}:\n- {said[at]}\n+ {printed[where]}\n  ({one} -> {other})"
    if len(mine) != len(its):
        many = min(len(mine), len(its))
        longer, lines, mark = (mine, said, "-") if len(mine) > many else (its, printed, "+")
        return f"{page}:\n{mark} {lines[longer[many][0]]}"
    return ""


def _same(one: str, other: str, strict: bool, ids: dict[str, str]) -> bool:
    if strict or one == other:
        return one == other
    if _hash(one) and _hash(other):
        short = one[:8], other[:8]
        return ids.setdefault(short[0], short[1]) == short[1] and len(one) == len(other)
    if _NUMBER.fullmatch(one) and _NUMBER.fullmatch(other):
        return close(one, other)
    return False


def _hash(word: str) -> bool:
    return bool(_ID.fullmatch(word)) and bool(re.search("[a-f]", word) or len(word) > 10)


def close(one: str, other: str) -> bool:
    """Whether two printed numbers differ by no more than `WITHIN` of their size or `LAST` units of the last digit."""
    a, b = (float(word.replace(",", "")) for word in (one, other))
    digits = max(len(re.sub("e.*", "", word).partition(".")[2]) for word in (one, other))
    power = max(int(word.partition("e")[2] or 0) for word in (one, other))
    return abs(a - b) <= max(WITHIN * max(abs(a), abs(b)), LAST * 10.0 ** (power - digits) * 1.001)


@contextmanager
def checkout(place: Path, data: Path | None) -> Iterator[Path]:
    """A folder like a checkout, with `data` where pages look for it; the working folder for as long."""
    folder = place / "dynreg"
    folder.mkdir(parents=True)
    (place / "shared").mkdir()
    if data is not None:
        (place / "shared" / "data").symlink_to(data.resolve())
    for name in ("examples", "notebooks"):
        (folder / name).symlink_to(ROOT / name)
    before, registry = Path.cwd(), os.environ.pop("DYNREG_REGISTRY", None)
    os.chdir(folder)
    try:
        yield folder
    finally:
        os.chdir(before)
        if registry is not None:
            os.environ["DYNREG_REGISTRY"] = registry


def main(pages: list[str]) -> None:
    """Write what is printed into these pages, else into all of the session."""
    data = Path(os.environ.get("DYNREG_DATA_DIR", ROOT.parent / "shared" / "data"))
    if not data.is_dir():
        sys.exit(f"no logs in {data}: set DYNREG_DATA_DIR to a folder with copies of them (docs/data.md)")
    with tempfile.TemporaryDirectory() as place, checkout(Path(place), data) as folder:
        for page in pages or SESSION:
            runner, began = Runner(folder), perf_counter()
            old = (ROOT / page).read_text(encoding="utf-8")
            (ROOT / page).write_text(run_page(runner, old), encoding="utf-8")
            print(f"{page}: {perf_counter() - began:.0f} s", flush=True)
            for line, seconds in runner.seconds.items():
                if seconds > 5.0:
                    print(f"  {seconds:.0f} s: {line}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
