from ._calibration import Calibration as Calibration
from ._calibration import Measurement as Measurement
from ._calibration import calibrate as calibrate
from ._least_squares import Estimate as Estimate
