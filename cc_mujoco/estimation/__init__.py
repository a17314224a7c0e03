"""Estimation of a cable's friction, tensions and other parameters.

estimator = FrictionEstimator(cable, sensors, start=0.3)        # while it runs,
estimator.update(measured, cc_mujoco.read(model, data, "flexor").slip)   # step by step
track = estimator.over(measured, directions)                    # or from a recording
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
