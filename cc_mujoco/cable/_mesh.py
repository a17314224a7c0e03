"""Places of the segments of a cable: short where its conduit bends, compiled.

    edges = np.empty(n + 1)
    lay_segments(sections, n, edges)         # places of the nodes on the conduit [m]
    segment_wraps(sections, edges, angles)   # wrap angle of every segment [rad]

Friction changes the tension only along bends. Segments of equal length would be wasted
on straight sections, and a tight bend at an end of the conduit, where every reversal
begins, would get too few. Half of the segments follow the length here and half the wrap
angle: with x the place along a conduit of length L and wrap angle W, their density is

    rho(x) = min((1 + kappa(x) L / W) / 2, `MAX_REFINEMENT` times the mean of rho).

Only the shape of the conduit counts. Another friction, or all bends tighter by the same
factor, does not move the nodes, so a fit never does. A conduit of constant curvature
has equal segments.

The upper bound is for the ends. Friction first holds all but half of the outermost
segment, so that half as long a segment makes an end twice as stiff
(`_nodes.end_stiffness`) and reduces the longest stable time step by sqrt(2).
"""

import math

from cc_mujoco.native import FloatArray, FloatMatrix, compiled, internal

MAX_REFINEMENT = 8.0
"""Largest density of segments over the mean density."""
SECTION_SIZE = 4
"""Number of fields of a `Section`."""


@internal
def measure_conduit(sections: FloatMatrix) -> tuple[float, float, bool]:
    """Return length [m], wrap angle [rad], and True if its segments shall be equal."""
    length, wrap, even = 0.0, 0.0, True
    for s in range(sections.shape[0]):
        length += sections[s, 0]
        wrap += sections[s, 0] / sections[s, 1]
        even = even and sections[s, 1] == sections[0, 1]
    return length, wrap, even or not math.isfinite(wrap)


@compiled
def lay_segments(sections: FloatMatrix, n: int, edges: FloatArray) -> None:
    """Set the edges (n + 1,) of the segments of a conduit [m].

    `sections` (m, 4) are those of a `Cable`, proximal to distal.
    """
    length, wrap, even = measure_conduit(sections)
    if even:
        step = length / n
        for j in range(n + 1):
            edges[j] = j * step
        return
    mean, total = 1.0, 0.0
    for _ in range(50):
        total = 0.0
        for s in range(sections.shape[0]):
            density = _segment_density(sections[s, 1], length, wrap, mean)
            total += sections[s, 0] * density
        if total / length > (1.0 - 1e-12) * mean:
            break
        mean = total / length
    j, start, below = 1, 0.0, 0.0
    edges[0], edges[n] = 0.0, length
    for s in range(sections.shape[0]):
        density = _segment_density(sections[s, 1], length, wrap, mean)
        above = below + sections[s, 0] * density
        while j < n and j * total <= n * above:
            edges[j] = start + (j * total / n - below) / density
            j += 1
        start, below = start + sections[s, 0], above
    for i in range(j, n):  # what rounding left over
        edges[i] = length


@internal
def _segment_density(radius: float, length: float, wrap: float, mean: float) -> float:
    """Return rho at a bend radius [m]; `mean` is the mean of rho, see the module."""
    return float(min(0.5 + 0.5 * length / (radius * wrap), MAX_REFINEMENT * mean))


@compiled
def segment_wraps(sections: FloatMatrix, edges: FloatArray, angles: FloatArray) -> None:
    """Set the wrap angle of every segment, the integral of curvature (n,) [rad].

    `sections` (m, 4) are those of a conduit, `edges` (n + 1,) those of the segments on
    it or on another of the same length [m].
    """
    for j in range(angles.size):
        begin, end = edges[j], edges[j + 1]
        angle, start = 0.0, 0.0
        for s in range(sections.shape[0]):
            stop = start + sections[s, 0]
            shared = min(end, stop) - max(begin, start)
            if shared > 0.0:
                angle += shared / sections[s, 1]
            start = stop
        angles[j] = angle


@internal
def share_clearance(
    sections: FloatMatrix, edges: FloatArray, angles: FloatArray, clearance: FloatArray,
    seating: FloatArray,
) -> None:  # fmt: skip
    """Set `clearance_factors` and `seating_factors` of every segment (n,).

    `angles` are those of `segment_wraps`. A segment over several sections has the sum
    of their play and of their compliance at no tension.
    """
    for j in range(angles.size):
        begin, end = edges[j], edges[j + 1]
        whole, play, eased, start = 0.0, 0.0, 0.0, 0.0
        for s in range(sections.shape[0]):
            stop = start + sections[s, 0]
            shared = min(end, stop) - max(begin, start)
            if shared > 0.0:
                # By length where nothing bends yet.
                share = shared / sections[s, 1] if angles[j] > 0.0 else shared
                whole += share
                play += share * sections[s, 2]
                eased += share * sections[s, 2] / sections[s, 3]
            start = stop
        clearance[j] = play / whole if whole > 0.0 else 1.0
        seating[j] = play / eased if eased > 0.0 else 1.0
