"""The materials of a robot: named groups of geoms, as `[[materials]]` of robot.toml has them."""

from collections.abc import Iterator, Sequence
from fnmatch import fnmatchcase

from dynreg.errors import RobotError, one_of
from dynreg.sim.spec import RobotFile
from dynreg.tomlfile import Location, line_of

Problem = tuple[Location, str, str, str]  # where it stands, what is wrong, what is expected, what to do


def geoms_of(file: RobotFile, text: str, name: str, geoms: Sequence[str]) -> dict[str, tuple[int, ...]]:
    """{material: numbers of its geoms}, of the names of all geoms of a model.

    Raises RobotError, with the line of `text`, where a glob matches nothing, or a geom is of two materials.
    """
    for location, problem, expected, do in material_problems(file, geoms):
        raise RobotError(f"{name}, line {line_of(text, location)}: {problem}", expected=expected, do=do)
    return {
        table.name: tuple(i for i, geom in enumerate(geoms) if any(_is(geom, glob) for glob in table.geoms))
        for table in file.materials
    }


def material_problems(file: RobotFile, geoms: Sequence[str]) -> Iterator[Problem]:
    """What is wrong with the materials of a file on a model with geoms of these names ("" for none)."""
    owner: dict[int, str] = {}
    for number, table in enumerate(file.materials):
        location = ("materials", number, "geoms")
        own = set()
        for glob in table.geoms:
            found = {i for i, geom in enumerate(geoms) if _is(geom, glob)}
            own |= found
            if not found:
                problem = f"material {table.name!r}: no geom is named {glob!r}"
                yield (
                    location,
                    problem,
                    one_of([g for g in geoms if g], "", "the model names no geom"),
                    "correct it, or name the geom",
                )
        for i in sorted(own & {*owner}):
            problem = f"geom {geoms[i]!r} is of two materials, {owner[i]!r} and {table.name!r}"
            yield location, problem, "one material for each geom", "correct `geoms` of one of them"
        owner |= dict.fromkeys(own, table.name)


def _is(geom: str, glob: str) -> bool:
    return bool(geom) and fnmatchcase(geom, glob)
