"""Scores of a gait's trials on the robot; no heavy imports, for documents tell them, too."""


class Scores:
    """What trials of a gait came to, in the task's unit; None for the fall that ended them."""

    scores: tuple[float | None, ...]

    @property
    def fell(self) -> bool:
        """Whether the gait is discarded."""
        return None in self.scores

    @property
    def score(self) -> float:
        """The mean over its trials; 0 after a fall."""
        return 0.0 if None in self.scores else sum(self.scores) / len(self.scores)
