import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynreg.errors import UsageError
from dynreg.sim.space import Parameter, ParameterSpace

finite = st.floats(-1e6, 1e6)


@st.composite
def spaces(draw):
    parameters = []
    for i in range(draw(st.integers(1, 5))):
        scale = draw(st.sampled_from(["linear", "log"]))
        low = draw(st.floats(1e-6, 1e3) if scale == "log" else finite)
        high = low * draw(st.floats(1.01, 1e3)) if scale == "log" else low + draw(st.floats(0.1, 1e6))
        parameters.append(Parameter(f"p{i}", "1", low, low, high, scale, np.inf, ()))
    return ParameterSpace(tuple(parameters))


def _space() -> ParameterSpace:
    return ParameterSpace(
        (
            Parameter("mass", "kg", 2.0, 1.0, 4.0, "log", 0.1, ()),
            Parameter("offset", "rad", 0.0, -0.5, 0.5, "linear", np.inf, ()),
        )
    )


@settings(max_examples=60)
@given(spaces(), st.integers(0, 1000))
def test_unit_cube_and_values_are_one_to_one(space: ParameterSpace, seed: int):
    unit = np.random.default_rng(seed).random((7, len(space)))
    values = space.from_unit(unit)
    assert np.all(values >= space.bounds[:, 0]) and np.all(values <= space.bounds[:, 1])
    np.testing.assert_allclose(space.to_unit(values), unit, atol=1e-6)
    np.testing.assert_allclose(space.from_unit(space.to_unit(values)), values, rtol=1e-6, atol=1e-9)


@given(spaces())
@settings(max_examples=30)
def test_corners_of_the_cube_are_the_bounds(space: ParameterSpace):
    np.testing.assert_allclose(space.from_unit(np.zeros(len(space))), space.bounds[:, 0], rtol=1e-12)
    np.testing.assert_allclose(space.from_unit(np.ones(len(space))), space.bounds[:, 1], rtol=1e-12)
    np.testing.assert_array_equal(
        space.from_unit(np.full(len(space), 7.0)), space.from_unit(np.ones(len(space)))
    )


def test_the_middle_of_a_log_range_is_its_geometric_mean():
    np.testing.assert_allclose(_space().from_unit(np.array([0.5, 0.5])), [2.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("cut", [1, 3, 8, 13])
def test_a_sample_never_depends_on_how_many_are_drawn(cut: int):
    space = _space()
    parts = np.concatenate([space.sample(0, cut, 5), space.sample(cut, 16, 5)])
    np.testing.assert_array_equal(parts, space.sample(0, 16, 5))


def test_samples_of_another_seed_differ_and_fill_the_range():
    space = _space()
    assert not np.allclose(space.sample(0, 8, 0), space.sample(0, 8, 1))
    unit = space.to_unit(space.sample(0, 64, 0))
    counts = np.stack([np.histogram(column, bins=8, range=(0, 1))[0] for column in unit.T])
    assert np.all(counts == 8)  # a Sobol sequence is balanced, chance would not be


def test_dictionaries_and_vectors_are_one_to_one():
    space = _space()
    values = np.array([1.5, 0.25])
    np.testing.assert_array_equal(space.from_dict(space.as_dict(values)), values)
    np.testing.assert_array_equal(space.from_dict({"offset": 0.1}), [2.0, 0.1])


def test_other_ranges_move_the_nominal_value_inside():
    changed = _space().with_ranges({"mass": (3.0, 5.0)})
    np.testing.assert_array_equal(changed.bounds, [[3.0, 5.0], [-0.5, 0.5]])
    np.testing.assert_array_equal(changed.nominal, [3.0, 0.0])


@pytest.mark.parametrize(
    ("ranges", "said"),
    [({"mas": (1, 2)}, "mas"), ({"mass": (2, 1)}, "2..1"), ({"mass": (0, 1)}, "log")],
)
def test_bad_ranges_are_refused(ranges: dict, said: str):
    with pytest.raises(UsageError, match=said):
        _space().with_ranges(ranges)


def test_unknown_names_are_refused():
    with pytest.raises(UsageError, match="'mas'.*one of.*mass"):
        _space().from_dict({"mas": 1.0})
