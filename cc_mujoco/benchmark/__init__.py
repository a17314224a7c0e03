"""Benchmark of torque controllers on the devices of this package.

    cc-mujoco benchmark --suite v1 --controllers pi stiction my_module:my_function

Every controller is tested in every condition of a suite (`_suites`) with every seed: a
randomly sampled plant (`_plant`), sensors with noise, bias and delay, and, if the
controller uses a model, wrong parameters of it. A condition and a seed give the same
plant, noise and motion to every controller, so differences are paired
(`rank_controllers`). References (`REFERENCES`) give the errors a scale.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
