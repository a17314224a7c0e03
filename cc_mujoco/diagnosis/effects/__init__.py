"""The effects that a diagnosis can name: one entry each.

An entry says what the effect is, where it acts, what its parameters are, and how it
changes a simulation: through the cables (`cables`), or through what the sensors of
motor and joint show (`torques`; `JOINT_DELAY` changes what is played, too). Parameters
at 0 are off, bit for bit. To add an effect, write its entry, and how MuJoCo has it in
`realisation` where it is not in the cable.
"""

from cc_mujoco.diagnosis.effects._drive_effects import (
    BACKLASH_BOUNDS as BACKLASH_BOUNDS,
)
from cc_mujoco.diagnosis.effects._drive_effects import EXIT_FORMS as EXIT_FORMS
from cc_mujoco.diagnosis.effects._drive_effects import GAIN_BOUNDS as GAIN_BOUNDS
from cc_mujoco.diagnosis.effects._drive_effects import JOINT_DELAY as JOINT_DELAY
from cc_mujoco.diagnosis.effects._drive_effects import acceleration as acceleration
from cc_mujoco.diagnosis.effects._drive_effects import delay_signal as delay_signal
from cc_mujoco.diagnosis.effects._effect import ANTAGONIST as ANTAGONIST
from cc_mujoco.diagnosis.effects._effect import USUAL_CONDITIONS as USUAL_CONDITIONS
from cc_mujoco.diagnosis.effects._effect import WIND_UP_BOUNDS as WIND_UP_BOUNDS
from cc_mujoco.diagnosis.effects._effect import Effect as Effect
from cc_mujoco.diagnosis.effects._effect import EffectError as EffectError
from cc_mujoco.diagnosis.effects._effect import EffectParameter as EffectParameter
from cc_mujoco.diagnosis.effects._effect import RigGeometry as RigGeometry
from cc_mujoco.diagnosis.effects._effect import Signals as Signals
from cc_mujoco.diagnosis.effects._effect import TrialConditions as TrialConditions
from cc_mujoco.diagnosis.effects._effect import Values as Values
from cc_mujoco.diagnosis.effects._effect import dry_friction as dry_friction
from cc_mujoco.diagnosis.effects._effect import follow_with_play as follow_with_play
from cc_mujoco.diagnosis.effects._effect import form_key as form_key
from cc_mujoco.diagnosis.effects._effect_class import Shape as Shape
from cc_mujoco.diagnosis.effects._effect_class import Size as Size
from cc_mujoco.diagnosis.effects._effect_class import effect_of_class as effect_of_class
from cc_mujoco.diagnosis.effects._library import EFFECTS as EFFECTS
from cc_mujoco.diagnosis.effects._library import effects_in_use as effects_in_use
from cc_mujoco.diagnosis.effects._library import usual_effects as usual_effects
from cc_mujoco.diagnosis.effects._rare_effects import (
    CoupledNeighbour as CoupledNeighbour,
)
