"""The posterior of what a recording leaves open, about normal, as a part of results."""

from typing import Literal

from pydantic import model_validator

from dynreg.results.result import Result


class Posterior(Result):
    """About normal in coordinates that run from 0 to 1 over each range; what lies beyond is clipped to the range.

    names : of D free quantities: parameters, and sizes of effects as "payload.share". scales : in which each is about
    normal: of the value, its logarithm, or its inverse. limits : values at the coordinates 0 and 1, in its unit.
    centre, deviations : mean and standard deviation, in coordinates. correlations : (D, D). untold : names of those of
    which the recording alone tells nothing.
    """

    names: tuple[str, ...]
    scales: tuple[Literal["linear", "log", "inverse"], ...]
    limits: tuple[tuple[float, float], ...]
    centre: tuple[float, ...]
    deviations: tuple[float, ...]
    correlations: tuple[tuple[float, ...], ...]
    untold: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _one_size(self) -> "Posterior":
        sizes = {len(one) for one in (self.names, self.scales, self.limits, self.centre, self.deviations)}
        sizes |= {len(self.correlations), *map(len, self.correlations)}
        if len(sizes) > 1:
            raise ValueError(f"a posterior of {sorted(sizes)} quantities at once")
        return self
