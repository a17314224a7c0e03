"""Experiment 1b: output locked, the conduit laid in one to three loops."""

from __future__ import annotations

import numpy as np

from cc_mujoco.cable import Cable
from thesis._outcome import Claim, ExperimentOutcome, Panel, Progress
from thesis._rig import (
    RECONCILED_CABLE,
    Blocked,
    blocked_loops,
    blocked_output_test,
    conduit_in_loops,
    onset_torque,
)

LOOPS = (1, 2, 3)


def _cable(loops: float) -> Cable:
    return RECONCILED_CABLE.replace(conduit=conduit_in_loops(loops))


def run(progress: Progress) -> ExperimentOutcome:
    found: dict[int, Blocked] = {}
    for number in LOOPS:
        found[number] = blocked_output_test(_cable(number))
        progress(number / (len(LOOPS) + 1))
    rows = list(found.values())
    efficiency = [row.efficiency for row in rows]
    backlash = np.array([row.backlash for row in rows])
    expected = np.array([2.0 * onset_torque(_cable(n)) for n in LOOPS])
    apart = float(np.max(np.abs(backlash / expected - 1.0)))
    claims = (
        Claim(
            "2.4.3, Fig. 2.10",
            "more loops: backlash widens, efficiency falls",
            "1 to 3 loops: loop at the motor "
            + ", ".join(f"{width:.3f}" for width in backlash)
            + " N m wide, efficiency "
            + ", ".join(f"{value:.0%}" for value in efficiency),
            "agrees"
            if all(np.diff(backlash) > 0) and all(np.diff(efficiency) < 0)
            else "disagrees",
            f"width within {apart:.0%} of twice the torque at which the first front "
            "arrives; friction is ours, see `magnitudes`",
        ),
        Claim(
            "2.4.3",
            "modelled peak within 0.03 N m, backlash within 0.02 N m of measured",
            "no measured values are printed",
            "cannot",
            "the figure is not in the text",
        ),
        Claim(
            "Table 2.2, 2.4.4",
            "R = 0.28 m on 2 m; Experiment 2 has one loop",
            f"R = 0.28 m makes {RECONCILED_CABLE.wrap / (2.0 * np.pi):.2f} loops; one "
            f"loop is R = {conduit_in_loops(1)[0].radius:.3f} m",
            "in part",
            "14 % more wrap than one loop; perhaps the leads to the mounts are bent",
        ),
    )
    named = {f"{n} loop{'s' if n > 1 else ''}": row for n, row in found.items()}
    many = np.linspace(0.0, 3.2, 50)[1:]
    widths = [2.0 * onset_torque(_cable(n)) for n in many]
    panels = [
        blocked_loops(named, "Output locked: more loops, wider loop"),
        Panel(
            "Backlash and efficiency against loops", "loops of the conduit",
            "see the legend",
            {
                "width of the loop [N m], from the front's arrival": (many, widths),
                "width of the loop [N m], simulated": (LOOPS, backlash, "o"),
                "efficiency": (LOOPS, efficiency, "s--"),
            },
        ),
    ]  # fmt: skip
    return ExperimentOutcome(claims, {"loops": panels})
