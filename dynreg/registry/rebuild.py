"""The catalogue written again from the files, keeping what only its old rows knew (names, order, sizes)."""

import json
import tomllib
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import dynreg.registry.tables as tables
from dynreg.limits import limits
from dynreg.registry.codec import canonical_json
from dynreg.registry.files import ROBOTS, read_regular
from dynreg.registry.hashes import result_id
from dynreg.registry.scan import Found, FoundShard
from dynreg.registry.tables import misfit, values_of

Row = dict[str, Any]
Rows = dict[str, list[Row]]


def paths_in(held: Rows) -> set[str]:
    """Paths that some row refers to: those of `files`, and those of rows whose `files` row is gone."""
    columns = ("path", "states_path", "arrays_path")
    return {row[column] for rows in held.values() for row in rows for column in columns if row.get(column)}


def new_rows(root: Path, held: Rows, found: Found, *, adopt: bool) -> Rows:
    """Rows for all that is sound, by table: those of `held` whose files are.

    adopt : whether sound files that no row knows get rows, too, as where rows were lost. What does not fit dynreg's own
    rows, or the others, gets none.
    """
    rows = _rows_of(root, held, found if adopt else _known(held, found))
    return {t.name: [row for row in rows[t.name] if not misfit(t, values_of(t, row))] for t in tables.HELD}


def _known(held: Rows, found: Found) -> Found:
    """What was found, without what the rows do not know."""
    ids = {
        name: {row["id"] for row in held[name]}
        for name in ("populations", "recordings", "measured", "simulators")
    }
    shards = {(row["population_id"], row["start"]): row for row in held["shards"]}
    paths = {row["path"] for row in held["results"]}
    return replace(
        found,
        shards={key: shard for key, shard in found.shards.items() if shards.get(key) == shard.row},
        results={path: result for path, result in found.results.items() if path in paths},
        **{
            name: {k: v for k, v in getattr(found, name).items() if k in known} for name, known in ids.items()
        },
    )


def manifest_of(row: Row) -> dict[str, str]:
    """sha256 of each file of a robot's folder; of a row that does not tell them, none."""
    try:
        manifest = json.loads(row["manifest"])
    except (ValueError, TypeError, RecursionError):
        return {}
    return manifest if isinstance(manifest, dict) else {}


def _rows_of(root: Path, held: Rows, found: Found) -> Rows:
    populations = _populations(held, found)
    alive = {row["id"] for row in populations}
    shards = _fitting(held, [shard for key, shard in sorted(found.shards.items()) if key[0] in alive])
    entries = [row for shard in shards for row in shard.entries]
    hashes = {name.split("/")[1] for name in found.files if name.startswith(f"{ROBOTS}/")}
    hashes |= {row["hash"] for row in held["robots"]} | {row["robot_hash"] for row in populations}
    recordings = _recordings(held, found, hashes)
    stored = {row["id"] for row in recordings}
    names = [row for row in held["recording_names"] if row["recording_id"] in stored]
    called = {(row["recording_id"], row["name"]) for row in names}
    kept = {row["name"] for row in names}
    own = [r for r in held["robots_of_names"] if r["name"] in kept and r["robot_hash"] in hashes]
    used = {row["robot_hash"] for row in (*populations, *recordings, *own)} | {
        row["hash"] for row in held["robots"]
    }
    rows = {
        "robots": _robots(root, held, found, used),
        "robot_versions": [row for row in held["robot_versions"] if row["hash"] in used],
        "populations": populations,
        "shards": [shard.row for shard in shards],
        "entries": entries,
        "recordings": recordings,
        "recording_names": names,
        "latest_names": [r for r in held["latest_names"] if (r["recording_id"], r["name"]) in called],
        "robots_of_names": own,
        "measured": [
            row
            for row in found.measured.values()
            if row["population_id"] in alive and row["recording_id"] in stored
        ],
        "simulators": list(found.simulators.values()),
        "results": _results(held, found, stored),
    }
    registered = {row["path"]: row for row in held["files"]}
    sound = {path: {"path": path, "sha256": f.sha256, "size": f.size} for path, f in found.files.items()}
    return rows | {"files": [sound.get(path) or registered[path] for path in sorted(paths_in(rows))]}


def _fitting(held: Rows, shards: list[FoundShard]) -> list[FoundShard]:
    """Shards of one layout for each population, in which no entry stands twice; those that a row knows come first."""
    rows = [(row["population_id"], row["start"]) for row in held["shards"]]
    layouts: dict[str, str] = {}
    entries: set[str] = set()
    kept = []
    for shard in sorted(shards, key=lambda s: (s.row["population_id"], s.row["start"]) not in rows):
        layout, ids = canonical_json(shard.layout), {row["id"] for row in shard.entries}
        if layouts.setdefault(shard.row["population_id"], layout) == layout and not ids & entries:
            entries |= ids
            kept.append(shard)
    return sorted(kept, key=lambda s: (s.row["population_id"], s.row["start"]))


def _robots(root: Path, held: Rows, found: Found, used: Iterable[str]) -> list[Row]:
    """Rows of the robots; one whose row is gone is taken from its folder as it is."""
    known = {row["hash"]: row for row in held["robots"]}
    rows = []
    for robot_hash in sorted(used):
        prefix = f"{ROBOTS}/{robot_hash}/"
        manifest = {n.removeprefix(prefix): f.sha256 for n, f in found.files.items() if n.startswith(prefix)}
        row = {"hash": robot_hash, "manifest": canonical_json(manifest)}
        rows.append(known.get(robot_hash) or row | {"name": _robot_name(root / prefix)})
    return rows


def _robot_name(folder: Path) -> str:
    try:
        text = read_regular(folder / "robot.toml", limits().toml_bytes).decode()
        return str(tomllib.loads(text)["robot"]["name"])
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return folder.name[:12]


def _populations(held: Rows, found: Found) -> list[Row]:
    """Rows of the populations: from their files, or the old row where only the file is lost."""
    known = {row["id"]: row for row in held["populations"]}
    registered = {row["path"] for row in held["files"]}
    rows = {key: row for key, row in known.items() if row["path"] in registered}
    for key, population in found.populations.items():
        header = population["header"]
        shards = [shard for (owner, _), shard in found.shards.items() if owner == key]
        size = max([1, *(shard.row["stop"] for shard in shards)])
        rows[key] = {
            "id": key,
            "robot_hash": header["robot"],
            "name": header["name"],
            "size": max(size, known[key]["size"]) if key in known else size,
            "path": population["path"],
            "layout": known.get(key, {}).get("layout")
            or (canonical_json(shards[0].layout) if shards else None),
        }
    return list(rows.values())


def _recordings(held: Rows, found: Found, robots: Iterable[str]) -> list[Row]:
    known = {row["id"]: row for row in held["recordings"]}
    last = max([0, *(row["ordinal"] for row in held["recordings"])])
    rows = []
    for key, recording in found.recordings.items():
        robot = [robot_hash for robot_hash in robots if robot_hash.startswith(recording["robot"])]
        if key in known:
            rows.append(known[key] | {"path": recording["path"]})
        elif len(robot) == 1:
            last += 1
            rows.append({"id": key, "robot_hash": robot[0], "path": recording["path"], "ordinal": last})
    return rows


def _results(held: Rows, found: Found, recordings: Iterable[str]) -> list[Row]:
    known = {row["path"]: row for row in held["results"]}
    last = max([0, *(row["ordinal"] for row in held["results"])])
    rows = []
    for path, result in found.results.items():
        named = result["recording"]  # the beginning of an id; "" for a result about no recording
        about = [r for r in recordings if r.startswith(named)] if named else [""]
        if path in known:
            rows.append(known[path])
        elif len(about) == 1:
            last += 1
            row = {"id": result_id(result["kind"], about[0], result["sha256"]), "kind": result["kind"]}
            rows.append(row | {"recording_id": about[0], "path": path, "ordinal": last})
    return rows
