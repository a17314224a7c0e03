"""Textile between a cable and what it pulls: a cubic spring whose fibres rub.

With the stretch x, the compliance C of the slack textile and a force F,

    P(x) = y + y^3 / F^2, y = x / C,        tension = P(x) + sum of friction,

and each of some elastoplastic elements in parallel (Jenkins, as in the chains of Iwan)
holds up to a share of P. A cycle loses up to 2 e / (1 + e) of the work of loading, with
e the sum of the shares. The textile is in series with the last piece of a cable, a
line of stiffness k.
"""

from __future__ import annotations

import numpy as np

from cc_mujoco.native import FloatArray, FloatMatrix, internal

HARD = 60.0  # F [N]
SHARE = np.array([0.06, 0.045, 0.03, 0.015])  # of P that each element holds
FIRM = np.array([4.0, 8.0, 16.0, 32.0])
"""Stiffness of each element over its share of that of the slack textile."""
AT_REST, NOW, STUCK = 0, 1, 2
"""Places in the state: stretch at rest and now; stretches at which elements pull
nothing."""


def fabric(compliance: float, tension: float) -> FloatMatrix:
    """Return the states of both cables' textile at rest at a tension [N]."""
    roots = np.roots([1.0 / HARD**2, 0.0, 1.0, -tension])
    stretch = compliance * float(roots[np.abs(roots.imag) < 1e-9].real[0])
    return np.full((2, STUCK + SHARE.size), stretch)


@internal
def _pull(compliance: float, state: FloatArray, x: float) -> tuple[float, float]:
    """Return the tension at a stretch x > 0 [N], and its slope [N/m]."""
    y = x / compliance
    spring = y + y * y * y / (HARD * HARD)
    rise = (1.0 + 3.0 * y * y / (HARD * HARD)) / compliance
    tension, slope = spring, rise
    for j in range(SHARE.size):
        stiff = SHARE[j] * FIRM[j] / compliance
        force, most = stiff * (x - state[STUCK + j]), SHARE[j] * spring
        if force > most:
            force, stiff = most, SHARE[j] * rise
        elif force < -most:
            force, stiff = -most, -SHARE[j] * rise
        tension += force
        slope += stiff
    return tension, slope


@internal
def series(
    compliance: float, state: FloatArray, k: float, stretch: float
) -> tuple[float, float, float]:
    """Return tension [N], its slope [N/m] and the textile's stretch [m].

    `stretch` is that of the textile and the piece of stiffness `k` [N/m] before it.
    """
    if stretch <= 0.0:
        return 0.0, 0.0, 0.0
    low, high, x = 0.0, stretch, min(max(state[NOW], 0.0), stretch)
    tension = slope = 0.0
    for _ in range(60):
        tension, slope = _pull(compliance, state, x)
        off = tension - k * (stretch - x)
        if abs(off) < 1e-9 * (1.0 + tension):
            break
        if off > 0.0:
            high = x
        else:
            low = x
        x -= off / (slope + k)
        if not low < x < high:
            x = 0.5 * (low + high)
    return tension, k * slope / (k + slope), x


@internal
def slide(compliance: float, state: FloatArray, x: float) -> None:
    """Move the elements that slide at a stretch `x` [m] to their limits."""
    state[NOW] = x
    y = max(x, 0.0) / compliance
    spring = y + y * y * y / (HARD * HARD)
    for j in range(SHARE.size):
        reach = spring * compliance / FIRM[j]  # limit over stiffness
        off = x - state[STUCK + j]
        state[STUCK + j] += off - min(max(off, -reach), reach)
