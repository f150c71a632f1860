"""A stranger's files, whole by their own hashes: what their headers say is checked before anything is made of it."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from registry_contents import (
    POPULATION,
    ROBOT,
    make_measured,
    make_population,
    make_recording,
    make_robot,
    make_shard,
)

import dynreg.registry.entries as entries
import dynreg.registry.measured as measured
import dynreg.registry.populations as populations
import dynreg.registry.shards as shards
from dynreg.errors import CorruptError, RegistryError
from dynreg.registry import Registry, verify
from dynreg.registry.codec import encode_arrays
from dynreg.registry.loading import load_shards

HEADERS = {
    "a list of half a billion numbers": {"shape": [10**10, 0, 5, 3]},
    "a size that is no whole number": {"shape": [2.0, 2, 5, 3]},
    "a size below zero": {"shape": [-2, -2, 5, 3]},
    "a size beyond every limit": {"shape": [2, 2, 10**400, 3]},
    "more entries than its numbers": {"shape": [4, 1, 5, 3]},
    "a period that no float holds": {"periods": [[0.02, 10**400]] * 2},
    "a period that is no number": {"periods": [[0.02, float("nan")]] * 2},
    "a period of zero": {"periods": [[0.02, 0.0]] * 2},
    "numbers of more entries": {"stop": 7},
    "numbers that are texts": {"start": "0", "stop": "2"},
    "states that are others": {"states": ["arm/velocity", "arm/position", "supply"]},
    "states of which one stands twice": {"states": ["arm/position", "arm/position", "supply"]},
    "states that are no names": {"states": [["arm/position"], 1, None]},
    "a form of tomorrow": {"schema": "dynreg/shard/99"},
}

ACTIONS = np.ones((2, 4, 1))
POPULATIONS = {
    "no commands": ({}, {"bank.actions": None}),
    "commands of fewer steps": ({}, {"bank.actions": ACTIONS[:, :2]}),
    "commands of fewer episodes": ({}, {"bank.settings": np.zeros((1, 1))}),
    "commands of more columns": ({}, {"bank.inputs": np.ones((2, 4, 2))}),
    "commands without axes": ({}, {"bank.actions": np.ones(8)}),
    "units of fewer parameters": ({"parameter_units": ["kg"]}, {}),
    "units that are a text": ({"parameter_units": "kg"}, {}),
    "columns that are numbers": ({"actions": [[1, 2]]}, {}),
    "columns that are texts": ({"inputs": ["ab"]}, {}),
    "a parameter that stands twice": ({"parameters": ["mass", "mass"]}, {}),
    "ranges that are a list": ({"spec": {"ranges": [["mass", 0.5, 2.0, "linear"]]}}, {}),
    "a range that no float holds": ({"spec": {"ranges": {"mass": [0.5, 10**400, "linear"]}}}, {}),
}


@pytest.fixture
def write(tmp_path: Path) -> Callable[[], Path]:
    """Write a registry of a population of two entries in one shard."""

    def written() -> Path:
        with Registry.open(tmp_path / "registry", create=True) as made:
            made.put_robot(make_robot(tmp_path / "robot"), ROBOT, "arm")
            made.put_population(make_population(2))
            made.put_shard("bench", 0, make_shard(0, 2))
        return tmp_path / "registry"

    return written


def ask(path: Path) -> None:
    """Ask everything that reads the rows of entries."""
    with Registry.open(path) as opened:
        entry = make_shard(0, 2).entry_ids(POPULATION)[0]
        for asked in (
            lambda: opened.load("bench"),
            lambda: opened.load_entry(entry),
            lambda: opened.parts("bench")[0].read(),
            lambda: list(load_shards(opened.directory, POPULATION)),
        ):
            with pytest.raises(CorruptError) as raised:
                asked()
            assert "\n" not in str(raised.value)


@pytest.mark.parametrize("title", HEADERS)
def test_a_shard_whose_header_lies_is_refused_and_found(title: str, write, monkeypatch) -> None:
    told = shards._header
    monkeypatch.setattr(shards, "_header", lambda *a: told(*a) | HEADERS[title])
    path = write()
    ask(path)
    assert verify(path).faults
    verify(path, repair=True)
    assert not verify(path).faults


TOLD = {
    "other ids": {"entries": ["ab" * 32, "cd" * 32]},
    "other parameters": {"parameters": {"mass": {"unit": "kg", "values": [9.0, 9.0]}}},
    "other losses": {"own_loss": [0.0, 0.0]},
    "other units": {"columns": {"arm/position": {"role": "state", "unit": "deg"}}},
    "nothing": {"entries": None},
}


@pytest.mark.parametrize("title", TOLD)
def test_a_header_that_tells_strangers_something_else_is_found(title: str, write, monkeypatch) -> None:
    told = shards._header
    with monkeypatch.context() as lying:
        lying.setattr(shards, "_header", lambda *a: told(*a) | TOLD[title])
        path = write()
    assert any("is not what it holds" in fault.problem for fault in verify(path).faults)


def test_a_shard_of_tomorrow_is_not_called_damaged(write: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shards, "SCHEMA", "dynreg/shard/99")
    path = write()
    with pytest.raises(CorruptError, match="newer dynreg"), Registry.open(path) as opened:
        opened.load("bench")


@pytest.mark.parametrize("title", POPULATIONS)
def test_a_population_whose_parts_do_not_agree_is_refused_and_found(
    title: str, write, tmp_path, monkeypatch
) -> None:
    header, changed = POPULATIONS[title]

    def lies(arrays: dict[str, np.ndarray], told: dict[str, Any]) -> bytes:
        both = dict(arrays) | changed
        return encode_arrays({k: v for k, v in both.items() if v is not None}, told | header)

    monkeypatch.setattr(populations, "encode_arrays", lies)
    with pytest.raises(CorruptError, match="populations/"):  # the shard needs it
        write()
    path = tmp_path / "registry"
    assert any(fault.kind == "population" for fault in verify(path).faults)
    verify(path, repair=True)


@pytest.mark.parametrize("size", [(2, 3), (1, 4), (3, 4)])
def test_commands_that_are_of_other_episodes_than_the_states_are_refused(size, write, monkeypatch) -> None:
    def lies(arrays: dict[str, np.ndarray], told: dict[str, Any]) -> bytes:
        other = {"bank.actions": np.ones((*size, 1)), "bank.inputs": np.ones((*size, 1))}
        return encode_arrays(dict(arrays) | other | {"bank.settings": np.ones((size[0], 1))}, told)

    record = make_population(2)
    with monkeypatch.context() as patched:
        patched.setattr(populations, "encode_arrays", lies)
        patched.setattr(entries, "get_population", lambda *told: record)
        path = write()
    ask(path)
    assert any("of its population" in fault.problem for fault in verify(path).faults)


def test_entries_of_other_steps_than_the_commands_are_not_put(tmp_path: Path) -> None:
    with Registry.open(tmp_path / "registry", create=True) as made:
        made.put_robot(make_robot(tmp_path / "robot"), ROBOT, "arm")
        made.put_population(make_population(2))
        with pytest.raises(RegistryError, match="states of shape"):
            made.put_shard("bench", 0, make_shard(0, 2, steps=6))


def test_a_population_whose_columns_were_never_told_still_opens(tmp_path: Path) -> None:
    untold = {name: () for name in ("actions", "inputs", "settings", "parameter_units")}
    with Registry.open(tmp_path / "registry", create=True) as made:
        made.put_robot(make_robot(tmp_path / "robot"), ROBOT, "arm")
        made.put_population(make_population(2, **untold, arrays={}))
        made.put_shard("bench", 0, make_shard(0, 2))
        assert made.parts("bench")[0].read()[0].actions.shape == (2, 5, 0)


FIT = {"w0": np.ones((3, 4), np.float16), "b0": np.ones(4, np.float16)}
MODELS = {
    "weights that are not finite": ({}, FIT | {"b0": np.full(4, np.nan, np.float16)}),
    "weights of another shape": ({}, FIT | {"b0": np.ones(5, np.float16)}),
    "weights of another kind of number": ({}, FIT | {"b0": np.ones(4, np.float32)}),
    "weights that are whole numbers": ({}, FIT | {"b0": np.ones(4, np.int64)}),
    "weights of another name": ({}, FIT | {"b1": np.ones(4, np.float16)}),
    "a loss that no float holds": ({"own_loss": 10**400}, FIT),
    "a loss that is no number": ({"train_loss": float("nan")}, FIT),
    "a loss that is a text": ({"own_loss": "0.5"}, FIT),
}


@pytest.mark.parametrize("title", MODELS)
def test_a_measured_model_that_is_none_is_refused_and_found(title: str, write, monkeypatch) -> None:
    header, weights = MODELS[title]

    def lies(arrays: dict[str, np.ndarray], told: dict[str, Any]) -> bytes:
        return encode_arrays(arrays, told | header)

    path = write()
    with Registry.open(path) as opened:
        recording = opened.put_recording(make_recording(1), ROBOT, "first run")
        entry = replace(make_measured(recording), weights=weights)
        with monkeypatch.context() as patched:
            patched.setattr(measured, "encode_arrays", lies)
            if not header:
                with pytest.raises(RegistryError, match="a model in population"):
                    opened.put_measured(entry)
            patched.setattr(measured, "_oddity", lambda *told: "")
            identity = opened.put_measured(entry)
        with pytest.raises(CorruptError, match="measured/"):
            opened.measured(identity)
    assert any(fault.kind == "measured" for fault in verify(path).faults)
    verify(path, repair=True)
    assert not verify(path).faults
