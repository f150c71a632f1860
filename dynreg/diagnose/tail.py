"""What a share of simulated robots exceeds, from few of them."""

from collections.abc import Sequence

import numpy as np

# The largest scores to which the exponential tail is fitted. Five determine its slope to 1 / sqrt(5), 45 %; of 20
# robots, more than five do not belong to the tail.
TAIL, TENTH = 5, 10  # number of scores, and at least one in so many of all


def exceeded(scores: Sequence[float], share: float, confidence: float | None = None) -> float:
    """The score that at most a share of robots exceeds, from an exponential tail fitted to the largest scores.

    The excess over a high threshold is nearly exponential (J. Pickands, Statistical Inference Using Extreme Order
    Statistics, Ann. Stat. 3, 1975). The largest score alone would make the threshold depend on one robot.

    confidence : that no more do; None takes the mean excess as it is. Twice the sum of k excesses over their mean is
    chi-squared with 2 k degrees of freedom. The scatter of the score from which on the tail begins is left out: 0.8
    comes true in 0.80 of draws of 20 robots, in 0.71 of draws of 100.
    """
    from scipy.stats import chi2

    largest = np.sort(scores)[::-1]
    tail = min(max(TAIL, len(largest) // TENTH), len(largest) - 1)
    if tail == 0:
        return float(largest[0])
    excess = float(np.mean(largest[:tail] - largest[tail]))
    if confidence is not None:
        excess *= 2 * tail / chi2.ppf(1.0 - confidence, 2 * tail)
    return float(largest[tail]) + excess * np.log(tail / len(largest) / share)
