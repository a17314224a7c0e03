"""Effects that a plant has and its controller does not know.

    effect_values(find_device("knee.xml"), "seals")
    # {'extensor.seal_proximal': 8.3, 'extensor.seal_distal': 8.3}

Their sizes follow from the description of a device: the torque that counts as 1, the
reach of its motions and the arms of its cables.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import mujoco

from cc_mujoco.cable import PATHS, Cable
from cc_mujoco.device import Axis, Device, DeviceModel, Plant, Value
from cc_mujoco.device._model import motor_lag

LAG = 0.005
"""Time constant of a motor that lags [s], beside that of the scene."""

LAG_NAME = "motor-lag"
"""Name of that effect, which is in the motor and in no cable."""


@dataclass(frozen=True)
class _Scale:
    """Sizes of a cable that effects are scaled with."""

    tension: float
    """Tension of the desired torque that counts as 1 [N]."""
    speed: float
    """Speed of the cable at the velocity of the joint that counts as 1 [m/s]."""
    travel: float
    """Travel of the cable over the reach of named motions [m]."""
    length: float
    """Length of the cable [m]."""

    @classmethod
    def of(cls, axis: Axis, cable: Cable, arm: float) -> _Scale:
        """Return the scale of a cable with an arm at the joint [m]."""
        return cls(
            axis.units["desired_torque_nm"] / arm,
            axis.units["joint_velocity_rad_s"] * arm,
            axis.reach * arm,
            cable.length,
        )


EFFECTS: dict[str, Callable[[_Scale], dict[str, Value]]] = {
    "viscous": lambda own: {
        "viscous_friction": 0.2 * own.tension / (own.speed * own.length)
    },
    "load-independent": lambda own: {
        "load_independent_friction": 0.1 * own.tension / own.length
    },
    "seals": lambda own: {
        "seal_proximal": 0.05 * own.tension,
        "seal_distal": 0.05 * own.tension,
    },
    "presliding": lambda own: {"bristle_length": 0.1 * own.travel},
}
"""Effects in a cable by the name of their condition.

The drag of `viscous` at the velocity that counts as 1 is a fifth of the tension that
counts as 1, that of `load-independent` and of both `seals` a tenth; `presliding` builds
friction up over a tenth of the travel of the cable."""

STRUCTURES = (*EFFECTS, LAG_NAME)
"""Every effect by name."""


@lru_cache(maxsize=64)
def effect_values(device: Device, name: str) -> dict[str, Value]:
    """Return the values of a plant that has an effect.

    Args:
        device: The device.
        name: One of `STRUCTURES`. The values of an effect that no cable can have, and
            of one in the motor, are empty.
    """
    if name not in EFFECTS:
        return {}
    model = DeviceModel(device.description, Plant(device).model())
    found: dict[str, Value] = {}
    for axis, own, drive in zip(
        device.description.axes, model.axes, model.drives(1.0), strict=True
    ):
        for cable_name, cable_drive in zip(own.driven, drive.cables, strict=True):
            cable = device.cables[cable_name]
            if name == "seals" and cable.path == PATHS[1]:
                continue  # nothing seals a cable that no conduit leads
            scale = _Scale.of(axis, cable, abs(cable_drive.distal))
            for key, value in EFFECTS[name](scale).items():
                found[f"{cable_name}.{key}"] = value
    return found


def model_of(plant: Plant, lags: bool) -> mujoco.MjModel:
    """Compile a plant, with motors that lag or without."""
    if not lags:
        return plant.model()
    spec = plant.spec()
    model = spec.copy().compile()
    for axis in plant.description.axes:
        motor = spec.actuator(axis.motor)
        own = motor_lag(model, int(model.actuator(axis.motor).id))
        motor.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
        motor.dynprm[0] = own + LAG
    return spec.compile()
