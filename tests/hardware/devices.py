"""Devices of a user, in files of their own, and a rig that is one in simulation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from cc_mujoco.hardware import Readings

KNEE = """<mujoco model="knee">
  <compiler angle="radian"/>
  <option timestep="0.001" integrator="implicitfast"><flag contact="disable"/></option>
  <extension><plugin plugin="cc_mujoco.cable"><instance name="extensor">
    <config key="conduit" value="0.25:0.12 0.35:0.6"/>
    <config key="segments" value="12"/> <config key="axial_stiffness" value="40000"/>
    <config key="pretension" value="8"/> <config key="friction" value="0.12"/>
  </instance></plugin></extension>
  <worldbody>
    <body pos="-0.18 0 1.3"><joint name="drum" axis="0 1 0" armature="2e-3"
        damping="0.02"/> <geom size="0.02" mass="0.2"/></body>
    <site name="clamp" pos="0.09 0 0.65"/>
    <body pos="0 0 0.55"><joint name="knee" axis="0 1 0" range="0 2" damping="0.3"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.045" mass="3.9"/>
      <site name="lever" pos="0.09 0 -0.02"/></body>
  </worldbody>
  <tendon>
    <spatial name="free"><site site="clamp"/><site site="lever"/></spatial>
  </tendon>
  <actuator>
    <motor name="knee_motor" joint="drum" ctrlrange="-15 15"/>
    <general name="human" joint="knee" gainprm="300" biastype="affine"
      biasprm="0 -300 -6"/>
    <plugin plugin="cc_mujoco.cable" instance="extensor" joint="drum" gear="-0.02"/>
    <plugin plugin="cc_mujoco.cable" instance="extensor" tendon="free" gear="1"/>
  </actuator>
</mujoco>
"""
"""A knee that one cable pulls straight by a lever, with names of its own."""

ARM = """<mujoco model="arm">
  <compiler angle="radian"/>
  <option timestep="0.001" integrator="implicitfast"><flag contact="disable"/></option>
  <extension><plugin plugin="cc_mujoco.cable">
    <instance name="biceps"><config key="conduit" value="0.3:0.2 0.4:0.5"/>
      <config key="axial_stiffness" value="20000"/><config key="pretension" value="20"/>
      <config key="friction" value="0.15"/><config key="segments" value="8"/></instance>
    <instance name="deltoid"><config key="conduit" value="0.3:0.2"/>
      <config key="axial_stiffness" value="20000"/><config key="pretension" value="20"/>
      <config key="friction" value="0.1"/><config key="segments" value="8"/></instance>
  </plugin></extension>
  <worldbody>
    <body pos="-0.2 0 1.3"><joint name="drum_a" axis="0 1 0" armature="1e-3"
      damping="0.01"/><geom size="0.02" mass="0.2"/></body>
    <body pos="-0.3 0 1.3"><joint name="drum_b" axis="0 1 0" armature="1e-3"
      damping="0.01"/><geom size="0.02" mass="0.2"/></body>
    <body pos="0 0 1.4"><joint name="shoulder" axis="0 -1 0" range="-1.5 1.5"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.045" mass="2"/>
      <body pos="0 0 -0.31"><joint name="elbow" axis="0 -1 0" range="-0.2 2.4"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.25" size="0.035" mass="1.6"/></body>
    </body>
  </worldbody>
  <actuator>
    <motor name="ma" joint="drum_a" ctrlrange="-5 5"/>
    <motor name="mb" joint="drum_b" ctrlrange="-5 5"/>
    <position name="human_s" joint="shoulder" kp="80" kv="4"/>
    <position name="human_e" joint="elbow" kp="60" kv="2"/>
    <plugin plugin="cc_mujoco.cable" instance="deltoid" joint="drum_a" gear="-0.02"/>
    <plugin plugin="cc_mujoco.cable" instance="deltoid" joint="shoulder" gear="-0.06"/>
    <plugin plugin="cc_mujoco.cable" instance="biceps" joint="drum_b" gear="-0.02"/>
    <plugin plugin="cc_mujoco.cable" instance="biceps" joint="elbow" gear="-0.05"/>
  </actuator>
</mujoco>
"""
"""An arm of two axes, `shoulder` and `elbow`, each with a motor and a cable."""


def written(folder: Path, text: str, name: str = "device.xml") -> Path:
    """Write the scene of a device."""
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


class SimulatedRig:
    """A device in lockstep with a loop: its clock and its rig."""

    def __init__(
        self, scene: Path, axis: str | None = None, noise: float = 0.0
    ) -> None:
        """Begin an episode.

        Args:
            scene: The device.
            axis: That is driven, of a device with several; the others get no torque.
            noise: Standard deviation of angles [rad], a hundredth of that of torques.
        """
        self._noise, self._random = noise, np.random.default_rng(0)
        env: Any = gymnasium.make(
            "cc_mujoco/Device-v1",
            device=scene,
            disable_env_checker=True,
            trajectory="sine",
            task="transparent",
            duration=30.0,
        ).unwrapped
        _, self._info = env.reset(seed=1)
        self._env, self._prefix = env, f"{axis}." if axis else ""
        names = [one.name for one in env.exo.description.axes]
        self._driven = np.array([axis in (None, name) for name in names], float)
        self._time, self._torque = 0.0, 0.0
        self.torques: list[tuple[float, float]] = []
        """Times [s] and true torques at the joint [N m]."""

    def now(self) -> float:
        return self._time

    def wait(self, deadline: float) -> None:
        while self._time < deadline - 1e-9:
            torque = self._torque * self._driven
            given = torque if torque.size > 1 else float(torque[0])
            *_, self._info = self._env.step(self._env.action(given))
            self._time += self._env.drives[0].period
            self.torques.append((self._time, self._column("joint_torque_nm")))

    def read(self) -> Readings:
        sizes = self._noise * np.array([1.0, 100.0, 1.0, 100.0, 100.0])
        errors = (sizes * self._random.normal(size=5)).tolist()
        return Readings(
            self._time,
            self._column("motor_angle_rad") + errors[0],
            self._column("motor_velocity_rad_s") + errors[1],
            self._column("joint_angle_rad") + errors[2],
            self._column("joint_velocity_rad_s") + errors[3],
            self._column("joint_torque_nm") + errors[4],
        )

    def write(self, torque: float) -> None:
        self._torque = torque

    def close(self) -> None:
        self._env.close()

    def _column(self, name: str) -> float:
        return float(self._info[self._prefix + name])
