"""Bowden-cable transmissions with distributed friction for MuJoCo.

    import cc_mujoco as cc

    plant = cc.Plant("wrist", {"friction": 0.2})
    log = cc.simulate(plant, "pi", trajectory="sine", task="spring", seed=0)
    cc.METRICS["rms_torque_error"].compute(log)

What most programs need is here, imported when it is first used. The subpackages have
the rest: `cable` the physics, `plugin` the MuJoCo plugin, `device`, `human`, `control`,
`simulation` and `metrics` the parts of an episode, `datasets` and `estimation` what is
measured, and `design`, `diagnosis`, `benchmark`, `hardware`, `export` and `viz` what is
done with them.
"""

import lazy_loader

from cc_mujoco._mujoco_import import register_with_gymnasium, register_with_mujoco

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

__version__ = "0.2.0"

# MuJoCo loads models with cables once `cc_mujoco.plugin` is imported.
register_with_mujoco()

# `gymnasium.make` knows the environments.
register_with_gymnasium()
