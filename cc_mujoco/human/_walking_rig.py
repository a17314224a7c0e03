"""Ankle exoskeletons of the walking person: drums, motors and cables."""

from __future__ import annotations

from cc_mujoco.cable import Cable, Section

DRUM = 0.025
"""Radius of the drums [m]."""
MOTOR_TORQUE = 15.0
"""Largest torque of a motor, as of the heel's in the scene `bilateral` [N m]."""
CABLE = Cable(
    axial_stiffness=20e3,
    pretension=5.0,
    friction=0.1,
    segments=16,
    conduit=(Section(0.72, 0.45),),
)
"""Rope and conduit of the heel in the scene `bilateral`, at 1.6 rad of wrap."""
