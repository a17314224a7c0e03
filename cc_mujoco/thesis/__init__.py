"""The experiments of the thesis, chapters 1 to 3, run again.

    cc-mujoco reproduce pretension loops

One module an experiment; each gives figures, their data, and claims: what is printed,
what we find, whether that agrees, and why.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
