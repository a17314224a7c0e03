"""Devices of a user, in files of their own, and a rig that is one in simulation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from play_rig import STATE, Worn

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


class SimulatedDevice:
    """A device in lockstep with a loop: its clock, and the rig of every axis."""

    def __init__(self, scene: str | Path, noise: float = 0.0) -> None:
        """Begin an episode.

        Args:
            scene: The device.
            noise: Standard deviation of angles [rad], a hundredth of that of torques.
        """
        self.worn = Worn(scene)
        self.noise, self.random = noise, np.random.default_rng(0)
        self._time = 0.0
        self._rigs: list[SimulatedRig] = []

    def rig(self, axis: str | None = None) -> SimulatedRig:
        """Return the rig of an axis; those that nobody asks for get no torque."""
        self._rigs.append(SimulatedRig(self, axis or self.worn.names[0]))
        return self._rigs[-1]

    def now(self) -> float:
        return self._time

    def wait(self, deadline: float) -> None:
        while self._time < deadline - 1e-9:
            self.worn.advance({rig.axis: rig.torque for rig in self._rigs})
            self._time += self.worn.period
            for rig in self._rigs:
                rig.torques.append((self._time, rig.column("joint_torque_nm")))


class SimulatedRig:
    """An axis of a device in lockstep with a loop."""

    def __init__(self, device: SimulatedDevice, axis: str) -> None:
        self.axis, self.torque = axis, 0.0
        self._device = device
        self.torques: list[tuple[float, float]] = []
        """Times [s] and true torques at the joint [N m]."""

    def read(self) -> Readings:
        sizes = self._device.noise * np.array([1.0, 100.0, 1.0, 100.0, 100.0])
        errors = (sizes * self._device.random.normal(size=5)).tolist()
        values = [
            self.column(name) + error
            for name, error in zip((*STATE, "joint_torque_nm"), errors, strict=True)
        ]
        return Readings(self._device.now(), *values)

    def write(self, torque: float) -> None:
        self.torque = torque

    def close(self) -> None:
        self.torque = 0.0

    def column(self, name: str) -> float:
        return self._device.worn.column(self.axis, name)
