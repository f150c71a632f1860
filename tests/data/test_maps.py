"""A map that is wrong says where; a map that is right converts as it says."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynreg.data.ingest import read_recording
from dynreg.data.maps import LogMap, check_map, parse_map, read_map
from dynreg.data.schema import RecordingSpec
from dynreg.data.units import UNITS, conversion
from dynreg.errors import MapError

GOOD = """\
[map]
robot = "servo_pendulum"
time = "timestamp"
[channels."arm/position"]
source = "position"
unit = "deg"
[channels."arm/velocity"]
derivative_of = "arm/position"
filter_hz = 20.0
[channels."arm/target"]
source = "goal"
[settings.kp]
metadata = "kp"
[episodes]
name = "{trajectory}_kp{kp:.0f}"
"""


def test_good_map_fits_its_robot(servo_spec: RecordingSpec):
    check_map(parse_map(GOOD), servo_spec)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('source = "goal"', 'sorce = "goal"', r"my.toml, line 1[01]: .*source"),
        ('unit = "deg"', 'unit = "degrees"', r"my.toml, line 4: .*unknown unit 'degrees'"),
        ('unit = "deg"', "unti = 'deg'", r"my.toml, line 6: unknown key 'channels.arm/position.unti'.*unit"),
        ("filter_hz = 20.0", "filter_hz = -1", r"my.toml, line 9: .*greater than 0"),
        ('time = "timestamp"', "time =", r"my.toml: .*line 3"),
        ('metadata = "kp"', 'filename = "kp"', r"my.toml, line 12: .*0 groups"),
        ('metadata = "kp"', 'metadata = "kp"\nvalue = 1.0', r"my.toml, line 12: .*one of"),
        ("{trajectory}", "{trajectory.__class__}", r"my.toml, line 14: .*plain names"),
        ("[episodes]", "[epsiodes]", r"my.toml, line 14: unknown key 'epsiodes'"),
        ("[episodes]", '[episodes]\nby = "column"', r"my.toml, line 14: .*column"),
    ],
)
def test_faults_name_the_line(old: str, new: str, message: str):
    assert old in GOOD
    with pytest.raises(MapError, match=message):
        parse_map(GOOD.replace(old, new), "my.toml")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('robot = "servo_pendulum"', 'robot = "leg"', "is for robot 'leg'"),
        ('"arm/target"', '"arm/goal"', "'arm/goal', which the robot does not have"),
        ("settings.kp", "settings.kd", "setting 'kd'"),
        ('unit = "deg"', 'unit = "V"', "channel 'arm/position': unit 'V' cannot become 'rad'"),
        ('derivative_of = "arm/position"', 'derivative_of = "arm/velocity"', "'arm/velocity'"),
        ('[channels."arm/target"]\nsource = "goal"', "", "no source for channel 'arm/target'"),
    ],
)
def test_maps_are_held_against_the_robot(old: str, new: str, message: str, servo_spec: RecordingSpec):
    assert old in GOOD
    with pytest.raises(MapError, match=message):
        check_map(parse_map(GOOD.replace(old, new)), servo_spec)


def test_all_channels_that_a_map_lacks_are_named_at_once(servo_spec: RecordingSpec):
    """One at a time they took as many tries as the robot has channels."""
    alone = '[channels."arm/velocity"]\nsource = "speed"\n'
    with pytest.raises(MapError) as error:
        check_map(parse_map(alone), servo_spec)
    told = str(error.value)
    assert "no source for channels 'arm/position', 'arm/target'; expected [channels.\"arm/position\"]" in told
    assert told.endswith("; add them to the map")


def test_a_velocity_that_a_map_lacks_can_be_computed_where_its_position_is_there(servo_spec: RecordingSpec):
    lacks = GOOD.replace('[channels."arm/velocity"]\nderivative_of = "arm/position"\nfilter_hz = 20.0\n', "")
    with pytest.raises(MapError, match="for channel 'arm/velocity'") as error:
        check_map(parse_map(lacks), servo_spec)
    advice = 'derivative_of = "arm/position"'
    assert error.value.do.endswith(f"{advice} computes 'arm/velocity'")
    check_map(parse_map(f'{lacks}\n[channels."arm/velocity"]\n{advice}\n'), servo_spec)
    with pytest.raises(MapError, match="'arm/position', 'arm/velocity', 'arm/target'") as error:
        check_map(parse_map("[channels]"), servo_spec)
    assert "derivative_of" not in str(error.value)


def test_a_missing_file_is_an_error_too(tmp_path: Path):
    with pytest.raises(MapError, match="cannot be read"):
        read_map(tmp_path / "none.toml")


def test_no_class_of_python_is_named():
    with pytest.raises(
        MapError, match=r"line 1: 'channels.arm/position' = 3: this should be a table"
    ) as error:
        parse_map('channels."arm/position" = 3')
    assert "ChannelMap" not in str(error.value)


@pytest.mark.parametrize(
    ("value", "unit", "to", "expected"),
    [
        (180, "deg", "rad", 3.141592653589793),
        (60, "rpm", "rad/s", 6.283185307179586),
        (250, "ms", "s", 0.25),
        (300.15, "K", "degC", 27.0),
        (212, "degF", "degC", 100.0),
        (500, "g", "kg", 0.5),
        (50, "percent", "1", 0.5),
        (1, "m", "mm", 1000),
    ],
)
def test_known_conversions(value: float, unit: str, to: str, expected: float):
    factor, offset = conversion(unit, to)
    assert factor * value + offset == pytest.approx(expected)


@given(st.sampled_from(sorted(UNITS)), st.sampled_from(sorted(UNITS)), st.floats(-1e3, 1e3))
def test_conversions_there_and_back(unit: str, to: str, value: float):
    if UNITS[unit][0] != UNITS[to][0]:
        with pytest.raises(MapError, match="cannot become"):
            conversion(unit, to)
        return
    (a, b), (c, d) = conversion(unit, to), conversion(to, unit)
    assert c * (a * value + b) + d == pytest.approx(value, rel=1e-9, abs=1e-6)


def test_packaged_and_example_maps_are_valid():
    root = Path(__file__).parents[2]
    maps = [*root.glob("dynreg/robots/*/maps/*.toml"), *root.glob("examples/maps/*.toml")]
    assert len(maps) >= 8
    for path in maps:
        read_map(path)


def test_values_that_a_map_drops_and_clips(write_table, swing, servo_spec):
    """Beyond `valid`, as spikes, as far from their neighbours' median; each is counted in a finding."""
    swing["arm__position"][100] = 9.0
    swing["arm__position"][300] += 0.3
    base = {name: {"source": name} for name in ("arm/position", "arm/velocity", "arm/target")}
    path = write_table(**swing)

    def read(**keys) -> tuple[np.ndarray, list[str]]:
        drafted = {"channels": base | {"arm/position": {"source": "arm/position", **keys}}}
        recording = read_recording(path, servo_spec, LogMap.model_validate(drafted))
        told = recording.provenance["findings"]
        assert not [f for f in told if f["check"] == "nan"]  # it was asked for
        found = [f["message"] for f in told if f["check"] == "dropped"]
        return recording.episodes[0].values[:, 0], found

    true = np.sin(3 * 0.01 * np.arange(401))
    values, found = read(valid=[-3, 3], outliers="drop")
    np.testing.assert_allclose(values, true, atol=1e-3)
    assert found == ["values are dropped: 1 beyond `valid`, 1 as `outliers`"]
    values, found = read(outliers=0.2)
    np.testing.assert_allclose(values, true, atol=1e-3)
    assert found == ["values are dropped: 2 as `outliers`"]
    values, found = read(clip=[-0.5, 0.5])
    assert np.abs(values).max() == 0.5 and len(found) == 1
    assert read()[0][50] == 9.0


def test_values_that_the_log_lacks_are_told_beside_those_that_a_map_drops(write_table, swing, servo_spec):
    swing["arm__position"][300] += 0.3
    swing["arm__position"][500] = np.nan
    names = ("arm/position", "arm/velocity", "arm/target")
    drafted = {"channels": {name: {"source": name} for name in names}}
    drafted["channels"]["arm/position"]["outliers"] = "drop"
    recording = read_recording(write_table(**swing), servo_spec, LogMap.model_validate(drafted))
    (found,) = [f for f in recording.provenance["findings"] if f["check"] == "nan"]
    assert "row 500" in found["where"] and found["message"].startswith("1 of 801 values")


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("valid = [3, -3]", "give the lower number first"),
        ("outliers = -1.0", "above 0"),
        ('outliers = "keep"', "line 4"),
        ("clip = [0.1]", "line 4"),
        ('angle = "yaws"', "line 4"),
        ('angle = "yaw"\nunit = "deg"', "leave `unit` out"),
    ],
)
def test_what_a_map_cannot_say_of_values(line: str, said: str):
    with pytest.raises(MapError, match="line [234]") as error:
        parse_map(f'\n[channels."arm/position"]\nsource = "q"\n{line}\n')
    assert said in str(error.value)


def test_a_setting_with_an_offset(write_table, swing, servo_spec):
    names = ("arm/position", "arm/velocity", "arm/target")
    told = {"kp": {"metadata": "kp", "scale": 0.5, "offset": -20.0}}
    log_map = LogMap.model_validate({"channels": {n: {"source": n} for n in names}, "settings": told})
    recording = read_recording(write_table(**swing), servo_spec, log_map)
    assert recording.episodes[0].settings["kp"] == 180.0


def test_all_columns_that_a_log_without_a_map_lacks_are_named(
    write_table: Callable, swing: dict[str, np.ndarray], servo_spec: RecordingSpec
):
    del swing["arm__velocity"], swing["arm__target"]
    with pytest.raises(MapError, match="has no column 'arm/velocity', 'arm/target'; .*it has 'arm/position'"):
        read_recording(write_table(**swing), servo_spec)
