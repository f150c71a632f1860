"""Copies of robot folders, so that a registry can be moved and still simulate."""

import json
from collections.abc import Mapping
from pathlib import Path

from sqlalchemy import Connection, Row

import dynreg.registry.disk as disk
import dynreg.registry.tables as tables
from dynreg.errors import CorruptError, DiffersError, RegistryError, RobotError
from dynreg.folder import MAPS, Folder, is_hashed, read_folder
from dynreg.registry.codec import canonical_json
from dynreg.registry.directory import Directory
from dynreg.registry.files import ROBOTS, StoredFile, content_hash, sha256_of, write_file
from dynreg.registry.rows import require, row_of
from dynreg.registry.versions import numbered
from dynreg.registry.writing import Writing


def put_robot(
    directory: Directory, folder: Folder | Path, robot_hash: str, name: str, version: int | None = None
) -> None:
    """Copy a robot folder under its hash; files that were lost or changed are put right again.

    folder : as it was read, so that the files copied are those that were hashed; or where it lies. version : the number
    that a new one gets where it is free, as in the registry that it comes from; else the next of its name.

    The hash does not cover the log maps in `maps/`: those of the folder take the place of older ones. Names that
    begin with "." or "__" are left out. Raises RegistryError when the folder cannot be read, or when this hash
    stands for other files.
    """
    contents = _contents(folder, robot_hash)
    manifest = {relative: content_hash(data) for relative, data in contents.items()}
    told = canonical_json(manifest)
    with directory.catalog.read() as connection:
        known = row_of(connection, tables.robots, robot_hash)
    _check_same(known, manifest)
    _write_copy(directory, robot_hash, {n: d for n, d in contents.items() if is_hashed(n)}, manifest)
    with directory.catalog.write() as writing:
        known = row_of(writing.connection, tables.robots, robot_hash)
        _check_same(known, manifest)
        # anew: in case a repair took it for an orphan
        _write_copy(directory, robot_hash, contents, manifest, anew=known is None or known.manifest != told)
        kept = known.name if known else name
        writing.put(tables.robots, {"hash": robot_hash, "name": kept, "manifest": told})
        _number(writing, robot_hash, version, is_new=known is None)
    _remove_other_maps(directory, robot_hash)


def robot_folder(directory: Directory, robot_hash: str) -> Path:
    """Where the copy of a robot lies; NoMatchError when unknown, CorruptError when it was changed.

    Its log maps are not looked at: another process may be replacing them, and no simulation needs them.
    """
    with directory.catalog.read() as connection:
        manifest = json.loads(require_robot(connection, robot_hash).manifest)
    for relative, sha256 in _covered(manifest).items():
        if not directory.is_here(StoredFile(f"{ROBOTS}/{robot_hash}/{relative}", sha256)):
            raise CorruptError(
                f"robot {robot_hash[:12]} has lost its {relative!r}, or it was changed",
                expected="the folder as it was registered",
                do="ingest a log or populate with the robot's own folder again: that puts its copy right",
            )
    if directory.bucket is not None:
        _bring_maps(directory, robot_hash, manifest)
    put_here = directory.home / ROBOTS / robot_hash
    return put_here if put_here.is_dir() else directory.path / ROBOTS / robot_hash


def require_robot(connection: Connection, robot_hash: str) -> Row:
    """The catalogue's row of a robot; NoMatchError when there is none."""
    return require(connection, tables.robots, robot_hash, "robot", "register its folder first")


def _number(writing: Writing, robot_hash: str, version: int | None, *, is_new: bool) -> None:
    """Write down the versions of all robots that have none yet; a new one is the newest of its name."""
    connection = writing.connection
    if row_of(connection, tables.robot_versions, robot_hash) is not None:
        return
    versions = {info.hash: info.version for info in numbered(connection, robot_hash if is_new else None)}
    if is_new:
        name = require_robot(connection, robot_hash).name
        taken = {info.version for info in numbered(connection, robot_hash) if info.name == name}
        free = version is not None and version not in taken
        versions[robot_hash] = version if free else max(taken, default=0) + 1
    writing.put(tables.robot_versions, *({"hash": h, "version": v} for h, v in versions.items()))


def _remove_other_maps(directory: Directory, robot_hash: str) -> None:
    """Remove the log maps that the robot's row does not name; nobody puts any meanwhile."""
    if not _maps(directory, robot_hash):
        return
    with directory.catalog.write() as writing:
        manifest = json.loads(require_robot(writing.connection, robot_hash).manifest)
        others = [name for name in _maps(directory, robot_hash) if _within(name) not in manifest]
        directory.remove(others)


def _maps(directory: Directory, robot_hash: str) -> list[str]:
    return directory.names(f"{ROBOTS}/{robot_hash}/{MAPS}")


def _within(name: str) -> str:
    """The path in its robot's folder of a file of the registry."""
    return name.split("/", 2)[2]


def _bring_maps(directory: Directory, robot_hash: str, manifest: Mapping[str, str]) -> None:
    """Make the log maps that lie here those of a shared registry, as far as it has them."""
    folder = directory.home / ROBOTS / robot_hash
    for path in [p for p in (folder / MAPS).rglob("*") if p.is_file()]:
        if path.relative_to(folder).as_posix() not in manifest:
            disk.remove(path)
    for relative in manifest.keys() - _covered(manifest).keys():
        directory.is_here(StoredFile(f"{ROBOTS}/{robot_hash}/{relative}", manifest[relative]))


def _check_same(known: Row | None, manifest: Mapping[str, str]) -> None:
    if known is not None and _covered(json.loads(known.manifest)) != _covered(manifest):
        raise DiffersError(
            f"robot {known.hash[:12]} ({known.name!r}) has other files than those given",
            expected="the same files under the same hash",
            do="compute the hash of the changed folder anew",
        )


def _covered(manifest: Mapping[str, str]) -> dict[str, str]:
    """The part of a manifest that the robot's hash covers."""
    return {relative: sha256 for relative, sha256 in manifest.items() if is_hashed(relative)}


def _write_copy(
    directory: Directory,
    robot_hash: str,
    contents: Mapping[str, bytes],
    manifest: Mapping[str, str],
    anew: bool = False,
) -> None:
    for relative, data in contents.items():
        file = StoredFile(f"{ROBOTS}/{robot_hash}/{relative}", manifest[relative])
        directory.push(file.path, data, anew or not directory.is_here(file))
        path = directory.home / ROBOTS / robot_hash / relative
        if not _is_sound(path, manifest[relative]):
            disk.make_folder(path.parent)
            write_file(path, data)
    for folder in {(directory.home / ROBOTS / robot_hash / name).parent for name in contents}:
        disk.sync_folder(folder)  # whoever wrote what is there may have been cut short before
    disk.sync_folder(directory.home / ROBOTS)


def _is_sound(path: Path, sha256: str) -> bool:
    try:
        return sha256_of(path) == sha256
    except OSError:
        return False


def _contents(folder: Folder | Path, robot_hash: str) -> Mapping[str, bytes]:
    problem = f"cannot register robot {robot_hash!r}"
    if not tables.ROBOT_HASH.fullmatch(robot_hash):
        raise RegistryError(problem, expected="a hash in hexadecimal digits", do="give that of the folder")
    if isinstance(folder, Folder):
        return folder.files
    try:
        return read_folder(folder).files
    except RobotError as error:
        raise RegistryError(f"{problem}: {error.problem}", expected=error.expected, do=error.do) from None
