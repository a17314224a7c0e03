"""Benchmark of torque controllers on the devices of this package.

    cc-mujoco benchmark --suite v1 --controllers pi stiction my_module:my_function

Every controller is tested in every condition of a suite (`_suites`) with every seed: a
sampled plant (`_plant`), sensors with noise, bias and delay, and, if it has a model, a
wrong one. A condition and a seed are the same plant, noise and motion for every
controller, so that controllers are compared in pairs (`rank_controllers`). References
give the numbers a scale (`REFERENCES`).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
