"""What a registry holds is listed in a stated order: as it came, or by name."""

import pytest
from hands import files_of, stored
from registry_contents import POPULATION, ROBOT, fill, make_measured, make_recording

from dynreg.errors import Damaged
from dynreg.registry import Registry
from dynreg.verbs.list import KINDS, listing
from dynreg.verbs.remove import remove


def names(registry: Registry, kind: str) -> list[str]:
    return [item.name for item in listing(registry, kind).items]


def test_recordings_and_results_stand_as_they_came_and_others_by_name(path, robot) -> None:
    with Registry.open(path, create=True) as registry:
        fill(registry, robot)
        for seed, name in enumerate("cabd"):
            registry.put_recording(make_recording(seed), ROBOT, name)
            registry.put_measured(make_measured(make_recording(seed).id))
            registry.put_result("neighbours" if name in "ad" else "diagnosis", name, {"k": seed})
        for number in range(12):
            kind = "nominal" if number % 3 else "synthesised"
            told = {"robot_name": "leg" if number % 2 else "arm", "values": {"mass": float(number)}}
            registry.put_simulator(told | {"lineage": {"made_by": "query", "kind": kind}})
        assert names(registry, "recording") == ["c", "a", "b", "d"]
        assert names(registry, "result") == ["diagnosis", "neighbours", "diagnosis", "neighbours"]
        assert names(registry, "measured") == ["a", "b", "c", "d"]
        simulators = names(registry, "simulator")
        assert simulators == sorted(simulators) and len(simulators) == 12
        assert simulators[0].startswith("arm nominal") and simulators[-1].startswith("leg synthesised")
        kinds = [item.kind for item in listing(registry).items]
        assert kinds == sorted(kinds, key=KINDS.index) and listing(registry).items[0].id == POPULATION


def put(registry: Registry, kind: str, number: int) -> str:
    if kind == "result":
        return registry.put_result("diagnosis", None, {"k": number})
    return registry.put_simulator({"robot_name": "arm", "values": {"mass": float(number)}})


@pytest.mark.parametrize("kind", ["result", "simulator"])
def test_what_is_damaged_is_listed_and_can_be_removed(kind, path, robot) -> None:
    with Registry.open(path, create=True) as registry:
        fill(registry, robot)
        sound, before = put(registry, kind, 1), {*stored(path)}
        damaged = put(registry, kind, 2)
    (name,) = (name for name in {*stored(path)} - before if name.startswith(f"{kind}s/"))
    with files_of(path) as files:
        (files / name).write_bytes(b"junk")
    with Registry.open(path) as registry:
        with pytest.warns(Damaged, match=f"{kind} {damaged[:12]} cannot be read"):
            told = {item.id: item.name for item in listing(registry, kind).items}
        assert told[damaged] == "damaged" and told[sound] != "damaged"
        with pytest.warns(Damaged):
            assert [item.id for item in remove(registry, [damaged]).items] == [damaged]
        assert [item.id for item in listing(registry, kind).items] == [sound]
