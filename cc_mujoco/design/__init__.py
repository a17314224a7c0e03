"""Design studies: many transmissions simulated, measured and ranked.

    from cc_mujoco.design import study
    table = study("wrist", {"friction": "0.05:0.3:10", "loops": [1, 2, 3]})

`cc_mujoco.device.VARIABLES` lists what can be varied, `cc_mujoco.metrics.METRICS` what
is measured.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
