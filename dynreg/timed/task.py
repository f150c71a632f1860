"""The size of the navigation task of Pretorius et al.; without numpy, for options name it."""

COMMANDS = 10  # of a plan
