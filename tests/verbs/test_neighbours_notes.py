"""What a query says of its parameters."""

from dynreg.results.result import Estimate
from dynreg.verbs.neighbours import bound_notes


def estimate(value: float, low: float, high: float, *, at_bound: bool = True) -> Estimate:
    told = {"unit": "N*m", "nominal": 0.1, "limits": (low, high), "at_bound": at_bound}
    return Estimate(value=value, low=value, high=value, **told)


def test_a_range_is_widened_where_a_parameter_could_go_further():
    found = {
        "no_friction": estimate(0.0, 0.0, 1.0),  # there is none below 0
        "friction": estimate(1.0, 0.0, 1.0),
        "gain": estimate(0.4, 0.4, 2.5),
        "mass": estimate(1.0, 0.5, 2.0, at_bound=False),
    }
    (note,) = bound_notes(found)
    assert note.startswith("friction, gain are at the edge of the population's range: widen the range")
    assert not bound_notes({"no_friction": found["no_friction"], "mass": found["mass"]})
