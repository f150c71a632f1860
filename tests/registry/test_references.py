"""What a person types finds the one thing that is meant, or an error that shows what comes near."""

import pytest
from registry_contents import POPULATION, ROBOT, make_population, make_recording

from dynreg.errors import NoMatchError, RegistryError
from dynreg.registry import references


def test_ids_prefixes_and_names_resolve(registry):
    entry, recording = registry.load("bench", ()).ids[3], make_recording(1).id
    assert registry.resolve(entry) == registry.resolve(entry[:20]) == ("entry", entry)
    assert registry.resolve("first run") == registry.resolve(recording[:12]) == ("recording", recording)
    assert registry.resolve("bench") == registry.resolve("cdcd") == ("population", POPULATION)
    assert registry.resolve("arm") == ("robot", ROBOT)
    result, simulator = registry.latest().id, registry.put_simulator({"a": 1})
    assert registry.resolve(result[:16]) == ("result", result)
    assert registry.resolve(simulator) == ("simulator", simulator)


def test_last_is_the_recording_ingested_last(registry):
    first = make_recording(1).id
    second = registry.put_recording(make_recording(2), ROBOT)
    assert registry.resolve("@last") == ("recording", second)
    registry.put_recording(make_recording(1), ROBOT)
    assert registry.resolve("@last") == ("recording", first)
    assert [info.id for info in registry.recordings()] == [second, first]


def test_a_name_goes_before_a_prefix(registry):
    prefix = make_recording(1).id[:6]
    second = registry.put_recording(make_recording(2), ROBOT, prefix)
    assert registry.resolve(prefix) == ("recording", second)


def test_ambiguous_refs_say_what_they_fit(registry):
    other = make_population(seed=8)
    object.__setattr__(other, "id", POPULATION[:10] + "f" * 54)
    registry.put_population(other)
    for ref, do in ((POPULATION[:8], "give more digits"), ("bench", "give the first digits of the id")):
        with pytest.raises(NoMatchError, match=f"fits more than one: population cdcdcdcdcd.*; {do}"):
            registry.resolve(ref)
    assert registry.resolve(POPULATION[:12]) == ("population", POPULATION)


@pytest.mark.parametrize("ref", ["frst run", "cdc", "fffffff", "", "cd%", "CDCD", "@next", "@lst"])
def test_what_fits_nothing_is_no_match(registry, ref):
    with pytest.raises(NoMatchError) as error:
        registry.resolve(ref)
    assert error.value.exit_status == 4
    assert ("near: first run" in str(error.value)) == (ref == "frst run")
    assert ("near: @last" in str(error.value)) == (ref == "@lst")


def test_only_the_kinds_asked_for_are_found(registry):
    with pytest.raises(NoMatchError, match="no entry is called 'first run'"):
        registry.resolve("first run", ("entry",))
    with pytest.raises(NoMatchError) as error:
        registry.resolve("@last", ("population",))
    assert (
        "no population is called '@last'; expected a hash, a unique prefix of 4 digits or more, or a name"
        in str(error.value)
    )
    with pytest.raises(RegistryError, match="recording"):
        registry.resolve("bench", ("log",))
    kinds = {"robot", "population", "entry", "recording", "measured", "simulator", "result"}
    assert set(references.KINDS) == kinds


def test_there_is_no_last_recording_in_an_empty_registry(tmp_path):
    from dynreg.registry import Registry

    with (
        Registry.open(tmp_path / "new", create=True) as registry,
        pytest.raises(NoMatchError, match="ingest"),
    ):
        registry.resolve("@last")


def test_one_recording_is_told_without_reading_it(registry):
    unnamed = registry.put_recording(make_recording(2), ROBOT)
    registry.put_recording(make_recording(1), ROBOT, "again")
    info = registry.recording_info("again")
    assert info in registry.recordings() and info.robot_hash == ROBOT
    assert info.names == ("again", "first run") and info.name == "again"
    assert registry.recording_info(unnamed[:12]).name == unnamed[:12]
    assert registry.holds(unnamed) and not registry.holds("0" * 64)
    with pytest.raises(NoMatchError):
        registry.recording_info("0" * 64)
