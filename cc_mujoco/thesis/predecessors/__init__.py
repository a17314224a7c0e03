"""Cable models that came before, and ours, behind one interface.

from cc_mujoco.thesis.predecessors import BristleChain, EndSpring

answer = BristleChain(cable).replay(1e-3, u_proximal, EndSpring(500.0))
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
