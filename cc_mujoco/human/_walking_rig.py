"""Ankle exoskeletons of the walking person: drums, motors and cables."""

from __future__ import annotations

from cc_mujoco.cable import Cable, Section
from cc_mujoco.human._profile import Profile

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
PUSH_OFF = Profile(onset=44.0, peak_time=54.0, fall=6.0)
"""Help of 30 N m while the ankle of the person who ships plantarflexes. Help that
begins earlier, while the ankle still yields, does negative work on it; help that lasts
longer acts on a foot in the air."""
