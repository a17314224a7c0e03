"""The effects that a diagnosis can name: one entry each.

An entry says what the effect is, where it acts, what its parameters are, and how it
changes a simulation: through the cables (`cables`), or through what the sensors of
motor and joint show (`torques`; `JOINT_DELAY` changes what is played, too). Parameters
at 0 are off, bit for bit. To add an effect, write its entry, and how MuJoCo has it in
`realisation` where it is not in the cable.
"""

from cc_mujoco.diagnosis.effects.cables import CABLES
from cc_mujoco.diagnosis.effects.drive import DRIVE, PLAY, acceleration
from cc_mujoco.diagnosis.effects.effect import (
    ANTAGONIST,
    Effect,
    EffectParameter,
    RigGeometry,
    Torques,
    Values,
)
from cc_mujoco.diagnosis.effects.friction import FRICTION
from cc_mujoco.diagnosis.effects.sensors import GAIN, JOINT_DELAY, SENSORS, delayed

EFFECTS: dict[str, Effect] = {
    effect.id: effect for effect in (*FRICTION, *CABLES, *DRIVE, *SENSORS)
}
"""Every effect of the library by its id."""

__all__ = [
    "ANTAGONIST",
    "EFFECTS",
    "GAIN",
    "JOINT_DELAY",
    "PLAY",
    "Effect",
    "EffectParameter",
    "RigGeometry",
    "Torques",
    "Values",
    "acceleration",
    "delayed",
]
