"""Names of the searches for gaits, and of what they may raise; without heavy imports."""

METHODS = ("cma", "hill", "random")
ACCEPT = ("min", "mean", "quantile")
ACCEPT_OF_POPULATION = (
    "mean"  # some draws of the ranges cannot even stand: their minimum is 0 whatever the gait
)
SOURCES = ("neighbours", "synthesised", "diagnosed", "nominal", "random", "population")


def usual_accept(on: str) -> str:
    """What a search raises where nobody says: the minimum, but the mean over draws of the ranges."""
    return ACCEPT_OF_POPULATION if on == "population" else ACCEPT[0]
