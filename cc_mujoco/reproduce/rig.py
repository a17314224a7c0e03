"""The test bed of the thesis as it is printed: 2.4.1 and Table 2.2.

`PRINTED` is Table 2.2. It cannot have produced Experiment 1 (`magnitudes` shows why),
so the experiments run on `RECONCILED`, which differs from it in friction alone.
"""

from __future__ import annotations

import math

from cc_mujoco.transmission import Cable, Section, Transmission

LENGTH = 2.0
"""Of each conduit [m]."""
STIFFNESS = 2000.0
"""Of a whole cable, K of Table 2.2 [N/m]; EA = K L."""
MOTOR_RADIUS, HANDLE_RADIUS = 0.020, 0.104
"""Of the pulleys [m]."""

PRINTED = Cable(
    axial_stiffness=STIFFNESS * LENGTH,
    pretension=10.0,
    friction=0.21,
    static_friction=0.63,
    conduit=(Section(LENGTH, 0.28),),
)

RECONCILED = PRINTED.replace(friction=0.03, static_friction=0.0)


def loops(number: float) -> tuple[Section]:
    """The conduit laid in this many round loops (2.4.3)."""
    return (Section(LENGTH, LENGTH / (2.0 * math.pi * number)),)


def drive(cable: Cable) -> Transmission:
    """The pull-pull test bed with two such cables (Fig. 2.7)."""
    return Transmission.pull_pull(cable, MOTOR_RADIUS, HANDLE_RADIUS)
