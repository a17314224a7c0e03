"""Estimators of the thesis, chapter 3, beyond those of `cc_mujoco.estimation`.

from thesis.estimators import StiffnessEstimator
"""

from thesis.estimators._directions import CableObserver as CableObserver
from thesis.estimators._directions import SensorConsensus as SensorConsensus
from thesis.estimators._parameters import BendEstimator as BendEstimator
from thesis.estimators._parameters import SlopeLaw as SlopeLaw
from thesis.estimators._parameters import StiffnessEstimator as StiffnessEstimator
from thesis.estimators._sensor_noise import SensorNoise as SensorNoise
from thesis.estimators._sensor_noise import (
    autocovariance_least_squares as autocovariance_least_squares,
)
from thesis.estimators._unscented import UnscentedEstimator as UnscentedEstimator
