"""The effects that a diagnosis can name: one entry each.

An entry says what the effect is, where it acts, what its parameters are, and how it
changes a simulation: through the cables (`cables`), or through what the sensors of
motor and joint show (`torques`; `JOINT_DELAY` changes what is played, too). Parameters
at 0 are off, bit for bit. To add an effect, write its entry, and how MuJoCo has it in
`realisation` where it is not in the cable.
"""

from cc_mujoco.diagnosis.effects._drive_effects import (
    BACKLASH_BOUNDS,
    EXIT_FORMS,
    acceleration,
)
from cc_mujoco.diagnosis.effects._effect import (
    ANTAGONIST,
    USUAL_CONDITIONS,
    WIND_UP_BOUNDS,
    Effect,
    EffectError,
    EffectParameter,
    RigGeometry,
    Signals,
    TrialConditions,
    Values,
    dry_friction,
    follow_with_play,
    form_key,
)
from cc_mujoco.diagnosis.effects._effect_class import Shape, Size, effect_of_class
from cc_mujoco.diagnosis.effects._library import EFFECTS, effects_in_use, usual_effects
from cc_mujoco.diagnosis.effects._rare_effects import CoupledNeighbour
from cc_mujoco.diagnosis.effects._sensor_effects import (
    GAIN_BOUNDS,
    JOINT_DELAY,
    delay_signal,
)

__all__ = [
    "ANTAGONIST",
    "BACKLASH_BOUNDS",
    "EFFECTS",
    "EXIT_FORMS",
    "GAIN_BOUNDS",
    "JOINT_DELAY",
    "USUAL_CONDITIONS",
    "WIND_UP_BOUNDS",
    "CoupledNeighbour",
    "Effect",
    "EffectError",
    "EffectParameter",
    "RigGeometry",
    "Shape",
    "Signals",
    "Size",
    "TrialConditions",
    "Values",
    "acceleration",
    "delay_signal",
    "dry_friction",
    "effect_of_class",
    "effects_in_use",
    "follow_with_play",
    "form_key",
    "usual_effects",
]
