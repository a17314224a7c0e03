"""Ropes and motors of the ankle exoskeletons of a walking person."""

from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco.cable import Cable
from cc_mujoco.errors import CableError
from cc_mujoco.human._walking_body import DRUM, SCENE
from cc_mujoco.human._walking_policy import WALKING_SIDES
from cc_mujoco.plugin import add_cable

Array = NDArray[np.float64]

TRANSMISSIONS = {
    "cable": "through a conduit",
    "ideal": "without friction, stretch or inertia",
    "none": "not at all: the ropes are unhooked",
}
"""Ways in which the motors pull at the heel levers."""


def walking_model(transmission: str, cable: Cable) -> mujoco.MjModel:
    """Return the scene with the motors, and what joins them to the heel levers."""
    if cable.path != "guided" or cable.bend != "fixed":
        raise CableError(
            "the cable of a walking person is guided and has fixed bends; leave `path` "
            "and `bend` as they are."
        )
    # Fields of a cable that follow from where it lies in the scene
    numbers = {
        field.name: getattr(cable, field.name)
        for field in dataclasses.fields(cable)
        if field.name not in ("conduit", "route", "path", "mouth", "guides")
    }
    spec = mujoco.MjSpec.from_file(str(SCENE))
    for side in WALKING_SIDES:
        if transmission == "cable":
            add_cable(
                spec,
                f"{side}_cable",
                motor=f"{side}_motor",
                joint=f"{side}_ankle",
                drum=DRUM,
                lever=f"{side}_lever",
                route=[f"{side}_conduit_end"],
                conduit=[(one.length, one.radius) for one in cable.conduit],
                **numbers,
            )
            drive = spec.add_actuator(name=f"{side}_drive", target=f"{side}_motor")
            drive.trntype = mujoco.mjtTrn.mjTRN_JOINT
        if transmission == "ideal":
            drive = spec.add_actuator(name=f"{side}_drive", target=f"{side}_rope")
            drive.trntype, drive.gear[0] = mujoco.mjtTrn.mjTRN_TENDON, -1.0
    return spec.compile()


class Ropes:
    """Ropes of both legs and their motors, by the way they are joined.

    Attributes:
        dof: addresses of the motors' velocities (legs,).
    """

    def __init__(self, model: mujoco.MjModel, transmission: str) -> None:
        self._cabled = transmission == "cable"
        self._hooked = transmission != "none"
        self._ropes = np.array([model.tendon(f"{s}_rope").id for s in WALKING_SIDES])
        motors = [model.joint(f"{side}_motor") for side in WALKING_SIDES]
        self._qpos = np.array([joint.qposadr[0] for joint in motors])
        self.dof = np.array([joint.dofadr[0] for joint in motors])
        self._sites = [
            [model.site(f"{side}_{name}").id for side in WALKING_SIDES]
            for name in ("conduit_end", "lever")
        ]
        self._feet = [model.body(f"{side}_foot").id for side in WALKING_SIDES]
        if self._hooked:
            self._drives = [model.actuator(f"{s}_drive").id for s in WALKING_SIDES]
        if self._cabled:
            self._ends = [
                [model.actuator(f"{side}_cable_{end}").id for side in WALKING_SIDES]
                for end in ("proximal", "distal")
            ]
        self._length = model.tendon_length0[self._ropes]

    def start(self, data: mujoco.MjData) -> None:
        """Wind the drums to where the pose leaves the pretension."""
        mujoco.mj_fwdPosition(data.model, data)
        data.qpos[self._qpos] = (self._length - data.ten_length[self._ropes]) / DRUM

    def command(self, data: mujoco.MjData, torque: Array) -> None:
        """Give torques of the motors (2,) [N m]."""
        if self._cabled:
            data.ctrl[self._drives] = torque
        elif self._hooked:
            data.ctrl[self._drives] = np.maximum(torque, 0.0) / DRUM

    def tensions(self, data: mujoco.MjData) -> Array:
        """Return tensions at motors and heels (2, legs) [N]."""
        if self._cabled:
            return np.asarray(np.abs(data.actuator_force[self._ends]))
        if self._hooked:
            return np.tile(data.actuator_force[self._drives], (2, 1))
        return np.zeros((2, 2))

    def motor_power(self, data: mujoco.MjData) -> Array:
        """Return the power of the motors (2,) [W]."""
        if not self._hooked:
            return np.zeros(2)
        force = data.actuator_force[self._drives]
        if self._cabled:
            return np.asarray(force * data.qvel[self.dof])
        return np.asarray(-force * data.ten_velocity[self._ropes])

    def wound(self, data: mujoco.MjData) -> Array:
        """Return the rope on the drums less what the ankles have left (2,) [m]."""
        left = self._length - data.ten_length[self._ropes]
        wound: Array = DRUM * data.qpos[self._qpos] - left
        return wound if self._cabled else np.zeros(2)

    def follow(self, data: mujoco.MjData) -> Array:
        """Return torques of motors that follow with slack ropes (2,) [N m]."""
        if not self._cabled:
            return np.zeros(2)
        spread = data.qvel[self.dof] + data.ten_velocity[self._ropes] / DRUM
        # With 8 N m/rad and 0.3 N m s/rad, and 5 mm of rope that hang.
        return np.asarray(-8.0 * (self.wound(data) + 0.005) / DRUM - 0.3 * spread)

    def arms(self, data: mujoco.MjData) -> Array:
        """Return the lever arms of the ropes at the ankles (2,) [m]."""
        end, lever = (data.site_xpos[sites][:, (0, 2)] for sites in self._sites)
        rope = lever - end
        rope /= np.linalg.norm(rope, axis=1, keepdims=True)
        offset = lever - data.xpos[self._feet][:, (0, 2)]
        arm = rope[:, 1] * offset[:, 0] - rope[:, 0] * offset[:, 1]
        return np.asarray(np.abs(arm))
