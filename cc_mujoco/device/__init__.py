"""Devices: the data that a scene omits, and a device on its MuJoCo model.

    from cc_mujoco.device import Plant
    Plant("wrist", {"friction": 0.2, "wearer": 0.5}).model()

`Setup` describes a device, `Device` is one on a model, `Plant` one with values changed,
`Drive` what a controller knows of it. `Sensing` is the quality of its sensors. `VALUES`
lists what can be changed, `VARIABLES` which of it a design may set, `IN_EPISODES` which
of it may change from episode to episode of one model, `MATERIALS` the ropes.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
