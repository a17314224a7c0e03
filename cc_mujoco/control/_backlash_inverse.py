r"""Inverse of the backlash of a cable transmission in closed form.

law = BacklashInverse(env.unwrapped.drive)
"""

from __future__ import annotations

import numpy as np

from cc_mujoco.control import _guard as guard
from cc_mujoco.control import _law_steps as law_steps
from cc_mujoco.control._cable_model import cable_table, joint_spring, joint_stiffness
from cc_mujoco.control._compiled_laws import (
    BAND_SIGMAS,
    INVERSE_GAINS,
    INVERSE_GUARD,
    INVERSE_SIZE,
    InverseGains,
)
from cc_mujoco.control._controller import (
    LawTables,
    SteppedController,
    SteppedLaw,
    total_delay,
)
from cc_mujoco.control._feedback import loop_gains, require_known_motor
from cc_mujoco.device._drive import Drive

_DELAY_SHARE = 0.2
"""Bandwidth of the motor's position, times the delay."""
_MAX_BANDWIDTH = 200.0
"""Most of that bandwidth [rad/s]."""
_INTEGRAL_SHARE = 1.2
"""Bandwidth of the integral over that of the position."""


class BacklashInverse(SteppedController):
    r"""The motor's angle from the inverse of the backlash, with integral feedback.

    Cables that slip as a whole make the desired torque at one angle of the motor for
    either sense of motion (`full_slip_balance`). The sense is that of the wanted angle
    without friction, \(\rho (\theta_j + \tau_d / k)\), and turns when it reverses by
    more than noise; then the wanted angle jumps across the backlash, and the motor
    follows by a position loop with the balance of the cables fed forward. An integral
    of the torque error shifts the angle. As the inverse of a cable transmission after
    T. Do et al., "Hysteresis modeling and position control of tendon-sheath mechanism",
    Mechatronics 24, 2014, for a torque.
    """

    stepped = SteppedLaw(
        law_steps.step_inverse,
        fixed=frozenset({"ratio", "period", "one_way", "inertia"}),
    )

    def __init__(self, drive: Drive) -> None:
        """Prepare for the first episode.

        Args:
            drive: The device; its `cables` and the motor's inertia must be known.

        Raises:
            CableError: They are not known.
        """
        super().__init__(drive)
        require_known_motor(drive)

    def law_tables(self) -> LawTables:
        drive = self.drive
        stiffness, late = joint_stiffness(drive.cables), total_delay(drive)
        bandwidth = min(_DELAY_SHARE / late, _MAX_BANDWIDTH)
        noise = BAND_SIGMAS * drive.torque_noise / stiffness
        gains = InverseGains(
            late,
            drive.inertia * bandwidth**2,
            2.0 * drive.inertia * bandwidth,
            _INTEGRAL_SHARE * bandwidth,
            stiffness,
            # Motion of the joint that is none [rad].
            max(noise, 5e-4),
            loop_gains(drive).settling * stiffness / drive.ratio**2,
        )
        cables, spring = cable_table(drive.cables), joint_spring(drive.cables)
        first = law_steps.OWN_MEMORY + INVERSE_GAINS
        return LawTables(
            cables.shape,
            tuple(np.concatenate([gains, spring, cables.ravel()]).tolist()),
            (first + INVERSE_SIZE,),
            (first + INVERSE_GUARD + guard.COMMAND,),
        )
