"""What a question says of where it begins."""

from types import SimpleNamespace

import numpy as np

from dynreg.methods.calibrator import Question
from dynreg.rng import stream
from dynreg.sim.space import Parameter, ParameterSpace


def test_a_nominal_value_that_was_rounded_was_not_fitted() -> None:
    """Through the unit cube and back, as a search leaves what it does not fit; in ranges of any kind."""
    rng, wide = stream(0, "rounded"), 1000
    low = rng.uniform(0.01, 3.0, wide)
    high = low * rng.uniform(1.2, 30.0, wide)
    nominal, scales = rng.uniform(low, high), ["linear", "log"] * (wide // 2)
    parameters = tuple(
        Parameter(f"p{i}", "1", *told, 0.1, ())
        for i, told in enumerate(zip(nominal.tolist(), low.tolist(), high.tolist(), scales, strict=True))
    )
    space = ParameterSpace(parameters)
    unit = space.to_unit(space.nominal)
    start = space.from_unit(unit)
    assert (space.to_unit(start) != unit).any(), "some are rounded in the unit cube, too"
    data = SimpleNamespace(robot=SimpleNamespace(space=space))
    assert not Question(data, start).fitted.any()
    start[7] = space.from_unit(unit + 1e-6)[7]
    assert np.flatnonzero(Question(data, start).fitted).tolist() == [7]
