"""Experiment 1a: output locked, chopped triangular motor torque, four pretensions.

The four levels are not printed; here they spread around the 10 N of Table 2.2.
"""

from __future__ import annotations

import numpy as np

from cc_mujoco.report._figures import COLORS, DASH_PATTERN, GREY, figure
from thesis._outcome import Claim, ExperimentOutcome, Progress
from thesis._rig import (
    HANDLE_RADIUS,
    MOTOR_RADIUS,
    PEAK_TORQUE,
    RECONCILED_CABLE,
    Blocked,
    blocked_output_test,
    blocked_table,
    chopped_triangle,
    draw_blocked,
)

PRETENSIONS = (5.0, 10.0, 15.0, 20.0)  # pretensions [N]


def run(progress: Progress) -> ExperimentOutcome:
    """Play the four pretensions."""
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
    drawing = figure(11.0, 4.2)
    series, loop = drawing.subplots(1, 2)
    ratio = HANDLE_RADIUS / MOTOR_RADIUS
    torque = rows[0].motor_torque
    shown = time < 12.0
    series.plot(
        time[shown], ratio * torque[shown], color=GREY, dashes=DASH_PATTERN,
        label="motor, times the ratio",
    )  # fmt: skip
    for (tension, row), color in zip(found.items(), COLORS, strict=False):
        label = f"pretension {tension:.0f} N"
        series.plot(time[shown], row.joint_torque[shown], color=color, label=label)
    series.set(
        title="Output locked: torque on the lock",
        xlabel="time [s]",
        ylabel="output torque [N m]",
    )
    series.legend(ncols=2, loc="upper right")
    series.set_ylim(-0.75, 1.15)
    named = {f"pretension {tension:.0f} N": row for tension, row in found.items()}
    draw_blocked(loop, named, "Higher pretension, wider loop")
    table = blocked_table({f"{tension:.0f}n": row for tension, row in found.items()})
    summary = {
        "pretension_n": np.array(PRETENSIONS),
        "efficiency": np.array(efficiency),
        "backlash_nm": np.array(backlash),
        "friction_work_j": np.array([row.friction_work for row in rows]),
    }
    return ExperimentOutcome(
        claims, {"pretension": drawing}, {"torque": table, "summary": summary}
    )
