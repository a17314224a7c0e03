"""Section 3.1: why a Kalman filter has nothing to work with.

The thesis looks for the matrix F that carries the state of the cable from one time to
the next, first in its own linear system (3.14), then as a Jacobian of a smoothed one
(3.19, Figs. 3.2 and 3.3). Both are computed here. Friction remembers where the cable
turned and which nodes stick, not how fast it was; while it moves, tension and
displacement follow from the measured ends alone.
"""

from __future__ import annotations

import numpy as np

from cc_mujoco.cable._segments import Mesh
from cc_mujoco.native import FloatArray
from thesis._literal_solver import Constraint, sign_patterns, solve
from thesis._outcome import Finding
from thesis._rig import PRINTED_CABLE

CABLE = PRINTED_CABLE.replace(friction=0.1, static_friction=0.0)
TENSION = 10.0
"""Tension measured at the proximal end, in addition to its displacement [N]."""
SHARPNESSES = (1e2, 1e3, 1e4)  # sharpness k of tanh(k v) in place of sign(v) [s/m]


def transition_matrix(segments: int = 10, step: float = 1e-7) -> FloatArray:
    """Return the change of the solution per change of the displacements before (3.14).

    A cable in mass motion towards the distal end, displacement and tension of the
    proximal end measured: (2n + 2, n + 1), by finite differences of that step [m].
    """
    mesh = Mesh.of(CABLE.replace(segments=segments))
    before = np.linspace(0.0, 0.01, segments + 1)
    ends = [Constraint("displacement", 0, 0.02), Constraint("tension", 0, TENSION)]

    def solution(given: FloatArray) -> FloatArray:
        found = solve(mesh, given, ends, sign_patterns(segments))
        return np.concatenate([found.tension, found.displacement])

    still = solution(before)
    moved = [solution(before + step * row) for row in np.eye(segments + 1)]
    return (np.array(moved) - still).T / step


def jacobian(velocity: FloatArray, sharpness: float, mean: bool) -> FloatArray:
    """Return du_2 now by a displacement before, sign replaced by tanh (3.1.1).

    The first segment of (3.15) with T_1 and u_1 measured: u_2 = u_1 + d (e^(c S) - 1)
    with S = tanh(k v), where v (points,) [m/s] is the mean velocity of both nodes
    (3.16) or that of the first (3.17) over a step of 1 s, and k the sharpness [s/m].
    The derivative is by u_2 before with (3.16), by u_1 with (3.17), found by implicit
    differentiation. With the mean velocity it has poles where the smoothed equation has
    several solutions.
    """
    angle, scale = segment_constants()
    smooth = np.tanh(sharpness * velocity)
    slope = scale * angle * np.exp(angle * smooth) * sharpness * (1.0 - smooth**2)
    return -0.5 * slope / (1.0 - 0.5 * slope) if mean else -slope


def segment_constants() -> tuple[float, float]:
    """Return c_1 [1] and d_1 [m] of (3.15) for one of two segments."""
    mesh = Mesh.of(CABLE.replace(segments=2))
    angle = float(mesh.angle[0])
    return angle, TENSION * float(mesh.length[0]) / mesh.stiffness / angle


def changes_of_motion(noise: float, runs: int = 400, samples: int = 200) -> float:
    """Return the mean number of changes of motion by a threshold on noise (Fig. 3.1).

    The true reading rises from 0 to 1 and falls again, crossing 0.5 twice.
    """
    truth = 1.0 - np.abs(np.linspace(-1.0, 1.0, samples))
    rng = np.random.default_rng(31)
    moving = truth + noise * rng.standard_normal((runs, samples)) > 0.5
    return float(np.mean(np.sum(moving[:, 1:] != moving[:, :-1], axis=1)))


def filter_error(printed: str = "", steps: int = 20_000) -> tuple[float, float]:
    """Return the error variance of a scalar Kalman filter, and its own value (3.9).

    `printed` is "(3.4)" with F^-1 for F^T, "(3.7)" without the inverse of S.
    """
    transition, process, sensor = 0.2, 1.0, 1.0
    rng = np.random.default_rng(37)
    truth = estimate = 0.0
    believed, errors = 1.0, []
    for push, noise in rng.standard_normal((steps, 2)).tolist():
        truth = transition * truth + push
        estimate *= transition
        back = 1.0 / transition if printed == "(3.4)" else transition
        believed = transition * believed * back + process
        total = believed + sensor
        gain = believed * total if printed == "(3.7)" else believed / total
        estimate += gain * (truth + noise - estimate)
        believed = (1.0 - gain) ** 2 * believed + gain**2 * sensor
        errors.append(truth - estimate)
        if not abs(believed) < 1e12:
            return float("inf"), float("inf")
    return float(np.mean(np.square(errors))), believed


def run() -> tuple[Finding, ...]:
    matrix = transition_matrix()
    velocity = np.linspace(-0.05, 0.05, 20_001)
    curves = {
        (k, mean): jacobian(velocity, k, mean)
        for k in SHARPNESSES
        for mean in (True, False)
    }
    outside = max(
        float(np.max(np.abs(curve[np.abs(velocity) > 10.0 / k])))
        for (k, _), curve in curves.items()
        if 10.0 / k < velocity[-1]
    )
    widths = []
    for k in SHARPNESSES:
        size = np.abs(curves[k, True])
        widths.append(k * float(np.max(np.abs(velocity[size >= 0.5 * np.max(size)]))))
    levels = np.linspace(0.0, 0.3, 31)
    counts = np.array([changes_of_motion(level) for level in levels])
    eight = float(np.interp(8.0, counts, levels))
    right, believed = filter_error()
    wrong, believed_wrong = filter_error("(3.4)")
    _, diverged = filter_error("(3.7)")
    angle, scale = segment_constants()
    short = -scale * np.expm1(-angle)
    return (
        Finding(
            f"largest entry of F {np.max(np.abs(matrix)):.1g}, "
            f"{matrix.shape[0]} x {matrix.shape[1]}",
            "agrees" if not np.any(matrix) else "disagrees",
        ),
        Finding(
            f"below {outside:.0e} beyond 10/k; half width {min(widths):.2f}/k to "
            f"{max(widths):.2f}/k for k = 100 to 10 000 s/m",
            "agrees" if outside < 1e-6 else "disagrees",
        ),
        Finding(
            f"8 changes on average at noise of {eight:.1%} of the ramp; "
            f"{counts[-1]:.0f} at {levels[-1]:.0%}",
            "agrees" if 0.0 < eight < 0.2 else "disagrees",
        ),
        Finding(
            f"error variance {wrong:.2f}, believed {believed_wrong:.2f}; with F^T "
            f"{right:.2f} and {believed:.2f}",
            "misprint"
            if abs(believed_wrong - wrong) > 5.0 * abs(believed - right)
            else "agrees",
        ),
        Finding(
            "diverges" if not np.isfinite(diverged) else f"variance {diverged:.2f}",
            "misprint" if not np.isfinite(diverged) else "agrees",
        ),
        Finding(
            f"moving to the proximal end the segment would be {short * 1e3:.1f} mm "
            "shorter than unstrained at 10 N",
            "misprint" if short > 0.0 else "agrees",
        ),
        Finding(
            "(3.21) needs an integral of 2 over the jump of sign; a value of 1 gives 0",
            "misprint",
        ),
    )
