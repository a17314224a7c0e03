"""Estimators of the thesis, chapter 3, beyond those of `cc_mujoco.estimation`.

from cc_mujoco.thesis.estimators import StiffnessEstimator
"""

from cc_mujoco.thesis.estimators.bend import BendEstimator
from cc_mujoco.thesis.estimators.consensus import SensorConsensus
from cc_mujoco.thesis.estimators.noise import autocovariance_least_squares
from cc_mujoco.thesis.estimators.observer import CableObserver
from cc_mujoco.thesis.estimators.sensor_noise import SensorNoise
from cc_mujoco.thesis.estimators.slope_law import SlopeLaw
from cc_mujoco.thesis.estimators.stiffness import StiffnessEstimator
from cc_mujoco.thesis.estimators.unscented import UnscentedEstimator

__all__ = [
    "BendEstimator",
    "CableObserver",
    "SensorConsensus",
    "SensorNoise",
    "SlopeLaw",
    "StiffnessEstimator",
    "UnscentedEstimator",
    "autocovariance_least_squares",
]
