"""Diagnosis from measured data: where a simulation disagrees, why, the repair.

from cc_mujoco.diagnosis import diagnose

diagnosis = diagnose(["data"], "bench.xml", "out")
print(diagnosis.verdict, [effect.id for effect in diagnosis.effects])
"""

from cc_mujoco.diagnosis.diagnose import diagnose
from cc_mujoco.diagnosis.effects import EFFECTS, Effect, EffectParameter
from cc_mujoco.diagnosis.verdict import Diagnosis

__all__ = ["EFFECTS", "Diagnosis", "Effect", "EffectParameter", "diagnose"]
