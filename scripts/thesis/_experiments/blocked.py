"""Experiment 1: output locked, chopped triangular motor torque (2.4.3).

`pretension` (1a) has four levels, which are not printed; here they spread around the
10 N of Table 2.2. `loops` (1b) lays the conduit in one to three loops. `magnitudes`
holds Table 2.2 against the experiment: with it the 0.125 N m never reach the output.
Less friction alone mends that; less pretension alone does so in part, because one cable
then goes slack and the capstan ratio of the other, e^-1.5, bounds the efficiency.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from cc_mujoco.cable import Cable
from thesis import _rig as rig
from thesis._outcome import Finding, Verdict
from thesis._rig import PEAK_TORQUE, RECONCILED_CABLE, onset_torque

PRETENSIONS = (5.0, 10.0, 15.0, 20.0)  # pretensions [N]
LOOPS = (1, 2, 3)
NOT_PRINTED = Finding("no measured values are printed", "cannot")


def pretension() -> tuple[Finding, ...]:
    rows = [
        rig.blocked_output_test(RECONCILED_CABLE.replace(pretension=tension))
        for tension in PRETENSIONS
    ]
    efficiency = [row.efficiency for row in rows]
    backlash = [row.backlash for row in rows]
    share = np.array(backlash) / np.array(PRETENSIONS)
    ratio = rig.HANDLE_RADIUS / rig.MOTOR_RADIUS
    peaks = ", ".join(f"{np.max(row.joint_torque):.2f}" for row in rows)
    return (
        Finding(
            f"{PRETENSIONS[0]:.0f} to {PRETENSIONS[-1]:.0f} N: loop at the motor "
            f"{backlash[0]:.3f} to {backlash[-1]:.3f} N m wide, efficiency "
            f"{efficiency[0]:.0%} to {efficiency[-1]:.0%}",
            _widens(backlash, efficiency),
            f"loop width grows in proportion, within {np.ptp(share) / share[0]:.0%}; "
            "levels and friction are ours, see `magnitudes`",
        ),
        Finding(
            f"ideal {ratio:.1f}; peak output {peaks} N m of {ratio * PEAK_TORQUE:.2f}",
            "agrees",
        ),
        NOT_PRINTED,
    )


def _widens(backlash: ArrayLike, efficiency: list[float]) -> Verdict:
    falls = all(np.diff(efficiency) < 0.0)
    return "agrees" if falls and all(np.diff(backlash) > 0.0) else "disagrees"


def _laid(loops: float) -> Cable:
    return RECONCILED_CABLE.replace(conduit=rig.conduit_in_loops(loops))


def loops() -> tuple[Finding, ...]:
    rows = [rig.blocked_output_test(_laid(n)) for n in LOOPS]
    efficiency = [row.efficiency for row in rows]
    backlash = np.array([row.backlash for row in rows])
    expected = np.array([2.0 * onset_torque(_laid(n)) for n in LOOPS])
    apart = float(np.max(np.abs(backlash / expected - 1.0)))
    widths = ", ".join(f"{width:.3f}" for width in backlash)
    shares = ", ".join(f"{value:.0%}" for value in efficiency)
    return (
        Finding(
            f"1 to 3 loops: loop at the motor {widths} N m wide, efficiency {shares}",
            _widens(backlash, efficiency),
            f"width within {apart:.0%} of twice the torque at which the first front "
            "arrives; friction is ours, see `magnitudes`",
        ),
        NOT_PRINTED,
        Finding(
            f"R = 0.28 m makes {RECONCILED_CABLE.wrap / (2.0 * np.pi):.2f} loops; one "
            f"loop is R = {rig.conduit_in_loops(1)[0].radius:.3f} m",
            "in part",
        ),
    )


COULOMB = rig.PRINTED_CABLE.replace(static_friction=0.0)
MIN_PLAUSIBLE_EFFICIENCY = 0.2
"""Least efficiency taken for plausible: Fig. 2.8 speaks of output amplified by 5."""


def magnitudes() -> tuple[Finding, ...]:
    """Show that Table 2.2 gives no output at 0.125 N m; vary each parameter alone."""
    needed = onset_torque(COULOMB)
    agonist = COULOMB.pretension * math.expm1(COULOMB.friction * COULOMB.wrap)
    output = np.max(np.abs(rig.blocked_output_test(rig.PRINTED_CABLE).joint_torque))
    varied = {
        "friction": np.geomspace(0.003, 0.21, 15),
        "pretension": np.geomspace(0.05, 10.0, 15),
    }
    found = {}
    for name, values in varied.items():
        cables = [COULOMB.replace(**{name: float(value)}) for value in values]
        found[name] = np.array([rig.blocked_output_test(c).efficiency for c in cables])
    plausible = found["friction"] > MIN_PLAUSIBLE_EFFICIENCY
    most = float(np.max(varied["friction"][plausible]))
    return (
        Finding(
            f"mu_d L/R = {COULOMB.friction * COULOMB.wrap:.2f}: the output feels "
            f"nothing below {needed:.2f} N m; at 0.125 N m its torque changes by "
            f"{output:.1g} N m",
            "disagrees" if needed > PEAK_TORQUE else "agrees",
            f"the tightening cable alone would have to pass {agonist:.0f} N at the "
            f"motor, {agonist * rig.MOTOR_RADIUS:.2f} N m; no pretension gives more "
            f"than {np.max(found['pretension']):.0%} efficiency, mu_d below {most:.2g} "
            f"more than {MIN_PLAUSIBLE_EFFICIENCY:.0%}; experiments 1 to 3 use "
            f"{RECONCILED_CABLE.friction:g}, with which three loops move, too "
            f"({onset_torque(_laid(3)):.2f} N m): ours, not printed",
        ),
        Finding(
            f"k_c must be a force: {COULOMB.axial_stiffness:.0f} N = K L", "misprint"
        ),
    )
