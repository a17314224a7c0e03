"""Real rigs: their interfaces, and runs with the controllers of this package.

cc-mujoco run --rig rig.toml --controller pi --out runs/first
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
