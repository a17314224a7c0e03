"""Legs of the walking scene in MuJoCo: sensed states, muscles and starting pose."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from cc_mujoco import assets
from cc_mujoco.cable import Cable, Section
from cc_mujoco.human._profile import Profile
from cc_mujoco.human._walking_policy import (
    WALKING_JOINTS,
    WALKING_SIDES,
    Senses,
    WalkingPolicy,
)

DRUM = 0.025  # radius of the drums [m]
MOTOR_TORQUE = 15.0
"""Largest torque of a motor, as of the heel's in the scene `bilateral` [N m]."""
CABLE = Cable(
    axial_stiffness=20e3,
    pretension=5.0,
    friction=0.1,
    segments=16,
    conduit=(Section(0.72, 0.45),),
)
"""Rope and conduit of the heel in the scene `bilateral`, at 1.6 rad of wrap."""
PUSH_OFF = Profile(onset=44.0, peak_time=54.0, fall=6.0)
"""Assistance of 30 N m while the ankle of the supplied policy's person plantarflexes.
Earlier assistance would do negative work on a yielding ankle; later assistance would
act on a foot in the air."""

SCENE, POLICY, LEGS = (
    Path(assets.__file__).resolve().parent / "walking" / name
    for name in ("level_ground.xml", "policy.safetensors", "legs.xml")
)
"""Scene, policy that ships, and the person without ground and muscles."""


class WalkingBody:
    """Indices of joints and muscles (legs, joints) in a compiled model."""

    MAX_PITCH = 0.7  # pitch of a trunk that falls [rad]
    MAX_DROP = 0.25  # change of the hips' height of a person who falls [m]

    def __init__(self, model: mujoco.MjModel) -> None:
        legs = [[f"{side}_{part}" for part in WALKING_JOINTS] for side in WALKING_SIDES]
        parts = ("heel", "ball")
        soles = [f"{side}_{part}" for side in WALKING_SIDES for part in parts]
        joints = [[model.joint(name) for name in leg] for leg in legs]
        self.qpos = np.array([[one.qposadr[0] for one in leg] for leg in joints])
        self.dof = np.array([[one.dofadr[0] for one in leg] for leg in joints])
        self.muscles = np.array([[model.actuator(n).id for n in leg] for leg in legs])
        self._soles = [model.geom(name).id for name in soles]
        self.heels = np.array(self._soles[::2])  # geoms (legs,)
        self._loads = np.array([model.sensor(f"{one}_load").adr[0] for one in soles])
        trunk = [model.joint(name) for name in ("forward", "height", "pitch")]
        self._forward, self._height, self._pitch = (int(j.qposadr[0]) for j in trunk)
        self.weight = float(model.body_mass.sum()) * 9.81  # [N]

    def set_muscles(self, model: mujoco.MjModel, policy: WalkingPolicy) -> None:
        model.actuator_biasprm[self.muscles, 1] = -policy.stiffness
        model.actuator_biasprm[self.muscles, 2] = -policy.damping

    def start(self, data: mujoco.MjData, policy: WalkingPolicy, step: float) -> None:
        """Reset to the gait at `step`: right heel strikes at 0, left heel at 1."""
        model = data.model
        mujoco.mj_resetData(model, data)
        phase = np.array([0.5 * step, 0.5 + 0.5 * step])
        angles, rates, _ = policy.desired(phase)
        data.qpos[self.qpos], data.qvel[self.dof] = angles, rates
        data.qvel[self._forward] = policy.speed
        data.qpos[self._pitch] = policy.trunk_pitch
        mujoco.mj_kinematics(model, data)
        soles = data.geom_xpos[self._soles, 2] - model.geom_size[self._soles, 0]
        data.qpos[self._height] -= soles.min()

    def senses(self, each: Sequence[mujoco.MjData]) -> Senses:
        qpos = np.array([data.qpos for data in each])
        qvel = np.array([data.qvel for data in each])
        loads = np.array([data.sensordata[self._loads] for data in each])
        pitch = qpos[:, self._pitch], qvel[:, self._pitch]
        load = loads.reshape(len(each), 2, 2).sum(axis=2) / self.weight
        return Senses(qpos[:, self.qpos], *pitch, qvel[:, self._forward], load)

    def has_fallen(self, data: mujoco.MjData) -> bool:
        drop, pitch = data.qpos[self._height], data.qpos[self._pitch]
        return not (abs(drop) < self.MAX_DROP and abs(pitch) < self.MAX_PITCH)

    def position(self, data: mujoco.MjData) -> float:
        return float(data.qpos[self._forward])


def metabolic_energy(positive: Any, negative: Any) -> Any:
    """Return the metabolic energy of muscle work [J], or power [W], elementwise.

    It is positive / 0.25 - negative / 1.2, with the efficiencies of R. Margaria,
    "Positive and negative work performances and their efficiencies in human
    locomotion", Int. Z. angew. Physiol. 25, 1968; `negative` is at most 0. It leaves
    out antagonists that work against each other, and the cost of holding a force.
    """
    return positive / 0.25 - negative / 1.2
