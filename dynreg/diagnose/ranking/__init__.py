"""Ranking: which causes a log looks like, by simulators that carry one effect or none under the same commands."""
