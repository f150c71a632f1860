"""Array types by shape, one letter an axis.

B simulations or batch, N rows, T time steps, S state channels, A actions, I inputs, K settings,
P parameters, M models, C channels, D dimensions of an embedding.
"""

from jaxtyping import Float, Int
from numpy import ndarray

Times = Float[ndarray, "T"]
Samples = Float[ndarray, "T C"]
Rows = Float[ndarray, "N C"]
States = Float[ndarray, "N S"]
Context = Float[ndarray, "N K"]
Values = Float[ndarray, "B P"]
Vectors = Float[ndarray, "N D"]
Ids = Int[ndarray, "N"]
Distances = Float[ndarray, "N"]
