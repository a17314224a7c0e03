"""Cable models that came before, and ours, behind one interface.

from thesis.predecessors import BristleChain, EndSpring

answer = BristleChain(cable).replay(1e-3, u_proximal, EndSpring(500.0))
"""

from thesis.predecessors._bouc_wen import Hysteresis as Hysteresis
from thesis.predecessors._bouc_wen import ModifiedBoucWen as ModifiedBoucWen
from thesis.predecessors._bristle import Bristle as Bristle
from thesis.predecessors._bristle import BristleChain as BristleChain
from thesis.predecessors._bristle import LuGreChain as LuGreChain
from thesis.predecessors._model import Answer as Answer
from thesis.predecessors._model import Distributed as Distributed
from thesis.predecessors._model import EndSpring as EndSpring
from thesis.predecessors._model import Locked as Locked
from thesis.predecessors._model import LumpedMasses as LumpedMasses
from thesis.predecessors._model import Moved as Moved
from thesis.predecessors._model import PassiveDistributed as PassiveDistributed
from thesis.predecessors._model import PublishedModel as PublishedModel
from thesis.predecessors._model import StaticCapstan as StaticCapstan
