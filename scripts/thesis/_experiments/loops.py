"""Experiment 1b: output locked, the conduit laid in one to three loops."""

from __future__ import annotations

import numpy as np

from cc_mujoco.cable import Cable
from cc_mujoco.report._figures import GREEN, GREY, ORANGE, figure, set_ticks
from thesis._outcome import Claim, ExperimentOutcome, Progress
from thesis._rig import (
    RECONCILED_CABLE,
    Blocked,
    blocked_output_test,
    blocked_table,
    conduit_in_loops,
    draw_blocked,
    onset_torque,
)

LOOPS = (1, 2, 3)


def _cable(loops: float) -> Cable:
    return RECONCILED_CABLE.replace(conduit=conduit_in_loops(loops))


def run(progress: Progress) -> ExperimentOutcome:
    """Play one to three loops at constant pretension."""
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
    drawing = figure(11.0, 4.2)
    loop, chart = drawing.subplots(1, 2)
    named = {f"{n} loop{'s' if n > 1 else ''}": row for n, row in found.items()}
    draw_blocked(loop, named, "Output locked: more loops, wider loop", "ideal")
    many = np.linspace(0.0, 3.2, 50)[1:]
    curve = [2.0 * onset_torque(_cable(n)) for n in many]
    chart.plot(many, curve, color=GREY, label="width, from the arrival of the front")
    chart.plot(LOOPS, backlash, "o", color=ORANGE, label="width, simulated")
    chart.set(
        title="Backlash and efficiency against loops",
        xlabel="loops of the conduit",
        ylabel="width of the loop at the motor [N m]",
        ylim=(0.0, 0.3),
    )
    set_ticks(chart.xaxis, LOOPS)
    right = chart.twinx()
    right.plot(LOOPS, 100.0 * np.array(efficiency), "s--", color=GREEN)
    right.set(ylabel="efficiency [%]  (green squares)", ylim=(0.0, 100.0))
    right.grid(False)
    chart.legend(loc="upper left")
    table = blocked_table({str(number): row for number, row in found.items()})
    summary = {
        "loops": np.array(LOOPS),
        "efficiency": np.array(efficiency),
        "backlash_nm": backlash,
        "expected_backlash_nm": expected,
    }
    return ExperimentOutcome(
        claims, {"loops": drawing}, {"torque": table, "summary": summary}
    )
