"""The guard of controllers with feedback, compiled: a joint pulled too far is let go.

    memory[RELEASED] = released(memory[RELEASED], measured, rushing, planned, safe)
    if memory[RELEASED] != 0.0:
        torque = damping * -ahead      # the motor follows the joint

A model may be wrong, a sensor may fail, an integral may wind up, and then what was
meant to compensate friction drives the joint instead. The measured torque shows it,
whatever the reason.

A motor that winds up slack is felt too late: when the cable gets taut, the rotor is
stopped within milliseconds by the stiffness k of the cables at the joint, with a torque
of v sqrt(k J) beyond what is measured, at a speed v relative to the joint and an
inertia J of the rotor. So a joint is also let go where that would be unsafe.
"""

from __future__ import annotations

import numpy as np

from cc_mujoco.compiled import compiled, internal

UNLIMITED = 1e9
"""Safe torque of a joint of which none is known [Nm]."""
SETTLING = 0.03
"""Time in which a motor that is let go takes the speed of the joint [s]."""
STEADY = 0.8
"""Greatest damping of a motor over the one at the edge of stability, late as it acts.
"""
_BEGIN, _END = 0.5, 0.25
"""Share of the way from the planned to the safe torque beyond which the joint is let
go, and down to which it stays so."""
_WHOLE = 2.0
"""Such shares of a torque that would only come, over those of a measured one."""


@internal
def _exceeds(torque: float, planned: float, safe: float, share: float) -> bool:
    """Return whether a torque is beyond a share of the way to the safe one."""
    aim = min(max(planned * np.sign(torque), 0.0), safe)
    return bool(abs(torque) > aim + share * (safe - aim))


@compiled
def released(
    before: float, measured: float, rushing: float, planned: float, safe: float
) -> float:
    """Return 1.0 while the motor is to follow the joint, else 0.0.

    Args:
        before: the same, a step earlier.
        measured: torque at the joint [Nm].
        rushing: torque that stopping the rotor would add, see `impact` [Nm].
        planned: torque desired there [Nm].
        safe: most that the cables may put into the joint [Nm].
    """
    share = _BEGIN if before == 0.0 else _END
    if _exceeds(measured, planned, safe, share):
        return 1.0
    return 1.0 if _exceeds(measured + rushing, planned, safe, _WHOLE * share) else 0.0


@compiled
def impact(ahead: float, ratio: float, stiffness: float, inertia: float) -> float:
    """Return the joint torque at which cables stop a motor that runs ahead [Nm].

    Args:
        ahead: velocity of the motor relative to the joint [rad/s].
        ratio: of the drive, see `Drive`.
        stiffness: of all cables at the joint [Nm/rad].
        inertia: of the motor [kg m^2].
    """
    return float(np.sign(ratio) * ahead * np.sqrt(stiffness * inertia))
