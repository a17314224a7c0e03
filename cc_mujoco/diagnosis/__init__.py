"""Diagnosis from measured data: where a simulation disagrees, why, the repair.

from cc_mujoco.diagnosis import diagnose

diagnosis = diagnose("bench.xml", ["data"], "out")
print(diagnosis.verdict, [effect.id for effect in diagnosis.effects])
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
