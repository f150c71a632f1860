"""Sizes of the navigation task of Pretorius et al. and of its search; without numpy, for options name them."""

COMMANDS = 10  # of a plan
POPULATION, TOURNAMENT = 200, 40  # of the genetic algorithm
