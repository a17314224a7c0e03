"""The effects that a diagnosis can name: one entry each.

An entry says what the effect is, where it acts, what its parameters are, and how it
changes a simulation: through the cables (`cables`), or through what the sensors of
motor and joint show (`torques`; `JOINT_DELAY` changes what is played, too). Parameters
at 0 are off, bit for bit. To add an effect, write its entry, and how MuJoCo has it in
`realisation` where it is not in the cable.
"""

from cc_mujoco.diagnosis.effects._cable_effects import CABLE_EFFECTS
from cc_mujoco.diagnosis.effects._drive_effects import (
    BACKLASH_BOUNDS,
    DRIVE_EFFECTS,
    acceleration,
)
from cc_mujoco.diagnosis.effects._effect import (
    ANTAGONIST,
    Effect,
    EffectParameter,
    RigGeometry,
    Torques,
    Values,
)
from cc_mujoco.diagnosis.effects._friction_effects import FRICTION_EFFECTS
from cc_mujoco.diagnosis.effects._sensor_effects import (
    GAIN_BOUNDS,
    JOINT_DELAY,
    SENSOR_EFFECTS,
    delay_signal,
)

EFFECTS: dict[str, Effect] = {
    effect.id: effect
    for effect in (*FRICTION_EFFECTS, *CABLE_EFFECTS, *DRIVE_EFFECTS, *SENSOR_EFFECTS)
}
"""Every effect of the library by its id."""

__all__ = [
    "ANTAGONIST",
    "BACKLASH_BOUNDS",
    "EFFECTS",
    "GAIN_BOUNDS",
    "JOINT_DELAY",
    "Effect",
    "EffectParameter",
    "RigGeometry",
    "Torques",
    "Values",
    "acceleration",
    "delay_signal",
]
