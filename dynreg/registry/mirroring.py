"""A bucket copied to a folder and back, so that a shared registry is compared and repaired as one in a folder is."""

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import dynreg.registry.disk as disk
from dynreg.registry.bucket import Bucket
from dynreg.registry.catalog import identity_of
from dynreg.registry.files import FOLDERS, LEDGER, write_file
from dynreg.registry.ledger import Page, pages_after, read_page

_AT_ONCE = 8
Identity = tuple[int, int, int] | None


def bring_all(bucket: Bucket, place: Path, pages: Mapping[int, str]) -> dict[str, Identity]:
    """Copy all objects to a folder; {name: what tells whether its copy was changed}.

    pages : sha256 by the number of each page of the ledger that the catalogue names. Another page of such a number is
    of a put that was cut short, and is left out. So is one of two with a number that the catalogue does not reach yet.
    """
    for folder in FOLDERS:
        disk.make_folder(place / folder)
    names = [name for folder in FOLDERS for name in bucket.names(folder) if not _is_nobodys(name, pages)]

    def bring(name: str) -> None:
        path = place / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with suppress(FileNotFoundError):  # an index that was replaced in the meantime
            write_file(path, bucket.read(name))

    with ThreadPoolExecutor(_AT_ONCE) as pool:
        list(pool.map(bring, names))
    for path in _doubled(place, max(pages, default=0)):
        disk.remove(path)
    return {name: identity_of(place / name) for name in names if (place / name).exists()}


def send_back(bucket: Bucket, place: Path, brought: Mapping[str, Identity]) -> None:
    """Make the bucket what the folder was changed to, file by file."""
    now = {p.relative_to(place).as_posix(): identity_of(p) for p in place.rglob("*") if p.is_file()}
    for name in sorted(now):
        if brought.get(name) != now[name]:
            bucket.write(name, (place / name).read_bytes())
    for name in sorted(brought.keys() - now.keys()):
        bucket.remove(name)


def _is_nobodys(name: str, pages: Mapping[int, str]) -> bool:
    folder, _, file = name.partition("/")
    number, _, rest = file.partition("-")
    if folder != LEDGER or not number.isdecimal() or int(number) not in pages:
        return False
    return rest != f"{pages[int(number)][:16]}.json"


def _doubled(place: Path, last: int) -> list[Path]:
    """Pages after the number `last` that stand beside one which the next page follows, or else beside the first."""
    found: dict[int, list[tuple[Path, Page, str]]] = {}
    for path in pages_after(place, last):
        with suppress(OSError, ValueError):  # a damaged one is told of
            page, sha256 = read_page(path)
            found.setdefault(page.number, []).append((path, page, sha256))
    followed = {page.before for some in found.values() for _, page, _ in some}
    left = []
    for some in found.values():
        kept = next((one for one in some if one[2] in followed), some[0])
        left += [path for path, _, _ in some if path != kept[0]]
    return left
