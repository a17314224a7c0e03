"""Cable models that came before, and ours, behind one interface.

from cc_mujoco.predecessors import BristleChain, Spring

answer = BristleChain(cable).replay(1e-3, u_proximal, Spring(500.0))
"""

from cc_mujoco.predecessors.bouc_wen import Hysteresis, ModifiedBoucWen
from cc_mujoco.predecessors.bristle import Bristle, BristleChain, LuGreChain
from cc_mujoco.predecessors.capstan import StaticCapstan
from cc_mujoco.predecessors.distributed import Distributed
from cc_mujoco.predecessors.lumped import LumpedMasses
from cc_mujoco.predecessors.model import Answer, Locked, Model, Moved, Spring
from cc_mujoco.predecessors.passive import PassiveDistributed

__all__ = [
    "Answer",
    "Bristle",
    "BristleChain",
    "Distributed",
    "Hysteresis",
    "Locked",
    "LuGreChain",
    "LumpedMasses",
    "Model",
    "ModifiedBoucWen",
    "Moved",
    "PassiveDistributed",
    "Spring",
    "StaticCapstan",
]
