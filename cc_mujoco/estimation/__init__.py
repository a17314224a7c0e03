"""Estimation of a cable's properties while it runs, or from a recording of it.

estimator = FrictionEstimator(cable, sensors, start=0.3)
estimator.update(measured, cc_mujoco.read(model, data, "flexor").slip)   # in a step
track = estimator.over(measured, directions)                    # of a recording
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
