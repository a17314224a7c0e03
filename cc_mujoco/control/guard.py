"""The guard of controllers with a model, compiled: a joint pulled too far is let go.

    memory[RELEASED] = released(memory[RELEASED], measured, planned, safe)
    if memory[RELEASED] != 0.0:
        torque = damping * -ahead      # the motor follows the joint

A model may be wrong, a sensor may fail, and then what was meant to compensate friction
drives the joint instead. The measured torque shows it, whatever the reason.
"""

from __future__ import annotations

import numpy as np

from cc_mujoco.compiled import compiled

UNLIMITED = 1e9
"""Safe torque of a joint of which none is known [Nm]."""
_BEGIN, _END = 0.5, 0.25
"""Share of the way from the planned to the safe torque beyond which the joint is let
go, and down to which it stays so."""


@compiled
def released(before: float, measured: float, planned: float, safe: float) -> float:
    """Return 1.0 while the motor is to follow the joint, else 0.0.

    Args:
        before: the same, a step earlier.
        measured: torque at the joint [Nm].
        planned: torque desired there [Nm].
        safe: most that the cables may put into the joint [Nm].
    """
    aim = min(max(planned * np.sign(measured), 0.0), safe)
    share = _BEGIN if before == 0.0 else _END
    return 1.0 if abs(measured) > aim + share * (safe - aim) else 0.0
