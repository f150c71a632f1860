"""Ask and tell take turns: what every search that learns from losses checks."""

from collections.abc import Sized

import numpy as np

from dynreg.errors import UsageError


def may_ask(asked: Sized | None) -> None:
    """UsageError where the candidates asked for last were not told yet; `asked` is None once they were."""
    if asked is not None:
        raise UsageError("ask after ask", expected="tell between two asks", do="tell the losses first")


def may_tell(asked: Sized | None, losses: Sized) -> None:
    """UsageError where nothing was asked, or where there is not one loss for each candidate."""
    if asked is None or len(losses) != len(asked):
        count = 0 if asked is None else len(asked)
        raise UsageError(f"{len(losses)} losses", expected=f"{count}, one for each asked", do="ask first")


def ranked(losses: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """(n,) numbers from the best to the worst, NaN last, and the place of each; ties fall at random.

    By their order instead, tournaments on flat ground would breed the first few alone.
    """
    order = np.lexsort((rng.random(len(losses)), losses))
    places = np.empty(len(losses), dtype=int)
    places[order] = np.arange(len(losses))
    return order, places
