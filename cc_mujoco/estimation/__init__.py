"""Estimation of a cable's properties while it runs, or from a recording of it.

estimator = FrictionEstimator(cable, sensors, start=0.3)
estimator.update(measured, engine.read(model, data, "flexor").slip)   # in a step
track = estimator.over(measured, directions)                    # of a recording
"""

from cc_mujoco.estimation.calibration import Calibration, Measurement, calibrate
from cc_mujoco.estimation.friction import FrictionEstimator
from cc_mujoco.estimation.fusion import Fused, TensionFusion, fuse
from cc_mujoco.estimation.least_squares import Estimate
from cc_mujoco.estimation.samples import EstimateTrack

__all__ = [
    "Calibration",
    "Estimate",
    "EstimateTrack",
    "FrictionEstimator",
    "Fused",
    "Measurement",
    "TensionFusion",
    "calibrate",
    "fuse",
]
