"""The plan of a staged calibration: which parameters each stage fits, to which recordings, and by which loss."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import numpy as np
from pydantic import Field, PrivateAttr, field_validator

from dynreg.data.names import fits
from dynreg.errors import UsageError
from dynreg.search.drive import Search
from dynreg.search.start import Start
from dynreg.search.strategy import CARRIED, MOST, STEP, EvolutionStrategy
from dynreg.search.table import FORMER, SEARCHES
from dynreg.sim.table import Table
from dynreg.tomlfile import line_of, parse_toml, read_text

LOSS_UNITS = {"replay": "", "joint": "rad^2", "velocity": "m^2/s^2"}


class StageTable(Table):
    """[[stages]]: one search of a staged calibration (paper E)."""

    name: str = Field(pattern=r"^[A-Za-z][A-Za-z0-9_\-]*$", description="The stage's name.")
    parameters: list[str] = Field(
        min_length=1, description="Parameters to fit: names, or patterns such as `*_gain`."
    )
    recordings: list[str] = Field(
        default_factory=lambda: ["*"],
        min_length=1,
        description="What they are fitted to: names of recordings or episodes, or patterns such as `air*`.",
    )
    loss: Literal["replay", "joint", "velocity"] = Field(
        default="replay",
        description="What is made small: the error of a replay, squared joint angles [rad^2], or the squared error "
        "of the mean velocity [m^2/s^2].",
    )
    shift: float = Field(
        default=0.0,
        ge=0,
        le=10,
        description="Largest time [s] by which `joint` may move the log against the simulation.",
    )
    skip: float = Field(
        default=0.0, ge=0, le=3600, description="Time [s] at the start of a window that does not count."
    )
    rotation: float = Field(
        default=0.1,
        gt=0,
        le=100,
        description="Length [m] by which `velocity` weighs a yaw rate against a speed.",
    )
    search: str = Field(default="es", description="One of the searches of `calibrate`.")
    children: int = Field(default=25, ge=2, le=10000, description="Candidates of one generation.")
    mu: int = Field(default=5, ge=1, le=10000, description="Parents of a generation (`es`).")
    rho: int = Field(default=2, ge=1, le=10000, description="Parents of one child (`es`).")
    generations: int = Field(default=80, ge=1, le=1_000_000, description="Generations of the stage.")
    step: float = Field(
        default=STEP, gt=0, le=MOST, description="First step of a parameter, of its range (`es`, `cma`)."
    )
    carry: float = Field(
        default=CARRIED,
        gt=0,
        le=MOST,
        description="First step of a parameter that an earlier stage has fitted, of its range (`es`, `cma`).",
    )

    _lines: Mapping[str, int] = PrivateAttr(default_factory=dict)  # of its keys, and
    _file: str = PrivateAttr("")  # of which file; "" where it was made otherwise

    def place(self, *keys: str) -> str:
        """What an error begins with: the file, and the line of the last of these keys; "" without a file."""
        return f"{self._file}, line {max(self._lines[key] for key in keys)}: " if self._lines else ""

    def begin(self, point: np.ndarray, steps: np.ndarray, rng: np.random.Generator) -> Search:
        """The stage's search from a point (F,) with first steps (F,), 1 sigma; UsageError for sizes that it refuses."""
        if self.search == "es":
            return EvolutionStrategy(
                point, rng=rng, mu=self.mu, children=self.children, rho=self.rho, steps=steps
            )
        return SEARCHES[self.search].begin(Start(len(point), rng, self.children, point, steps=steps))

    @field_validator("search", mode="before")
    @classmethod
    def _by_its_name(cls, given: object) -> object:
        return FORMER.get(given, given) if isinstance(given, str) else given


class PlanFile(Table):
    """The TOML file of a plan."""

    stages: list[StageTable] = Field(min_length=1, description="The stages, in order.")


# key: what the loss or the search of a stage must be, for the key to mean something
MEANS: Mapping[str, tuple[str, tuple[str, ...]]] = MappingProxyType(
    {
        "shift": ("loss", ("joint",)),
        "rotation": ("loss", ("velocity",)),
        "mu": ("search", ("es",)),
        "rho": ("search", ("es",)),
        "step": ("search", ("es", "cma")),
        "carry": ("search", ("es", "cma")),
    }
)


@dataclass(frozen=True, eq=False)
class Stage:
    """A stage of a plan for a robot and a recording: its table, parameters (F,) by number, and windows (W',)."""

    table: StageTable
    parameters: np.ndarray
    windows: np.ndarray


def read_plan(path: Path) -> tuple[StageTable, ...]:
    """The stages of a file.

    Raises UsageError that names the line, also for two stages of one name, a key that means nothing to the stage's
    loss or search, and sizes that its search refuses.
    """
    text = read_text(path, UsageError)
    stages = tuple(parse_toml(text, path.name, PlanFile, UsageError).stages)
    for i, stage in enumerate(stages):
        stage._file = path.name
        stage._lines = {key: line_of(text, ("stages", i, key)) for key in StageTable.model_fields}
        if stage.search not in SEARCHES:
            raise UsageError(
                f"{stage.place('search')}stage {stage.name!r}: search {stage.search!r}",
                expected=f"one of {', '.join(SEARCHES)}",
                do=f"correct it in {path.name}",
            )
        _require_meaning(stage, path.name)
        if stage.search == "es" and not stage.rho <= stage.mu < stage.children:
            raise UsageError(
                f"{stage.place('rho', 'mu', 'children')}stage {stage.name!r}: rho {stage.rho}, mu {stage.mu}, "
                f"children {stage.children}",
                expected="rho <= mu < children",
                do=f"correct them in {path.name}",
            )
        try:
            SEARCHES[stage.search].require(stage.children)
        except UsageError as error:
            raise UsageError(
                f"{stage.place('search', 'children')}stage {stage.name!r}: search {stage.search!r}, {error.problem}",
                expected=error.expected,
                do=f"correct `children` in {path.name}",
            ) from None
        for other in stages[:i]:
            if stage.name == other.name:
                raise UsageError(
                    f"{stage.place('name')}two stages are called {stage.name!r}",
                    expected="a name for each",
                    do="rename one",
                )
    return stages


def _require_meaning(stage: StageTable, file: str) -> None:
    """UsageError for a key that is written and means nothing to the stage's loss or search."""
    for key, (of, meant) in MEANS.items():
        if key in stage.model_fields_set and getattr(stage, of) not in meant:
            raise UsageError(
                f"{stage.place(key)}stage {stage.name!r}: {key} = {getattr(stage, key)!r}, which means nothing to "
                f"{of} {getattr(stage, of)!r}",
                expected=f"it with {of} {' or '.join(map(repr, meant))}",
                do=f"leave it out of {file}",
            )


def resolved(
    stages: Sequence[StageTable],
    names: Sequence[str],
    known: np.ndarray,
    episodes: Sequence[str],
    chosen: np.ndarray,
) -> tuple[Stage, ...]:
    """The stages for a robot's parameters `names` (P,) and a recording.

    known : (P,) which parameters the recording tells: nothing fits them. episodes : of each window (W,), as
    "RECORDING/EPISODE" where recordings were joined. chosen : numbers of the windows that are not held out.
    Raises UsageError for a pattern that matches nothing, and for two stages that fit one parameter to one window by
    one loss.
    """
    out: list[Stage] = []
    for table in stages:
        found = _matching(table, "parameters", table.parameters, names)
        free = np.array([i for i in found if not known[i]], dtype=int)
        near = {i for i in _matching(table, "recordings", table.recordings, episodes)}
        windows = np.array([w for w in chosen if w in near], dtype=int)
        if not len(windows):
            raise UsageError(
                f"{table.place('recordings')}stage {table.name!r}: all of {table.recordings} is held out",
                expected="recordings of which some is left to fit",
                do="hold out less, or name others",
            )
        stage = Stage(table, free, windows)
        for other in out:
            twice = np.intersect1d(free, other.parameters)
            shared = np.intersect1d(windows, other.windows)
            if len(twice) and other.table.loss == table.loss and len(shared):
                raise UsageError(
                    f"{table.place('parameters')}stages {other.table.name!r} and {table.name!r} overlap: "
                    f"both fit {names[twice[0]]!r} to {episodes[shared[0]]!r} by {table.loss!r}",
                    expected="another loss, other recordings or other parameters in each",
                    do="join the two stages, or change one",
                )
        out.append(stage)
    return tuple(out)


def _matching(stage: StageTable, what: str, patterns: Sequence[str], names: Sequence[str]) -> list[int]:
    """Numbers of the names that a pattern matches, whole or in parts; UsageError where one matches none."""
    found: set[int] = set()
    for pattern in patterns:
        hits = [i for i, name in enumerate(names) if any(fits(part, pattern) for part in _spans(name))]
        if not hits:
            raise UsageError(
                f"{stage.place(what)}stage {stage.name!r}: {what} has {pattern!r}, which matches nothing",
                expected=f"some of {', '.join(dict.fromkeys(names))}",
                do="correct it",
            )
        found |= {*hits}
    return sorted(found)


def _spans(name: str) -> list[str]:
    """A name and all that follows one another in it: a recording's name may have a slash, too.

    >>> _spans("lab/monday/e0")
    ['lab', 'lab/monday', 'lab/monday/e0', 'monday', 'monday/e0', 'e0']
    """
    parts = name.split("/")
    return ["/".join(parts[i:j]) for i in range(len(parts)) for j in range(i + 1, len(parts) + 1)]
