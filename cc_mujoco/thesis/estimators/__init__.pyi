from ._bend_estimator import BendEstimator as BendEstimator
from ._consensus import SensorConsensus as SensorConsensus
from ._noise_covariance import (
    autocovariance_least_squares as autocovariance_least_squares,
)
from ._observer import CableObserver as CableObserver
from ._sensor_noise import SensorNoise as SensorNoise
from ._slope_law import SlopeLaw as SlopeLaw
from ._stiffness import StiffnessEstimator as StiffnessEstimator
from ._unscented import UnscentedEstimator as UnscentedEstimator
