"""Native core: decorators and types of functions that are compiled by way of C."""

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.native._functions import compiled as compiled
from cc_mujoco.native._functions import inlined as inlined
from cc_mujoco.native._functions import internal as internal
from cc_mujoco.native._kinds import ByteMatrix as ByteMatrix
from cc_mujoco.native._kinds import FloatCube as FloatCube
from cc_mujoco.native._kinds import FloatMatrix as FloatMatrix
from cc_mujoco.native._kinds import IntMatrix as IntMatrix
from cc_mujoco.native._kinds import interrupted as interrupted

FloatArray = NDArray[np.float64]
"""Array type of compiled functions; one-dimensional and contiguous unless stated."""
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
"""Array types of truth values and of whole numbers, as `FloatArray`."""
