"""Names of the searches that `calibrate` can run: apart from it, so that the command line starts without it."""

METHODS = ("cmaes", "random")
