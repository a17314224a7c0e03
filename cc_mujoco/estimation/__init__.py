"""Estimation of a cable's properties while it runs, or from a recording of it.

estimator = FrictionEstimator(cable, sensors, start=0.3)
estimator.update(measured, engine.read(model, data, "flexor").slip)   # in a step
track = estimator.over(measured, directions)                    # of a recording
"""

from cc_mujoco.estimation.bend import BendEstimator
from cc_mujoco.estimation.calibration import Calibration, Measurement, calibrate
from cc_mujoco.estimation.consensus import SensorConsensus
from cc_mujoco.estimation.friction import FrictionEstimator, SlopeLaw
from cc_mujoco.estimation.fusion import Fused, TensionFusion, fuse
from cc_mujoco.estimation.least_squares import Estimate
from cc_mujoco.estimation.noise import autocovariance_least_squares
from cc_mujoco.estimation.observer import CableObserver
from cc_mujoco.estimation.samples import Track
from cc_mujoco.estimation.sensor_noise import SensorNoise
from cc_mujoco.estimation.stiffness import StiffnessEstimator
from cc_mujoco.estimation.unscented import UnscentedEstimator

__all__ = [
    "BendEstimator",
    "CableObserver",
    "Calibration",
    "Estimate",
    "FrictionEstimator",
    "Fused",
    "Measurement",
    "SensorConsensus",
    "SensorNoise",
    "SlopeLaw",
    "StiffnessEstimator",
    "TensionFusion",
    "Track",
    "UnscentedEstimator",
    "autocovariance_least_squares",
    "calibrate",
    "fuse",
]
