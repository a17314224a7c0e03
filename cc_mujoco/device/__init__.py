"""Devices: a MuJoCo scene, its description, the parts of its model, changed values.

    from cc_mujoco.device import Device, Plant
    Plant(Device("knee.xml"), {"friction": 0.2, "wearer": 0.5}).model()

`Device` is an MJCF scene with its `Description`, which holds what MJCF cannot say.
`DeviceModel` has the indices of its parts in a compiled model, `Plant` is a device with
values changed, `Drive` holds what a controller knows of one axis, `Sensing` the quality
of the sensors. `VALUES` lists the values that can be changed, `VARIABLES` those that a
design may set, `IN_EPISODES` those that may change between episodes of one model,
`MATERIALS` the properties of ropes in conduits.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
