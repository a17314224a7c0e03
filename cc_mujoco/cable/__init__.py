"""Physics of cables in conduits: parameters, friction, kernel, pulleys, replay."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
