"""How much a search for causes takes on, where it is dear."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Effort:
    """What the usual figures are balanced for: what a diagnosis may cost on one core.

    long : terms from which a list is long: two joints, and all that can be wrong with each. draws : starts of the
        calibration besides the nameplate, of short lists.
    behind : nats behind the best of its own start, by the finer time step, from which a term of a long list is not
        refitted with it. On a leg no cause that won was more than 10 behind; the starts cannot be compared: one is
        calibrated, the other is not.
    alone, rival : iterations of the model without a term of a floating base on its feet, and of it from where the
        best of the others ended. iterations : of refits to the end, where they are not these.
    """

    long: int = 40
    iterations: int = 5
    draws: int = 4
    behind: float = 40.0
    alone: int = 4
    rival: int = 2


FULL = Effort()
