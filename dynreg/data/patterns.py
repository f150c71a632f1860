"""Regular expressions of a stranger's map, searched for a limited time: `(?:a+)+$` takes longer than anybody lives."""

import json
import re
import subprocess
import sys
from dataclasses import dataclass
from functools import lru_cache

from dynreg.errors import MapError
from dynreg.limits import limits, refuse

_LENGTH = 200  # letters of a pattern that is searched in this process
_POWERS = re.compile(
    r"[*+?{|\[]|\\\d"
)  # with one of these at most, a search takes at most the square of the text

_CHILD = """
import json, re, sys
pattern, text = json.load(sys.stdin)
try:
    compiled = re.compile(pattern)
    found = compiled.search(text)
    told = [compiled.groups, found.group(1) if found and compiled.groups else None, ""]
except Exception as error:
    told = [0, None, str(error) or type(error).__name__]
print(json.dumps(told))
"""


@dataclass(frozen=True)
class Search:
    """The result of a search: the pattern's groups, the text of the first one, and what is wrong with the pattern."""

    groups: int
    found: str | None
    problem: str = ""


@lru_cache(maxsize=1024)
def search(pattern: str, text: str) -> Search:
    """Search a text for a pattern: a plain one here, any other in a process of its own, which is ended in time.

    Raises MapError past the limit `pattern_seconds`.

    >>> search("kp([0-9]+)", "steps_kp400").found
    '400'
    """
    if len(pattern) <= _LENGTH and len(_POWERS.findall(pattern)) <= 1:
        try:
            compiled = re.compile(pattern)
        except (re.error, RecursionError, OverflowError) as error:
            return Search(0, None, str(error))
        found = compiled.search(text)
        return Search(compiled.groups, found.group(1) if found and compiled.groups else None)
    seconds = limits().pattern_seconds
    try:
        ended = subprocess.run(
            [sys.executable, "-I", "-S", "-c", _CHILD],
            input=json.dumps([pattern, text]),
            capture_output=True,
            text=True,
            encoding="utf-8",
            timeout=seconds,
        )
        return Search(*json.loads(ended.stdout))
    except subprocess.TimeoutExpired:
        refuse(
            MapError,
            f"the pattern {pattern!r} is still searching {text!r}, seconds",
            seconds,
            "pattern_seconds",
        )
    except ValueError:  # it ended without a word
        return Search(0, None, "it cannot be searched")
