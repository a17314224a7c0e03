"""Estimators of the thesis, chapter 3, beyond those of `cc_mujoco.estimation`.

from thesis.estimators import StiffnessEstimator
"""

from thesis.estimators._bend_estimator import BendEstimator as BendEstimator
from thesis.estimators._consensus import SensorConsensus as SensorConsensus
from thesis.estimators._observer import CableObserver as CableObserver
from thesis.estimators._sensor_noise import SensorNoise as SensorNoise
from thesis.estimators._sensor_noise import (
    autocovariance_least_squares as autocovariance_least_squares,
)
from thesis.estimators._slope_law import SlopeLaw as SlopeLaw
from thesis.estimators._stiffness import StiffnessEstimator as StiffnessEstimator
from thesis.estimators._unscented import UnscentedEstimator as UnscentedEstimator
