"""A pull-pull cable bench with something hidden in it.

Independent of the package: no line of the model is used here, and the physics is put
differently (massive nodes, bristles, an ordinary differential equation).
"""

from hidden_rig.dataset import make_dataset as make_dataset
from hidden_rig.effects import EFFECTS as EFFECTS
from hidden_rig.effects import NAMED as NAMED
from hidden_rig.effects import UNKNOWN as UNKNOWN
from hidden_rig.nominal import NOMINAL as NOMINAL
from hidden_rig.nominal import Rig as Rig
from hidden_rig.nominal import make_rig as make_rig
from hidden_rig.strength import calibrate as calibrate
from hidden_rig.strength import measure as measure
