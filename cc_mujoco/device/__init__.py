"""Devices: a scene and its description, on its MuJoCo model, with values changed.

    from cc_mujoco.device import Device, Plant
    Plant(Device("knee.xml"), {"friction": 0.2, "wearer": 0.5}).model()

`Device` is an MJCF file with what it does not tell (`Description`), `DeviceModel` the
places of its parts on a compiled model, `Plant` a device with values changed, `Drive`
what a controller knows of one axis. `Sensing` is the quality of its sensors. `VALUES`
lists what can be changed, `VARIABLES` which of it a design may set, `IN_EPISODES` which
of it may change from episode to episode of one model, `MATERIALS` the ropes.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
