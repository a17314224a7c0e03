"""Cable models that came before, and ours, behind one interface.

from thesis.predecessors import BristleChain, EndSpring

answer = BristleChain(cable).replay(1e-3, u_proximal, EndSpring(500.0))
"""

from thesis.predecessors._models import Answer as Answer
from thesis.predecessors._models import Bristle as Bristle
from thesis.predecessors._models import BristleChain as BristleChain
from thesis.predecessors._models import Distributed as Distributed
from thesis.predecessors._models import EndSpring as EndSpring
from thesis.predecessors._models import Hysteresis as Hysteresis
from thesis.predecessors._models import Locked as Locked
from thesis.predecessors._models import LuGreChain as LuGreChain
from thesis.predecessors._models import LumpedMasses as LumpedMasses
from thesis.predecessors._models import ModifiedBoucWen as ModifiedBoucWen
from thesis.predecessors._models import Moved as Moved
from thesis.predecessors._models import PassiveDistributed as PassiveDistributed
from thesis.predecessors._models import PublishedModel as PublishedModel
from thesis.predecessors._models import StaticCapstan as StaticCapstan
