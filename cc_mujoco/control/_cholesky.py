"""Normal equations of the active unknowns, compiled."""

import math

from cc_mujoco.native import FloatArray, FloatMatrix, internal


@internal
def solve_active(
    normal: FloatMatrix, active: FloatArray, factor: FloatMatrix, found: FloatArray
) -> None:
    """Solve normal equations by Cholesky for the active unknowns; others become 0.

    The lower triangle of the symmetric matrix `normal` is read; `factor` may be the
    same memory. Unknowns with a nonzero number in `active` (n,) are active. `found`
    (n,) is the right side before and the solution after.
    """
    n = found.size
    for i in range(n):
        for j in range(i + 1):
            both = active[i] != 0.0 and active[j] != 0.0
            total = normal[i, j] if both else (1.0 if i == j else 0.0)
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            factor[i, j] = math.sqrt(total) if i == j else total / factor[j, j]
    for i in range(n):
        total = found[i] if active[i] != 0.0 else 0.0
        for k in range(i):
            total -= factor[i, k] * found[k]
        found[i] = total / factor[i, i]
    for i in range(n - 1, -1, -1):
        total = found[i]
        for k in range(i + 1, n):
            total -= factor[k, i] * found[k]
        found[i] = total / factor[i, i]
