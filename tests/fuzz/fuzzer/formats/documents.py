"""Documents that a registry keeps: results, which are read and shown, and journals of searches."""

import hashlib
import json
import random
from functools import cache
from io import StringIO
from typing import Any

import made_up_results
from pydantic import ValidationError
from rich.console import Console

from dynreg.errors import CorruptError
from dynreg.report.tables import render, shown_again
from dynreg.results import RESULTS
from dynreg.search.journal import Journal
from fuzzer.mutate import lines, raw, text, tree
from fuzzer.scratch import held
from fuzzer.target import Target, obeyed

_KEY = {"robot": "ab" * 32, "seed": 0, "method": "cmaes"}
_WORDS = (
    '"asked"',
    '"grades"',
    '"check"',
    "[[1.0]]",
    "[]",
    "{}",
    "NaN",
    "1e999",
    "null",
    '"schema"',
    "-1",
    "[" * 600,
)


def make_result(rng: random.Random) -> bytes:
    """A stored result of some kind, with nodes of its tree changed."""
    kind, document = rng.choice(_documents())
    line = json.dumps([kind, tree(rng, document)])
    return (text(rng, line) if rng.random() < 0.05 else line).encode("utf-8", "surrogatepass")


def check_result(data: bytes) -> None:
    """Read a result as `show` does, and print it as a table of 80 columns."""
    try:
        kind, document = json.loads(data)
        result = RESULTS[kind].model_validate(document)
    except (ValueError, TypeError, KeyError, RecursionError, ValidationError) as error:
        raise CorruptError("the document does not read", expected="a result", do="make it again") from error
    out = StringIO()
    with shown_again(result):
        tables = render(result)
    Console(file=out, width=80).print(tables)
    if found := obeyed(out.getvalue().replace("\n", "")):
        raise ValueError(f"a terminal would obey {found!r}")


def make_journal(rng: random.Random) -> bytes:
    """A journal of three steps with lines or bytes changed; the checksums hold in some."""
    rows = [{"schema": "dynreg/search/1", "search": _KEY}]
    rows += [{"asked": _asked(), "grades": [[0.5, k / 4], [1.0, 2.0]]} for k in range(3)]
    if rng.random() < 0.6:
        at = rng.randrange(len(rows))
        rows[at] = tree(rng, rows[at])
    told = "".join(json.dumps(row) + "\n" for row in rows)
    if rng.random() < 0.5:
        told = lines(rng, told, _WORDS)
    data = told.encode("utf-8", "surrogatepass")
    return raw(rng, data) if rng.random() < 0.2 else data


def _asked() -> str:
    return hashlib.sha256(bytes(8 * 2 * 3)).hexdigest()[:32]  # of six zeros


def check_journal(data: bytes) -> None:
    """Go on with a search from its journal."""
    import numpy as np

    journal = Journal(held("search/journal.jsonl", data), _KEY, resume=True)
    journal.next(np.zeros((2, 3)))


@cache
def _documents() -> tuple[tuple[str, dict], ...]:
    kinds = {cls: kind for kind, cls in RESULTS.items()}
    made = [result for result in made_up_results.every_kind() if type(result) in kinds]
    return tuple((kinds[type(result)], _short(json.loads(result.model_dump_json()))) for result in made)


def _short(value: Any) -> Any:
    """The same with four of each list: the curves are long."""
    if isinstance(value, dict):
        return {key: _short(one) for key, one in value.items()}
    return [_short(one) for one in value[:4]] if isinstance(value, list) else value


TARGETS = (
    Target("result", make_result, check_result),
    Target("search-journal", make_journal, check_journal),
)
