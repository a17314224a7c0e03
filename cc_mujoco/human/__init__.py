"""The scripted human: motion and impedance of the joint, and the desired feel."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
