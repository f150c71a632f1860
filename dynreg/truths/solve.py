"""Speeds after a step: the inverse of the inertia matrix, and what dry friction takes off.

`kernels` compiles it.
"""

import numpy as np

SWEEPS = 20  # over the joints, of dry friction: six coupled joints need 4 to 9
ENOUGH = 1e-9  # rad/s that a sweep still changes


def invert(M, inverse, column):
    """Write the inverse of a positive definite M (n, n), whose lower half becomes its Cholesky factor."""
    n = len(M)
    for i in range(n):
        for j in range(i + 1):
            s = M[i, j]
            for k in range(j):
                s -= M[i, k] * M[j, k]
            M[i, j] = np.sqrt(s) if i == j else s / M[j, j]
    for c in range(n):
        for i in range(n):
            s = 1.0 if i == c else 0.0
            for k in range(i):
                s -= M[i, k] * column[k]
            column[i] = s / M[i, i]
        for i in range(n - 1, -1, -1):
            s = column[i]
            for k in range(i + 1, n):
                s -= M[k, i] * column[k]
            column[i] = s / M[i, i]
            inverse[i, c] = column[i]


def stop(V, inverse, bound, impulse):
    """Let dry friction take off speeds V (n,) what it can: impulses (n,) within +-bound.

    Those of the step before are where it begins.
    """
    n = len(V)
    for i in range(n):
        impulse[i] = min(max(impulse[i], -bound[i]), bound[i])
        for j in range(n):
            V[j] += inverse[j, i] * impulse[i]
    for _ in range(SWEEPS):
        moved = 0.0
        for i in range(n):
            if bound[i] == 0.0:
                continue
            after = min(max(impulse[i] - V[i] / inverse[i, i], -bound[i]), bound[i])
            change = after - impulse[i]
            if change != 0.0:
                impulse[i] = after
                for j in range(n):
                    V[j] += inverse[j, i] * change
                moved = max(moved, abs(change) * inverse[i, i])
        if moved < ENOUGH:
            break
