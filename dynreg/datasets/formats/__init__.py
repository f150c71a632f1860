"""The formats of other projects in which a dataset is written: one row and one module each.

A module has `write(export, folder, name)`, which puts its files into an empty folder, the main one of a single file
under `name`; `is_file(export)` where that may be one file; `as_logs(export)` where a recording may keep the columns of
its log; and `check(export)` where it cannot take everything. It writes part by part, and the same export gives the same
bytes.
"""

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from dynreg.errors import UsageError, one_of

if TYPE_CHECKING:
    from dynreg.datasets.export import Export


@dataclass(frozen=True)
class Format:
    """A form of a dataset.

    Attributes
    ----------
    id : the word for it, and its module here.
    writes : what there is afterwards.
    loader : what reads it, as pip installs it. read : how, in Python; PLACE stands for the name of what was written.
    alone : how, where it is the log of a recording alone; "" where that is the same.
    entries : its table of entries; PLACE likewise, "" where it has none.
    models : whether it holds models, and no rows.
    keys : columns that tell which row it is. alone_keys : likewise of the log of a recording alone.
    notes : what a reader must know of how the rows stand in it, a sentence each.
    configs : its tables for Hugging Face, the usual one first, with their files.
    """

    id: str
    writes: str
    loader: str
    read: str
    notes: tuple[str, ...] = ()
    configs: tuple[tuple[str, str], ...] = ()
    alone: str = ""
    entries: str = ""
    models: bool = False
    keys: tuple[str, ...] = ("time",)
    alone_keys: tuple[str, ...] = ("time",)

    def is_file(self, export: "Export") -> bool:
        """Whether it is one file and not a folder."""
        told = getattr(self._module, "is_file", None)
        return told is not None and told(export)

    def as_logs(self, export: "Export") -> bool:
        """Whether a recording is written with the columns of its log, and not with those of the dataset."""
        told = getattr(self._module, "as_logs", None)
        return told is not None and told(export)

    def check(self, export: "Export") -> None:
        """UsageError for an export that it cannot hold."""
        getattr(self._module, "check", lambda _: None)(export)

    def write(self, export: "Export", folder: Path, name: str) -> None:
        """Write it into an empty folder; a single file is called `name`, what goes beside it begins with that."""
        self._module.write(export, folder, name)

    @property
    def _module(self):
        return import_module(f"{__name__}.{self.id}_files")


_KEYS = ("entry", "number", "episode", "step", "time")  # those of `Dataset.to_arrow`
_NEXT = "The command in a row leads from its state to the state in the next row."
_LAST = "A simulated episode ends with a state that no command follows:"
_LOGGED = "A recording has the commands of its log in every row, also in the last."
FORMATS: dict[str, Format] = {
    one.id: one
    for one in (
        Format(
            "parquet",
            "a folder: rows in data/, entries.parquet with the parameters, a card",
            "datasets",
            """\
from datasets import load_dataset

rows = load_dataset("./PLACE", "rows", split="train")        # entry, episode, step, time, and each column by name
entries = load_dataset("./PLACE", "entries", split="train")  # parameters of each entry
print(rows[0])
""",
            (
                _NEXT,
                f"{_LAST} the command in that row is null.",
                _LOGGED,
                "What was not measured is NaN, or null.",
            ),
            (("rows", "data/*.parquet"), ("entries", "entries.parquet")),
            entries="entries.parquet",
            keys=_KEYS,
            alone_keys=_KEYS,
        ),
        Format(
            "csv",
            "a file; beside it its card and, of simulated entries, FILE.entries.csv with the parameters",
            "pandas",
            """\
import pandas as pd

rows = pd.read_csv("PLACE")
print(rows.groupby(["entry", "episode"]).size())
""",
            (
                _NEXT,
                f"{_LAST} the command in that row is empty.",
                _LOGGED,
                "What was not measured is nan, or empty.",
                "Numbers have as many digits as they need to be read back exactly.",
                "`dynreg ingest` reads the log of a recording alone, of a file whose name ends in .csv.",
                "It takes every log as a measured recording, so one that was simulated comes back with another id.",
            ),
            alone="""\
import pandas as pd

rows = pd.read_csv("PLACE")
print(rows.groupby("episode").size())
""",
            entries="PLACE.entries.csv",
            keys=_KEYS,
            alone_keys=("episode", "time"),
        ),
        Format(
            "mcap",
            "a log with its map and card beside it; of several things a folder of these",
            "mcap",
            """\
import json
from pathlib import Path
from mcap.reader import make_reader

place = Path("PLACE")
for file in sorted(place.glob("*.mcap")) if place.is_dir() else [place]:
    with open(file, "rb") as log:
        for schema, channel, message in make_reader(log).iter_messages():
            print(file.name, channel.topic, message.log_time, json.loads(message.data))
""",
            (
                "Messages are JSON.",
                "The column arm/position is the field position of the topic /arm.",
                "What was not measured is left out of its message.",
                "Episodes lie as far apart as their times tell, at least one row; where time begins anew, 1 s.",
                "/episode tells where each begins.",
                "`dynreg ingest FILE --map MAP` reads it back.",
                "Episodes come back named by their number, so a recording that is ingested again has another id.",
                "`dynreg ingest` takes every log as a measured recording, also that of a simulated entry.",
            ),
        ),
        Format(
            "lerobot",
            "a folder: a LeRobot dataset, version 3.0",
            "lerobot",
            """\
from lerobot.datasets.lerobot_dataset import LeRobotDataset

dataset = LeRobotDataset("PLACE", root="PLACE")
print(dataset[0]["observation.state"], dataset[0]["action"])
""",
            (
                "An episode here is one episode of one entry; entry_index is its row in meta/entries.parquet.",
                "timestamp is frame_index / fps, as LeRobot asks for; time has the times as they were.",
                "observation.environment_state holds inputs and settings.",
                f"{_LAST} that frame repeats the command before it.",
                _LOGGED,
                "What was not measured is NaN.",
            ),
            entries="meta/entries.parquet",
        ),
        Format(
            "minari",
            "a folder: a Minari dataset, in Arrow",
            "'minari[arrow]'",
            """\
import minari

dataset = minari.MinariDataset("PLACE/data")
episode = dataset[0]
print(episode.observations.shape, episode.actions.shape)
""",
            (
                "There is no task: all rewards are 0.",
                "What was not measured is NaN; total_steps counts the steps with NaN, too.",
                "No episode is terminated, even if a robot fell in it; each is truncated at its end.",
                "infos holds the times, the inputs and the settings.",
                "An episode's metadata.json tells its entry.",
            ),
        ),
        Format(
            "safetensors",
            "a folder: the trained models of entries, also of those of recordings, in one file",
            "safetensors",
            '''\
import json
import numpy as np
from safetensors import safe_open

file = safe_open("PLACE/models.safetensors", framework="numpy")
about = json.loads(file.metadata()["dynreg"])
scale = {name: file.get_tensor(name) for name in ("input_mean", "input_std", "delta_mean", "delta_std")}


def predict(entry, states, actions, context=about["usual"]):
    """States (N, S) that follow states (N, S) under actions (N, A), by the model of an entry (0, 1, ...)."""
    context = np.broadcast_to(context, (len(states), len(about["context"])))
    x = np.concatenate([states, actions, context], axis=1, dtype=np.float64)
    x = ((x - scale["input_mean"]) / scale["input_std"]).astype(np.float32)
    for layer in range(about["layers"]):
        weight, bias = (file.get_slice(f"{kind}{layer}")[entry] for kind in ("weight", "bias"))
        x = x @ weight.astype(np.float32) + bias.astype(np.float32)
        x = np.maximum(x, 0) if layer < about["layers"] - 1 else x
    return states + x * scale["delta_std"].astype(np.float64) + scale["delta_mean"]
''',
            (
                "weight0 to weight3 are (entries, in, out), bias0 to bias3 (entries, out), float16 as they are kept.",
                "The metadata tells ids, columns and units, and the nominal context.",
            ),
            entries="entries.parquet",
            models=True,
        ),
    )
}


def format_of(word: str) -> Format:
    """The row of a form; UsageError where there is none."""
    if word not in FORMATS:
        raise UsageError(f"form {word!r} of a dataset", expected=one_of(FORMATS), do="choose one of them")
    return FORMATS[word]
