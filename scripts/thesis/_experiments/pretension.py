"""Experiment 1a: output locked, chopped triangular motor torque, four pretensions.

The four levels are not printed; here they spread around the 10 N of Table 2.2.
"""

from __future__ import annotations

import numpy as np

from thesis._outcome import Claim, ExperimentOutcome, Panel, Progress
from thesis._rig import (
    HANDLE_RADIUS,
    MOTOR_RADIUS,
    PEAK_TORQUE,
    RECONCILED_CABLE,
    Blocked,
    blocked_loops,
    blocked_output_test,
    chopped_triangle,
)

PRETENSIONS = (5.0, 10.0, 15.0, 20.0)  # pretensions [N]


def run(progress: Progress) -> ExperimentOutcome:
    found: dict[float, Blocked] = {}
    for place, tension in enumerate(PRETENSIONS):
        found[tension] = blocked_output_test(
            RECONCILED_CABLE.replace(pretension=tension)
        )
        progress((place + 1) / len(PRETENSIONS))
    time, _ = chopped_triangle()
    rows = list(found.values())
    efficiency = [row.efficiency for row in rows]
    backlash = [row.backlash for row in rows]
    falls = all(np.diff(efficiency) < 0.0)
    widens = all(np.diff(backlash) > 0.0)
    share = np.array(backlash) / np.array(PRETENSIONS)
    claims = (
        Claim(
            "2.4.3, Fig. 2.9",
            "more pretension: more friction, less efficiency",
            f"{PRETENSIONS[0]:.0f} to {PRETENSIONS[-1]:.0f} N: loop at the motor "
            f"{backlash[0]:.3f} to {backlash[-1]:.3f} N m wide, efficiency "
            f"{efficiency[0]:.0%} to {efficiency[-1]:.0%}",
            "agrees" if falls and widens else "disagrees",
            f"loop width grows in proportion, within {np.ptp(share) / share[0]:.0%}; "
            "levels and friction are ours, see `magnitudes`",
        ),
        Claim(
            "2.4.3, Fig. 2.8",
            "output amplified by the ratio, a factor of around 5",
            f"ideal {HANDLE_RADIUS / MOTOR_RADIUS:.1f}; peak output "
            + ", ".join(f"{np.max(row.joint_torque):.2f}" for row in rows)
            + f" N m of {HANDLE_RADIUS / MOTOR_RADIUS * PEAK_TORQUE:.2f}",
            "agrees",
            "ratio of the radii of Table 2.2; friction takes the rest",
        ),
        Claim(
            "2.4.3",
            "modelled peak output within 0.02 N m of measured",
            "no measured values are printed",
            "cannot",
            "the figure is not in the text",
        ),
    )
    named = {f"pretension {tension:.0f} N": row for tension, row in found.items()}
    shown = time < 12.0
    ideal = HANDLE_RADIUS / MOTOR_RADIUS * rows[0].motor_torque
    panels = [
        Panel(
            "Output locked: torque on the lock", "time [s]", "output torque [N m]",
            {"motor, times the ratio": (time[shown], ideal[shown], "--")}
            | {name: (time[shown], r.joint_torque[shown]) for name, r in named.items()},
        ),
        blocked_loops(named, "Higher pretension, wider loop"),
        Panel(
            "Summary", "pretension [N]", "see the legend",
            {
                "width of the loop at the motor [N m]": (PRETENSIONS, backlash, "o-"),
                "efficiency": (PRETENSIONS, efficiency, "o-"),
            },
        ),
    ]  # fmt: skip
    return ExperimentOutcome(claims, {"pretension": panels})
