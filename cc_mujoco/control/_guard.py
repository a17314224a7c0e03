"""Guard of controllers with feedback, compiled: it releases a joint pulled too far.

    released = release_state(released, measured, rushing, planned, safe)
    if released != 0.0:
        torque = damping * -ahead      # the motor follows the joint

A model may be wrong, a sensor may fail, an integral may wind up. Then the compensation
of friction drives the joint instead. The measured torque shows it, for any cause.

A motor that winds up slack is detected too late: when the cable gets taut, the
stiffness k of the cables at the joint stops the rotor within milliseconds, with a
torque of v sqrt(k J) beyond the measured one, at a speed v relative to the joint and an
inertia J of the rotor. So a joint is also released if that would be unsafe.
"""

from __future__ import annotations

import numpy as np

from cc_mujoco._utils.compilation import compiled, internal

NO_TORQUE_LIMIT = 1e9
"""Safe torque of a joint of which none is known [N m]."""
RELEASE_TIME = 0.03
"""Time in which a motor that is let go takes the speed of the joint [s]."""
MAX_DAMPING_SHARE = 0.8
"""Greatest damping of a motor over the one at the edge of stability, late as it acts.
"""
_RELEASE_SHARE, _RECOVERY_SHARE = 0.5, 0.25
"""Share of the way from the planned to the safe torque beyond which the joint is let
go, and down to which it stays so."""
_PREDICTED_FACTOR = 2.0
"""Such shares of a torque that would only come, over those of a measured one."""


@internal
def _exceeds(torque: float, planned: float, safe: float, share: float) -> bool:
    """Return whether a torque is beyond a share of the way to the safe one."""
    aim = min(max(planned * np.sign(torque), 0.0), safe)
    return bool(abs(torque) > aim + share * (safe - aim))


@compiled
def release_state(
    before: float, measured: float, rushing: float, planned: float, safe: float
) -> float:
    """Return 1.0 while the motor is to follow the joint, else 0.0.

    Args:
        before: the same, a step earlier.
        measured: torque at the joint [N m].
        rushing: torque that stopping the rotor would add, see `impact_torque` [N m].
        planned: torque desired there [N m].
        safe: most that the cables may put into the joint [N m].
    """
    share = _RELEASE_SHARE if before == 0.0 else _RECOVERY_SHARE
    if _exceeds(measured, planned, safe, share):
        return 1.0
    return (
        1.0
        if _exceeds(measured + rushing, planned, safe, _PREDICTED_FACTOR * share)
        else 0.0
    )


@compiled
def impact_torque(
    ahead: float, ratio: float, stiffness: float, inertia: float
) -> float:
    """Return the joint torque at which cables stop a motor that runs ahead [N m].

    Args:
        ahead: velocity of the motor relative to the joint [rad/s].
        ratio: of the drive, see `Drive`.
        stiffness: of all cables at the joint [N m/rad].
        inertia: of the motor [kg m^2].
    """
    return float(np.sign(ratio) * ahead * np.sqrt(stiffness * inertia))
