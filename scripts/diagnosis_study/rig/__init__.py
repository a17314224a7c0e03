"""A pull-pull cable bench with something hidden in it.

Independent of the package: it shares the compiler and no model, and the physics is put
differently (massive nodes, bristles, an ordinary differential equation).
"""

from rig.dataset import make_dataset as make_dataset
from rig.makes import MAKES as MAKES
from rig.nominal import NOMINAL as NOMINAL
from rig.nominal import Rig as Rig
from rig.nominal import make_rig as make_rig
from rig.strength import calibrate as calibrate
from rig.strength import measure as measure
