"""Estimation of a cable's parameters from trials.

trial = Measurement(dt, inputs, outputs, noise)         # what drove it, what it did
found = calibrate([trial], cable_or_transmission, ("friction", "pretension"))
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
