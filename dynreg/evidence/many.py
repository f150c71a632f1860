"""From how many parameters a robot is dear to diagnose; no heavy imports, for the words of a command need it, too."""

# aibo, with 38, takes hours where the quadruped, with 13, takes minutes: derivatives cost one simulator a parameter.
MANY = 30
