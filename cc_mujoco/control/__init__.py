"""Torque controllers: from the measurements of a device to the torque of its motor."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
