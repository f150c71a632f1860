"""The kinds of verdicts and of doubts; without heavy imports, for results name them, too."""

from typing import Literal

Verdict = Literal["named", "ambiguous", "partly_explained", "unknown", "none"]
DoubtKind = Literal[
    "pulled", "parameter_at_bound", "size_at_bound", "small", "no_gain", "no_better", "unlike"
]
