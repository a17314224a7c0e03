"""Estimators of the thesis, chapter 3, beyond those of `cc_mujoco.estimation`.

from cc_mujoco.thesis.estimators import StiffnessEstimator
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
