"""A robot.toml read as far as it goes: all that is wrong in it, and the file that is left without those parts."""

import difflib
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from dynreg.data.names import joint_of
from dynreg.sim.consistency import inconsistencies
from dynreg.sim.finding import Finding, Said
from dynreg.sim.spec import RobotFile
from dynreg.tomlfile import Location, fault_of, line_of, toml_document

ROUNDS = 20  # of taking out what is wrong; each brings out what the last one hid
_AT = re.compile(r" ?\(at line (\d+), column (\d+)\)")
_ANY = {"name": "any", "unit": "1", "nominal": 0.0, "low": 0.0, "high": 1e-9, "sets": ["control.noise ="]}
_NEEDED = {"name": "robot", "engines": ["mujoco"], "timestep": 0.002, "control_rate": 100.0}  # of [robot]


@dataclass(frozen=True)
class Reading:
    """What is wrong in a robot.toml, and the rest of it.

    text : of robot.toml. file : what is left without the parts that are wrong; None where too little is.
    said : what is wrong. numbers : of the items left of each array of tables, their numbers in the text.
    document : the text as plain tables.
    """

    text: str
    file: RobotFile | None
    said: tuple[Said, ...]
    numbers: Mapping[str, Sequence[int]]
    document: Mapping[str, Any]

    def line(self, location: Location) -> int:
        """The line of a location in `file`; see `finding.Said`."""
        group, item = (*location, None, None)[:2]
        if isinstance(item, int) and item < len(self.numbers.get(str(group), ())):
            return line_of(self.text, (group, self.numbers[str(group)][item], *location[2:]))
        return self.line_of_text(location)

    def line_of_text(self, location: Location) -> int:
        """The line of a location in the whole text."""
        group, item = (*location, None, None)[:2]
        tables = self.document.get(str(group))
        if isinstance(item, str) and isinstance(tables, list):
            names = [table.get("name") if isinstance(table, dict) else None for table in tables]
            if item in names:
                return line_of(self.text, (group, names.index(item), *location[2:]))
        return line_of(self.text, location)

    def errors(self) -> list[Finding]:
        """What is wrong in robot.toml itself."""
        return [
            Finding("error", said, at[1] if at[0] == "" else self.line_of_text(at)) for at, said in self.said
        ]


def read_all(text: str) -> Reading:
    """Everything that is wrong in the text of a robot.toml, but for what only its model can tell."""
    document, said, gaps = _parsed(text)
    if document is None:
        return Reading(text, None, tuple(said), {}, {})
    whole, _, _ = _parsed(text)
    mending = _Mending(text, document, gaps)
    file = mending.validated()
    if file is not None:
        found = [p for p in inconsistencies(file) if not mending.follows(p[1])]
        mending.said += [(mending.place(at), f"{p}; expected {e}; {do}") for at, p, e, do in found]
        mending.remove([at for at, *_ in found])
        file = mending.validated() if found else file
    return Reading(text, file, (*said, *mending.said), mending.numbers(), whole or {})


def _parsed(text: str) -> tuple[dict[str, Any] | None, list[Said], list[int]]:
    """The text as plain tables, what is no TOML in it, and the lines that were left out for it."""
    lines, said, gaps = text.split("\n"), [], []
    while len(gaps) <= ROUNDS:
        try:
            return toml_document("\n".join(lines)), said, gaps
        except tomllib.TOMLDecodeError as problem:
            at = _AT.search(str(problem))
            number = int(at[1]) if at else len(lines)
            if number - 1 in gaps or number in gaps:  # what followed from the line before
                return None, said, gaps
            told = _AT.sub("", str(problem))
            said.append((("", number), f"{told}; expected valid TOML; mend that line"))
            if not at:
                return None, said, gaps
            gaps.append(number)
            lines[number - 1] = ""
        except (ValueError, RecursionError) as problem:
            deep = isinstance(problem, RecursionError)
            told = "tables or lists in each other too deep" if deep else str(problem)
            return None, [*said, (("", 1), f"{told}; expected valid TOML; mend it")], gaps
    return None, said, gaps


class _Mending:
    """A document out of which everything is taken that is wrong; `said` has what that was, by its place in the text."""

    def __init__(self, text: str, document: dict[str, Any], gaps: Sequence[int]):
        self._text, self._lines, self._gaps = text, text.split("\n"), gaps
        self._document = document
        self._numbers = {id(item): i for items in _tables(document) for i, item in enumerate(items)}
        self._kept = list(_tables(document))  # so that no id is given again
        self._removed: set[Location] = set()
        self._lost: set[str] = set()
        self.said: list[Said] = []

    def validated(self) -> RobotFile | None:
        """The file that is left when all that is wrong is out; None where too little is."""
        for _ in range(ROUNDS):
            try:
                return RobotFile.model_validate(self._document)
            except ValidationError as problem:
                if not self._out(problem.errors()):
                    return None
        return None

    def _out(self, found: Sequence[Mapping[str, Any]]) -> bool:
        """Take out what pydantic found; False where no file can be left."""
        self._tell(found)
        places = [(fault_of(self._document, e, RobotFile).location, e["type"] == "missing") for e in found]
        missing = [at for at, gone in places if gone]
        if ("channels",) in missing or ("robot",) in missing:
            return False
        for at in missing:
            if at[:-1] == ("robot",):
                self._document["robot"][at[-1]] = _NEEDED[str(at[-1])]
        gone = [at[:-1] if at in missing else at for at, _ in places]
        self.remove([at for at in gone if at not in ((), ("robot",))])
        if ("robot",) in gone and ("robot",) not in [at[:-1] for at in missing]:
            self._document["robot"] |= {name: _NEEDED[name] for name in ("control_rate", "timestep")}
        if not self._document.get("parameters"):
            self._document["parameters"] = [dict(_ANY)]
        return bool(self._document.get("channels")) and isinstance(self._document.get("robot"), dict)

    def _tell(self, found: Sequence[Mapping[str, Any]]) -> None:
        unknown = [
            fault_of(self._document, e, RobotFile).location for e in found if e["type"] == "extra_forbidden"
        ]
        for one in found:
            fault = fault_of(self._document, one, RobotFile)
            if one["type"] == "missing" and self._is_told(fault.location, unknown):
                continue
            if fault.location == ("robot",) and any(at[0] == "robot" for at in self._removed):
                continue  # of what stands beside it
            message = f"{fault.problem.lstrip(':, ')}; expected {fault.expected}; {fault.do}"
            self.said.append((self.place(fault.location), message))

    def _is_told(self, missing: Location, unknown: Sequence[Location]) -> bool:
        """Whether a key is missing because it is misspelt, was taken out, or stood on a line that is no TOML."""
        beside = [str(at[-1]) for at in unknown if at[:-1] == missing[:-1]]
        if self.place(missing) in self._removed or difflib.get_close_matches(str(missing[-1]), beside):
            return True
        header = line_of(self._text, self.place(missing[:-1]))
        return any(
            not any(line.lstrip().startswith("[") for line in self._lines[header : gap - 1])
            for gap in self._gaps
            if gap > header
        )

    def remove(self, places: Sequence[Location]) -> None:
        """Take out keys, items and tables, all of which are where they were before the first of them goes."""
        for owner, key in [found for place in places if (found := self._found(place))]:
            if isinstance(owner, dict):
                owner.pop(key, None)
            else:
                owner[:] = [item for item in owner if item is not key]

    def _found(self, place: Location) -> tuple[Any, Any] | None:
        """(table, key) or (array, item) of what goes with a place: a whole key, an item of an array of tables."""
        here, owner = self._document, None
        for part in place:
            inside = (
                part in here
                if isinstance(here, dict)
                else isinstance(here, list) and part in range(len(here))
            )
            if not inside or (isinstance(here, list) and not isinstance(here[part], dict)):
                break
            owner = (here, here[part] if isinstance(here, list) else part)
            here = here[part]
        self._removed.add(self.place(place))
        if owner is not None and isinstance(here, dict):
            name = str(here.get("name", here.get("joint", "")))
            self._lost |= {name, joint_of(name)}
        return owner

    def follows(self, problem: str) -> bool:
        """Whether a problem names what was taken out, and so is no new one."""
        return any(repr(name) in problem for name in self._lost if name)

    def place(self, location: Location) -> Location:
        """A location with the numbers that items have in the text."""
        here, out = self._document, []
        for part in location:
            inside = (
                part in here
                if isinstance(here, dict)
                else isinstance(here, list) and part in range(len(here))
            )
            here = here[part] if inside else None
            out.append(self._numbers.get(id(here), part) if isinstance(part, int) else part)
        return tuple(out)

    def numbers(self) -> dict[str, list[int]]:
        """For each array of tables the numbers in the text of the items that are left."""
        arrays = {key: value for key, value in self._document.items() if isinstance(value, list)}
        return {key: [self._numbers.get(id(item), 0) for item in items] for key, items in arrays.items()}


def _tables(here: Any) -> Iterator[list[dict[str, Any]]]:
    """All arrays of tables in a document."""
    if isinstance(here, dict):
        for value in here.values():
            yield from _tables(value)
    elif isinstance(here, list) and here and all(isinstance(item, dict) for item in here):
        yield here
        for item in here:
            yield from _tables(item)
