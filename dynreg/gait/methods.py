"""Names of the searches for gaits, and of what they may raise; without heavy imports."""

METHODS = ("cma", "hill", "random")
ACCEPT = ("min", "mean", "quantile")
