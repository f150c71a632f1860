"""Names of the searches for gaits, and of what they may raise; without heavy imports."""

from dynreg.search.table import SEARCHES

METHODS = tuple(SEARCHES)
ACCEPT = ("min", "mean", "quantile")
