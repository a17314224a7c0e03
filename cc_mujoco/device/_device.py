"""A device in MuJoCo: the places of its parts in the arrays, and their readings.

Everything here works on the arrays of one simulation and, with a leading axis, of many;
both give the same bits, because the arithmetic is elementwise.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco import plugin
from cc_mujoco.assets import scene_path
from cc_mujoco.cable._parameters import KEYS
from cc_mujoco.device import Plant
from cc_mujoco.device._drive import CableDrive, Drive
from cc_mujoco.device._observation import Observed
from cc_mujoco.device._registry import Setup, motor_lag
from cc_mujoco.device._sensors import WINDING_COLUMNS
from cc_mujoco.device._strip_visuals import remaining_cable, route_tendons, strip
from cc_mujoco.errors import CableError
from cc_mujoco.human import Wearer
from cc_mujoco.plugin._config import PLUGIN
from cc_mujoco.plugin._mjcf import instances

from ._moment_arm import Winding, winding_of

Array = NDArray[np.float64]


class Physics(NamedTuple):
    """Arrays of a simulation, or of several with a leading axis."""

    qpos: Array
    qvel: Array
    plugin_state: Array
    actuator_force: Array
    qfrc_actuator: Array
    qfrc_passive: Array
    qfrc_spring: Array
    qfrc_damper: Array
    actuator_length: Array
    actuator_moment: Array

    def apart(self) -> Physics:
        """Return the same, with the results in writable arrays of their own."""
        return self._replace(
            **{name: getattr(self, name).copy() for name in _RESULT_FIELDS}
        )

    def take(self, other: Physics, row: Any = slice(None)) -> None:
        """Write the results of another, for all simulations or one of them."""
        for name in _RESULT_FIELDS:
            getattr(self, name)[row] = getattr(other, name)


class Places(NamedTuple):
    """Indices of motor, joint and wearer in the arrays of a simulation."""

    motor_q: int
    """Index of the motor in `qpos`."""
    motor_v: int
    """Index of its velocity and torques, in `qvel` and `qfrc_actuator`."""
    joint_q: int
    joint_v: int
    motor_out: int
    """Index of the motor in `actuator_force`."""
    wearer_out: int


_RESULT_FIELDS = Physics._fields[3:]
"""Fields that a step leaves behind and no state has."""

VARIED_FIELDS = ("plugin_attr", "actuator_gainprm", "actuator_biasprm")
"""Fields of a model that define what a plant is."""

SPARE_BYTES = 1000
"""Bytes in a model for longer configurations of a cable than that of the scene."""


class Device:
    """The model of a device and the places of its parts."""

    def __init__(
        self, setup: Setup, wearer: Wearer | None, model: mujoco.MjModel | None
    ) -> None:
        """Load the scene.

        Args:
            setup: The device.
            wearer: Impedance of the wearer at the joint; that of the scene by default.
            model: A variant of the scene; the scene by default.
        """
        self.setup = setup
        if model is None:
            model = load(setup)
        self.model = model
        mover = model.actuator(setup.mover)
        self._wearer_actuator = mover
        if wearer is not None:
            _write_wearer(mover, wearer)
        movers = [setup.mover, *setup.companions.values()]
        self.wearers = [_wearer(model, name) for name in movers]
        """Impedances at the joint and at its companions."""
        motor = model.actuator("motor")
        self._motor = int(motor.id)
        self.motor_control = int(model.actuator_ctrladr[motor.id])
        scripted = [model.actuator(name) for name in (*movers, *setup.helpers)]
        self.script_controls = [int(model.actuator_ctrladr[a.id]) for a in scripted]
        """Controls of the wearer and of motors that follow the gait by themselves."""
        self.script_ranges = np.array([a.ctrlrange for a in scripted])
        self.motor_scale = float(motor.ctrlrange[1])
        """Control of the motor at an action of 1."""
        self.torque_limit = float(self.motor_scale * motor.gear[0])
        """Torque of the motor at an action of 1 [N m]."""
        self.motor_gear = float(motor.gear[0])
        turning, joint = model.joint("motor"), model.joint(setup.joint)
        self.places = Places(
            motor_q=int(turning.qposadr[0]),
            motor_v=int(turning.dofadr[0]),
            joint_q=int(joint.qposadr[0]),
            joint_v=int(joint.dofadr[0]),
            motor_out=int(model.actuator_outadr[motor.id]),
            wearer_out=int(model.actuator_outadr[mover.id]),
        )
        self._companion_qpos = [
            int(model.joint(name).qposadr[0]) for name in setup.companions
        ]
        self._readers = [plugin.Reader(model, name) for name in plugin.cables(model)]
        self._ends = [_ends(model, reader.name) for reader in self._readers]
        turned = model.joint("motor").id
        self.driven = tuple(
            reader.name
            for reader in self._readers
            if _winding_joint(model, reader.name) == turned
        )
        """Names of the cables that the motor winds."""
        self.cable_outputs = [place for ends in self._ends for place in ends]
        """Indices of the cables' ends in `actuator_force`: proximal, distal, next."""
        self.winding = winding_of(model, self._ends[0][1], setup.joint)
        """Winding of the first cable's distal end; None on a round pulley."""
        self.cables = plugin.from_mjcf(model)
        """The cables of the model, as it was given."""
        self.ratio = self._ratio()
        """Joint torque per motor torque without friction in the neutral pose [-]."""

    @property
    def joint_range(self) -> tuple[float, float]:
        """Stops of the joint [rad], infinite where it has none."""
        joint = self.model.joint(self.setup.joint)
        if not self.model.jnt_limited[joint.id]:
            return -math.inf, math.inf
        low, high = joint.range
        return float(low), float(high)

    def observed(self, period: float) -> Observed:
        """Return the observation of a device that measures once a period [s]."""
        units = self.setup.units
        return Observed(
            self.setup.scene,
            tuple(units),
            tuple(units.values()),
            self.ratio,
            period,
            self.torque_limit,
        )

    def apply_plant(self, plant: Plant) -> None:
        """Change the model, in place, into that of a plant.

        Raises:
            CableError: If the model has no room for the configuration of a cable.
        """
        self.wearers[0] = plant.wearer
        _write_wearer(self._wearer_actuator, plant.wearer)
        model = self.model
        ends = [*model.plugin_attradr[1:].tolist(), model.plugin_attr.size]
        for name, instance in instances(model).items():
            config = plant.cables[name].to_config()
            text = "".join(f"{config.get(key, '')}\0" for key in KEYS).encode()
            start, end = int(model.plugin_attradr[instance]), ends[instance]
            if len(text) > end - start:
                raise CableError(
                    f"cable {name!r} cannot be varied: the model has no room for its "
                    "configuration; leave `model` out, or give a variant of the scene "
                    f"with {SPARE_BYTES} blanks at the end of `conduit`."
                )
            attributes = model.plugin_attr[start:end]
            attributes[:] = 0
            attributes[: len(text)] = np.frombuffer(text, attributes.dtype)

    def drive(self, period: float) -> Drive:
        """Return the prior knowledge of a controller that is called once a period [s].

        That includes where its tension sensors are, and how good.
        """
        limit = self.torque_limit
        cables, arms = self.cables, self._arms()
        cable_drives = tuple(
            CableDrive(
                cables[reader.name], float(self.model.actuator_gear[end, 0]), arm
            )
            for reader, (end, _), arm in zip(
                self._readers, self._ends, arms, strict=True
            )
            if reader.name in self.driven
        )
        pulls = all(cable.proximal < 0.0 for cable in cable_drives)
        drive = Drive(
            self.ratio,
            -limit,
            limit,
            period,
            pulls,
            (cable_drives,),
            inertia=float(self.model.dof_M0[self.places.motor_v]),
            damping=float(self.model.dof_damping[self.places.motor_v]),
            joint_inertia=float(self.model.dof_M0[self.places.joint_v]),
            motor_lag=motor_lag(self.model, self._motor),
            lever=self.winding is not None,
            safe_torque=self.setup.safe_torque,
            crossed=self.winding.others(self.model) if self.winding else (),
            observed=self.observed(period),
        )
        return self.setup.sensing.equip(drive)

    def start(self, data: mujoco.MjData, angles: Array, commands: Array) -> None:
        """Bring a simulation to the start of an episode: at rest, cables at pretension.

        The motor takes the angle at which the cables are as long as in the neutral
        pose, and the cables are laid where they then are (`plugin.settle`).

        Args:
            data: The simulation; nothing of its past remains.
            angles: Of the joint and its companions [rad].
            commands: Of what follows the script.
        """
        model = self.model
        mujoco.mj_resetData(model, data)
        data.qpos[self.places.joint_q] = angles[0]
        data.qpos[self._companion_qpos] = angles[1:]
        data.ctrl[self.script_controls] = commands
        mujoco.mj_fwdPosition(model, data)
        proximal, distal = self._ends[0]
        payed_out = data.actuator_length[distal] - model.actuator_length0[distal]
        data.qpos[self.places.motor_q] += payed_out / model.actuator_gear[proximal, 0]
        plugin.settle(model, data)

    def read_cables(self, physics: Physics) -> dict[str, Any]:
        """Read the state of the cables, and the pose.

        Args:
            physics: The simulation, or several.

        Returns:
            The columns of an episode log that are states of the cables: numbers (or
            arrays over simulations) and, for the list columns, arrays of their own.
            Angles and velocities are those after the last physics step; torques,
            tensions and slip are those that acted during it.
        """
        columns: dict[str, Any] = {"qpos": physics.qpos.copy()}
        for reader in self._readers:
            columns |= _cable_columns(reader.name, reader.read(physics.plugin_state))
        return columns

    def read_motion(
        self, physics: Physics, winding: Winding | None = None
    ) -> dict[str, Any]:
        """Read angles, velocities and torques of motor, joint and wearer.

        Args:
            physics: The simulation, or several; its `plugin_state` is not read.
            winding: That of each, where several differ.
        """
        qpos, qvel = physics.qpos.T, physics.qvel.T
        force = physics.actuator_force.T
        wearer = force[self.places.wearer_out]
        # Cables on open paths pull by passive forces, added to those of the joints.
        joint, passive = self.places.joint_v, physics.qfrc_passive.T
        own = physics.qfrc_spring.T[joint] + physics.qfrc_damper.T[joint]
        pieces = passive[joint] - own
        angle, velocity = qpos[self.places.joint_q], qvel[joint]
        winding = winding or self.winding
        winding_values = winding and winding.read(physics)
        if winding_values is None:
            winding_values = dict(
                zip(WINDING_COLUMNS, (angle, velocity, 0.0 * angle + 1.0), strict=True)
            )
        return {
            "motor_angle_rad": qpos[self.places.motor_q],
            "motor_velocity_rad_s": qvel[self.places.motor_v],
            "motor_torque_nm": force[self.places.motor_out] * self.motor_gear,
            "joint_angle_rad": angle,
            "joint_velocity_rad_s": velocity,
            **winding_values,
            # The wearer and the cables are all that acts on the joint.
            "joint_torque_nm": physics.qfrc_actuator.T[joint] - wearer + pieces,
            "wearer_torque_nm": wearer,
        }

    def _ratio(self) -> float:
        return self._arms()[0] / float(self.model.actuator_gear[self._ends[0][0], 0])

    def _arms(self) -> list[float]:
        """Return every distal end's moment arm in the neutral pose [m/rad]."""
        data = mujoco.MjData(self.model)
        data.qvel[self.places.joint_v] = 1.0
        mujoco.mj_fwdPosition(self.model, data)
        mujoco.mj_fwdVelocity(self.model, data)
        return [float(data.actuator_velocity[distal]) for _, distal in self._ends]


def load(setup: Setup, drawn: bool = True) -> mujoco.MjModel:
    """Return the scene of a device, with room for other configurations of its cables.

    Args:
        setup: The device.
        drawn: With what is only seen, which takes up to half of the time of a step.
    """
    spec = whole = mujoco.MjSpec.from_file(str(scene_path(setup.scene)))
    if not drawn:
        cables = plugin.from_mjcf(whole)
        spec = strip(whole, route_tendons(cables.values()))
        for name, cable in cables.items():
            plugin.to_mjcf(spec, name, remaining_cable(spec, cable))
    for instance in spec.plugins:
        config = dict(instance.config)
        if instance.plugin_name == PLUGIN:
            # Of the keys, `conduit` is one whose text may end in blanks.
            spare = config["conduit"] + SPARE_BYTES * " "
            instance.config = {**config, "conduit": spare}
    return spec.compile()


def physics_of(data: mujoco.MjData) -> Physics:
    """Return views on the arrays of a simulation."""
    return Physics(*(getattr(data, name) for name in Physics._fields))


def _write_wearer(mover: Any, wearer: Wearer) -> None:
    gains = wearer.gains()
    mover.gainprm[0] = gains.gain
    mover.biasprm[:3] = gains.bias


def _wearer(model: mujoco.MjModel, name: str) -> Wearer:
    actuator = model.actuator(name)
    return Wearer(float(actuator.gainprm[0]), -float(actuator.biasprm[2]))


def _ends(model: mujoco.MjModel, name: str) -> tuple[int, int]:
    """Return the indices of the proximal and the distal end in `actuator_length`."""
    found = np.flatnonzero(model.actuator_plugin == instances(model)[name])
    proximal, distal = (int(model.actuator_outadr[actuator]) for actuator in found)
    return proximal, distal


def _winding_joint(model: mujoco.MjModel, name: str) -> int:
    """Return the index of the joint that winds the proximal end, or -1."""
    found = np.flatnonzero(model.actuator_plugin == instances(model)[name])
    on_joint = model.actuator_trntype[found[0]] == mujoco.mjtTrn.mjTRN_JOINT
    return int(model.actuator_trnid[found[0], 0]) if on_joint else -1


def _cable_columns(name: str, reading: plugin.CableReading) -> dict[str, Any]:
    return {
        f"tension_{name}_proximal_n": reading.tension_proximal,
        f"tension_{name}_distal_n": reading.tension_distal,
        f"moving_{name}_fraction": reading.moving_fraction,
        f"slack_{name}_m": reading.slack,
        f"dissipated_{name}_j": reading.dissipated,
        f"tension_{name}_nodes_n": reading.tension,
        f"slip_{name}_direction": reading.slip,
    }
