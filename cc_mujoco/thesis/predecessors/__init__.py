"""Cable models that came before, and ours, behind one interface.

from cc_mujoco.thesis.predecessors import BristleChain, EndSpring

answer = BristleChain(cable).replay(1e-3, u_proximal, EndSpring(500.0))
"""

from cc_mujoco.thesis.predecessors.bouc_wen import Hysteresis, ModifiedBoucWen
from cc_mujoco.thesis.predecessors.bristle import Bristle, BristleChain, LuGreChain
from cc_mujoco.thesis.predecessors.capstan import StaticCapstan
from cc_mujoco.thesis.predecessors.distributed import Distributed
from cc_mujoco.thesis.predecessors.lumped import LumpedMasses
from cc_mujoco.thesis.predecessors.model import (
    Answer,
    EndSpring,
    Locked,
    Moved,
    PublishedModel,
)
from cc_mujoco.thesis.predecessors.passive import PassiveDistributed

__all__ = [
    "Answer",
    "Bristle",
    "BristleChain",
    "Distributed",
    "EndSpring",
    "Hysteresis",
    "Locked",
    "LuGreChain",
    "LumpedMasses",
    "ModifiedBoucWen",
    "Moved",
    "PassiveDistributed",
    "PublishedModel",
    "StaticCapstan",
]
