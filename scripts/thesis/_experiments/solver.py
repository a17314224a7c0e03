"""Fig. 2.4: the time that one solution takes, against the number of segments.

Three solvers step the same mass motion, in which every segment slips: `fsolve` on
equations 2.13, started from the solution before; the thesis's enumeration of sign
patterns, the last correct one first; and this package's kernel.
"""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np

from cc_mujoco.cable import replay
from cc_mujoco.cable._segments import Mesh
from thesis._literal_solver import Constraint, by_fsolve, play, sign_patterns, solve
from thesis._outcome import Finding, round_down_ratio
from thesis._rig import PRINTED_CABLE

SEGMENTS = (1, 2, 3, 5, 8, 12, 20, 30, 50, 75, 100)
CABLE = PRINTED_CABLE.replace(static_friction=0.0)
DT = 1e-3


class Costs(NamedTuple):
    """Time of one step [s], and outcomes of the solvers."""

    kernel: float  # of this package
    enumeration: float  # of the thesis's solver
    fsolve: float  # of SciPy's `fsolve`
    apart: float  # largest difference of end tensions, kernel and enumeration, relative


def costs(segments: int, steps: int = 60, general_steps: int = 6) -> Costs:
    """Time the three solvers side by side; the kernel makes 100 times the `steps`."""
    cable = CABLE.replace(segments=segments)
    drag = np.linspace(0.0, 0.2, 500)
    before = play(cable, drag, drag + np.minimum(drag, 0.03))
    at = np.arange(1, 100 * steps + 1) * DT
    proximal = drag[-1] + 0.05 * at
    distal = drag[-1] + 0.03 + 0.05 * at + 0.002 * np.sin(6.0 * at)
    whole = np.concatenate(
        [[drag, drag + np.minimum(drag, 0.03)], [proximal, distal]], 1
    )
    ours = np.inf
    for _ in range(3):
        begin = time.thread_time()
        motion = replay(cable, DT, u_proximal=whole[0], u_distal=whole[1])
        ours = min(ours, (time.thread_time() - begin) / whole.shape[1])
    row = drag.size + steps - 1
    ends = np.array([motion.tension_proximal[row], motion.tension_distal[row]])
    rest = cable.pretension * cable.length / cable.axial_stiffness
    measured = [
        [
            Constraint("displacement", 0, near),
            Constraint("displacement", segments, rest + far),
        ]
        for near, far in zip(proximal[:steps], distal[:steps], strict=True)
    ]

    mesh, patterns = Mesh.of(cable), sign_patterns(segments)
    u = before.displacement[-1]
    begin = time.thread_time()
    for constraints in measured:
        found = solve(mesh, u, constraints, patterns)
        u = found.displacement
    enumeration = (time.thread_time() - begin) / steps
    apart = float(np.max(np.abs(found.tension[[0, -1]] / ends - 1.0)))

    guess = np.concatenate([before.tension[-1], before.displacement[-1]])
    begin = time.thread_time()
    for constraints in measured[:general_steps]:
        guess = by_fsolve(mesh, guess[segments + 1 :], constraints, guess)
    general = (time.thread_time() - begin) / general_steps
    return Costs(ours, enumeration, general, apart)


def run() -> tuple[Finding, ...]:
    costs(2, steps=5, general_steps=2)  # compiles and warms up
    return _findings({n: costs(n) for n in SEGMENTS})


def _findings(found: dict[int, Costs]) -> tuple[Finding, ...]:
    most, fifty = max(found), found[50]
    gain = max(row.fsolve / row.enumeration for row in found.values())
    ours = min(row.enumeration / row.kernel for row in found.values())
    many = [n for n in found if n >= 20]
    by_enumeration, by_kernel = (
        np.polyfit(np.log(many), np.log([getattr(found[n], f) for n in many]), 1)[0]
        for f in ("enumeration", "kernel")
    )
    late = min(n for n, row in found.items() if row.fsolve > 1e-3)
    ratio, admissible = round_down_ratio, len(sign_patterns(5))
    return (
        Finding(
            f"more than {ratio(gain)} times at best; our kernel is more than "
            f"{ratio(ours)} times faster still, {ratio(fifty.fsolve / fifty.kernel)} "
            "times in all at 50 segments",
            "better" if gain > 30.0 and ours > 10.0 else "disagrees",
            timed=True,
        ),
        Finding(
            f"more than {ratio(1e-3 / fifty.enumeration)} steps of the enumeration, "
            f"{ratio(1e-3 / fifty.kernel)} of the kernel",
            "better" if fifty.enumeration < 1e-3 else "disagrees",
            timed=True,
        ),
        Finding(
            f"fsolve takes more than 1 ms from {late} segments on, and more than "
            f"{ratio(found[most].fsolve / found[1].fsolve)} times as long with {most} "
            "as with 1",
            "agrees" if late == 1 else "in part",
            timed=True,
        ),
        Finding(
            f"from 20 segments on enumeration grows as n^{by_enumeration:.1f}, our "
            f"kernel as n^{by_kernel:.1f}",
            "better" if by_kernel < 1.5 else "disagrees",
            timed=True,
        ),
        Finding(
            f"{3**5} and {admissible}", "agrees" if admissible == 16 else "disagrees"
        ),
    )
