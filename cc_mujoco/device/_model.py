"""A device on a MuJoCo model: the indices of its parts in the arrays, and readings.

Readings take the arrays of one simulation or, with a leading axis, of several. Both
give the same bits, because the arithmetic is elementwise.
"""

from __future__ import annotations

import copy
import itertools
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco import plugin
from cc_mujoco.cable._cable import PATHS, Cable
from cc_mujoco.device import Plant
from cc_mujoco.device._axis_record import AXIS, Physics
from cc_mujoco.device._description import Axis, Description
from cc_mujoco.device._device import Device, frame_skip
from cc_mujoco.device._drive import CableDrive, Drive
from cc_mujoco.device._moment_arm import (
    TabledWinding,
    Winding,
    neutral_moments,
    open_winding,
    winding_of,
)
from cc_mujoco.device._mover import FILTERS, MotorLimits, Mover
from cc_mujoco.device._observation import Observed
from cc_mujoco.device._sensors import WINDING_COLUMNS, Sensing
from cc_mujoco.errors import CableError
from cc_mujoco.human import Wearer
from cc_mujoco.plugin._mjcf import instances, make_room, write_cable

Array = NDArray[np.float64]


class Places(NamedTuple):
    """Indices of motor, joint and wearer in MuJoCo's arrays."""

    motor_q: int  # in `qpos`
    motor_v: int  # of velocity and torques, in `qvel` and `qfrc_actuator`
    joint_q: int
    joint_v: int
    motor_out: int  # in `actuator_force`
    wearer_out: int  # in it, too; -1 where the body is moved otherwise


class AxisModel:
    """One axis of a device: its indices and constants in a compiled model."""

    def __init__(
        self,
        description: Description,
        axis: Axis,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        ends: Mapping[str, tuple[int, int]],
        mover: Mover | None,
    ) -> None:
        self.axis, self.model = axis, model
        motor = model.actuator(axis.motor)
        self._motor = int(motor.id)
        self.motor_control = int(model.actuator_ctrladr[motor.id])
        own_ends = {name: ends[name] for name in axis.cables}
        turning, joint = model.joint(axis.drum), model.joint(axis.joint)
        self.places = Places(
            motor_q=int(turning.qposadr[0]),
            motor_v=int(turning.dofadr[0]),
            joint_q=int(joint.qposadr[0]),
            joint_v=int(joint.dofadr[0]),
            motor_out=int(model.actuator_outadr[motor.id]),
            wearer_out=-1 if mover is None else mover.out,
        )
        arms = neutral_moments(model, data)
        self._proximal, self._distal = (
            {name: float(arms[pair[side], dof]) for name, pair in own_ends.items()}
            for side, dof in enumerate((self.places.motor_v, self.places.joint_v))
        )
        winds = all(arm > 0.0 for arm in self._proximal.values())
        self.sense = -1.0 if winds else 1.0
        """Sign of the motor's angle in the columns; positive angles wind cables that
        only pull."""
        self.motor_gear = self.sense * float(motor.gear[0])
        """Torque of the motor, as in the columns, per its force [N m/N or 1]."""
        limits = MotorLimits.of(model, self._motor)
        self.torque_limit = limits.torque
        """Torque of the motor at an action of 1 [N m]."""
        self.motor_scale = self.sense * limits.control
        """Control of the motor at an action of 1."""
        low, high = sorted(self.sense * end for end in limits.torques)
        self._torques = low, high
        self.driven = tuple(name for name in axis.cables if self._distal[name])
        """Names of the cables from the motor to the joint."""
        name = self.driven[0]
        self.first = own_ends[name]
        """Both ends of the first cable of the joint, in `actuator_force`."""
        self.proximal_arm = self._proximal[name]
        """Displacement of its proximal end per motor angle of the model [m/rad]."""
        cable = plugin.from_mjcf(model)[name]
        self.winding: Winding | TabledWinding | None
        """Winding of the first cable's distal end (of its open part if it leaves its
        conduit); None on a round pulley."""
        # No controller knows a cable of which other joints wind an open part.
        self._unknown = False
        if cable.path == PATHS[2]:  # it leaves its conduit
            tendon, mouth = model.tendon(cable.route).id, model.site(cable.mouth).id
            self.winding = open_winding(model, int(tendon), int(mouth), axis.joint)
            self._unknown = self.winding is None
        else:
            self.winding = winding_of(model, data, self.first[1], axis.joint)
        self.shared_ratios: dict[str, float] = {}
        """Ratio at every joint of another axis that the cable turns [-]."""
        if isinstance(self.winding, Winding):
            motor_arm = self.sense * self.proximal_arm
            joints = {other.joint for other in description.axes}
            self.winding = self.winding.sharing(model, joints, motor_arm)
            for other in filter(joints.__contains__, self.winding.others(model)):
                arm = float(arms[self.first[1], model.joint(other).dofadr[0]])
                self.shared_ratios[other] = arm / motor_arm
        self.ratio = self._distal[name] / (self.sense * self.proximal_arm)
        """Joint torque per motor torque without friction in the neutral pose [-]."""
        self._mover = mover
        rivals = [ends[name][1] for name in description.rivals(axis)]
        self._others = _other_torques(model, data, self.places, mover, rivals)
        medium = model.opt.density or model.opt.viscosity
        self._weightless = bool(np.any(model.body_gravcomp) or medium)

    def paid_out(self, data: mujoco.MjData) -> float:
        """Return the first cable's length pulled out at the joint, 0 in neutral [m]."""
        if isinstance(self.winding, TabledWinding):
            wound = self.winding.read(physics_of(data))[WINDING_COLUMNS[0]]
            return float(wound) * self._distal[self.driven[0]]
        distal = self.first[1]
        return float(data.actuator_length[distal] - self.model.actuator_length0[distal])

    def describe_pull(self, cable: str) -> str:
        """Return words for the senses in which a cable is wound and turns the joint."""
        winds = "positive" if self._proximal[cable] < 0.0 else "negative"
        turns = "positive" if self._distal[cable] < 0.0 else "negative"
        return (
            f"cable {cable} is wound as {self.axis.drum} turns in the {winds} sense, "
            f"and pulls {self.axis.joint} towards {turns} angles"
        )

    @property
    def plain(self) -> bool:
        """True if only cables and a wearer's actuator of gear 1 act on the joint."""
        direct = self._mover is not None and self._mover.gear == 1.0
        open_path = isinstance(self.winding, TabledWinding)
        more = self.axis.cuff or open_path or self._others or self._weightless
        return direct and self.sense == 1.0 and not more

    def observed(self, device: str, period: float) -> Observed:
        """Return the observation of the axis, sampled every `period` [s]."""
        columns, units = tuple(self.axis.units), tuple(self.axis.units.values())
        return Observed(device, columns, units, self.ratio, period, self.torque_limit)

    def drive(self, cables: Mapping[str, Any], device: str, period: float) -> Drive:
        """Return the axis as its controller knows it, without sensors."""
        model, places = self.model, self.places
        wound = {name: self.sense * self._proximal[name] for name in self.driven}
        named = {} if self._unknown else wound
        known = (
            CableDrive(cables[n], arm, self._distal[n]) for n, arm in named.items()
        )
        pulls = all(arm < 0.0 for arm in wound.values())
        lags = int(model.actuator_dyntype[self._motor]) in FILTERS
        return Drive(
            self.ratio,
            *self._torques,
            period,
            pulls,
            tuple(known),
            inertia=float(model.dof_M0[places.motor_v]),
            damping=float(model.dof_damping[places.motor_v]),
            joint_inertia=float(model.dof_M0[places.joint_v]),
            motor_lag=float(model.actuator_dynprm[self._motor, 0]) if lags else 0.0,
            lever=self.winding is not None,
            safe_torque=self.axis.safe_torque,
            safe_speed=self.axis.safe_speed,
            safe_power=self.axis.safe_power,
            crossed=self.crossed,
            joint=self.axis.joint,
            shared_ratios=self.shared_ratios,
            joint_neutral=float(model.qpos0[places.joint_q]),
            observed=self.observed(device, period),
        )

    @property
    def crossed(self) -> tuple[str, ...]:
        """Joints besides the driven one that move the cables' distal ends."""
        return self.winding.others(self.model) if self.winding else ()

    @property
    def ratio_columns(self) -> tuple[str, ...]:
        """`RATIO_COLUMN` of each joint of another axis that the cables turn."""
        shared = self.winding.shared if isinstance(self.winding, Winding) else ()
        return tuple(name for name, *_ in shared)

    def record(self, hold: Callable[[NDArray[Any]], int]) -> NDArray[Any]:
        """Return the record (1,) of dtype `AXIS` that describes the axis to C code.

        `hold` keeps an array alive as long as the record, and returns its address.
        """
        mover, places = self._mover, self.places
        outs = [out for out, _, _ in self._others]
        arms = [place for _, _, place in self._others]
        same = ("motor_control", "sense", "motor_gear", "motor_scale", "torque_limit")
        found = places._asdict() | {name: getattr(self, name) for name in same}
        found |= {
            "cuffed": self.axis.cuff is not None,
            "weightless": self._weightless,
            "others": len(outs),
            "other_outs": hold(np.array([*outs, *arms], np.int64)),
            "other_arms": hold(np.array([gear for _, gear, _ in self._others])),
            "wearer_gear": 1.0 if mover is None else mover.gear,
        }
        if self.winding is not None:
            found |= self.winding.record(hold)
        record = np.zeros(1, AXIS)
        for name, value in found.items():
            record[name] = value
        return record


class DeviceModel:
    """Compiled model of a device, with the indices of its parts."""

    def __init__(
        self,
        description: Description,
        model: mujoco.MjModel,
        wearer: Wearer | Mapping[str, Wearer] | None = None,
        data: mujoco.MjData | None = None,
    ) -> None:
        """Find the parts of a device in a compiled model of its scene, or of a variant.

        `wearer` is the impedance of the wearer at the only driven joint, or a
        dictionary by joint; by default it is that of the model. `data` are overwritten;
        they may be of a model of equal layout, and spare the time to make new ones.

        Raises:
            CableError: One wearer is given for several joints, the wearer does not move
                a named joint, `model` is no MuJoCo model or lacks a part.
        """
        if not isinstance(model, mujoco.MjModel):
            raise CableError(f"model must be a mujoco.MjModel, not {model!r}.")
        self.description, self.model = description, model
        _require_parts(description, model)
        self.frame_skip = frame_skip(description, float(model.opt.timestep))
        """Physics steps between two calls of a controller."""
        self.movers = {
            joint: Mover.of(model, name) for joint, name in description.movers.items()
        }
        """Wearer at every joint that it moves."""
        if isinstance(wearer, Wearer):
            wearer = {description.axis().limb: wearer}
        for joint, impedance in (wearer or {}).items():
            if joint not in self.movers:
                raise CableError(
                    f"device {description.scene!r} has no wearer at joint {joint!r}, "
                    "whose impedance could be set."
                )
            self._write_wearer(joint, impedance)
        data = data or mujoco.MjData(model)
        self._readers = [plugin.Reader(model, name) for name in plugin.cables(model)]
        ends = {reader.name: _ends(model, reader.name) for reader in self._readers}
        self.axes = tuple(
            AxisModel(description, axis, model, data, ends, self.movers.get(axis.limb))
            for axis in description.axes
        )
        """The axes, in the order of the description."""
        self.prefixes = description.prefixes
        """Beginnings of the columns of each axis."""
        self.motor_controls = [axis.motor_control for axis in self.axes]
        self.motor_scales = np.array([axis.motor_scale for axis in self.axes])
        """Controls of the motors at an action of 1."""
        self.torque_limits = np.array([axis.torque_limit for axis in self.axes])
        """Torques of the motors at an action of 1 [N m]."""
        self.script_controls = [mover.control for mover in self.movers.values()]
        """Controls of the wearer."""
        self.cable_outputs = [place for pair in ends.values() for place in pair]
        """Indices of the cables' ends in `actuator_force`: proximal, distal, next."""
        self.cables = plugin.from_mjcf(model)
        """The cables of the model, as it was given."""
        self.written: dict[str, Cable] = {}
        """Cables to write into the model first, see `with_cables`."""

    @property
    def wearers(self) -> dict[str, Wearer]:
        """Impedance of the wearer at each joint that the wearer moves, by joint."""
        return {joint: mover.wearer for joint, mover in self.movers.items()}

    @property
    def driven(self) -> tuple[tuple[str, ...], ...]:
        """For each axis, the cables that run from its motor to its joint."""
        return tuple(axis.driven for axis in self.axes)

    def neutral(self, joint: str) -> float:
        """Return the angle of a joint in the pose `qpos0` [rad]."""
        return float(self.model.qpos0[self.model.joint(joint).qposadr[0]])

    def drives(
        self,
        period: float,
        sensing: Sensing | None = None,
        changes: Iterable[Mapping[str, Any]] = itertools.repeat({}),
    ) -> tuple[Drive, ...]:
        """Return each axis's drive, with its sensors, for a control period [s].

        `sensing` are the sensors, by default those of the description. `changes` has
        fields of the drive of each axis to change.
        """
        about, sensing = self.description, sensing or self.description.sensing
        made = [axis.drive(self.cables, about.scene, period) for axis in self.axes]
        turned = Counter(j for one in made for j in (one.joint, *one.shared_ratios))
        drives = []
        for axis, drive, own in zip(about.axes, made, changes, strict=False):
            shared, known = turned[drive.joint] > 1, about.hysteresis.get(axis.name, {})
            own = {"shared_joint": shared, "hysteresis": known, **own}
            drives.append(sensing.equip(drive, **own))
        return tuple(drives)

    def with_cables(self, cables: Mapping[str, Cable]) -> DeviceModel:
        """Return a copy with other cables, which `start` writes into the same model."""
        made = copy.copy(self)
        made.written = {
            name: cables[name].replace(route=own.route)
            for name, own in self.cables.items()
        }
        made.cables = made.written
        return made

    def apply_plant(self, plant: Plant) -> None:
        """Write the wearer and the cables of a plant into the compiled model.

        Raises:
            CableError: If the model has no room for the configuration of a cable.
        """
        for joint, wearer in plant.wearers.items():
            self._write_wearer(joint, wearer)
        for name, cable in plant.cables.items():
            write_cable(self.model, name, cable)

    def _write_wearer(self, joint: str, wearer: Wearer) -> None:
        actuator = self.model.actuator(self.description.movers[joint])
        self.movers[joint] = self.movers[joint].impose(actuator, wearer)

    def start(
        self, data: mujoco.MjData, angles: Mapping[str, float], commands: Array
    ) -> None:
        """Reset a simulation to the start of an episode: at rest, cables at pretension.

        `angles` sets joints by name [rad], others stay neutral; `commands` are the
        controls of the wearer's actuators. Motors turn until their cables are as long
        as in the neutral pose, then `plugin.settle` starts the cables there. All
        earlier state is lost.
        """
        model = self.model
        for name, cable in self.written.items():
            write_cable(model, name, cable)
        mujoco.mj_resetData(model, data)
        for name, angle in angles.items():
            data.qpos[model.joint(name).qposadr[0]] = angle
        data.ctrl[self.script_controls] = commands
        mujoco.mj_fwdPosition(model, data)
        for axis in self.axes:
            data.qpos[axis.places.motor_q] += axis.paid_out(data) / axis.proximal_arm
        plugin.settle(model, data)

    def read_cables(self, qpos: Array, plugin_state: Array) -> dict[str, Any]:
        """Return pose and cable states as columns of an episode log.

        `qpos` and `plugin_state` are those of `mjData`, of one simulation or, with a
        leading axis, of several. The pose is that after the last physics step; tensions
        and slip are those that acted during it.
        """
        columns: dict[str, Any] = {"qpos": qpos}
        for reader in self._readers:
            columns |= cable_columns(reader.name, reader.read(plugin_state))
        return columns


def load(device: Device, drawn: bool = True) -> mujoco.MjModel:
    """Compile the scene of a device, with room for other configurations of its cables.

    Visual elements remain if `drawn`; they can take half the time of a step.
    """
    spec = device.spec.copy() if drawn else Plant(device).spec()
    make_room(spec)
    return spec.compile()


def physics_of(data: mujoco.MjData) -> Physics:
    """Return the arrays of `data` as `Physics`: views, not copies."""
    return Physics(*(getattr(data, name) for name in Physics._fields))


def _require_parts(description: Description, model: mujoco.MjModel) -> None:
    joints = {model.joint(j).name for j in range(model.njnt)}
    actuators = {model.actuator(a).name for a in range(model.nu)}
    for axis in description.axes:
        for kind, names, there in (
            ("joint", (axis.drum, axis.joint), joints),
            ("actuator", (axis.motor,), actuators),
            ("cable", axis.cables, instances(model)),
        ):
            for name in names:
                if name not in there:
                    raise CableError(
                        f"the model is no variant of the scene {description.scene!r}: "
                        f"it has no {kind} {name!r}."
                    )


def _other_torques(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    places: Places,
    mover: Mover | None,
    rivals: Collection[int],
) -> tuple[tuple[int, float, int], ...]:
    """Return the actuators at the joint except the wearer and the axis's own cables.

    Each has its index in `actuator_force`, its gear, and the index of its moment arm in
    `actuator_moment`; that is -1 if the gear is the arm. `rivals` are the outputs of
    other axes' cables at the joint, which count among the actuators.
    """
    mujoco.mj_resetData(model, data)
    mujoco.mj_fwdPosition(model, data)
    cables = set(instances(model).values())
    found = []
    for actuator in range(model.nu):
        out = int(model.actuator_outadr[actuator])
        if int(model.actuator_plugin[actuator]) in cables and out not in rivals:
            continue
        if mover is not None and out == mover.out:
            continue
        start, count = int(data.moment_rowadr[out]), int(data.moment_rownnz[out])
        dofs = data.moment_colind[start : start + count].tolist()
        if places.joint_v not in dofs:
            continue
        on_joint = model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT
        place = -1 if on_joint else start + dofs.index(places.joint_v)
        found.append((out, float(model.actuator_gear[actuator, 0]), place))
    return tuple(found)


def _ends(model: mujoco.MjModel, name: str) -> tuple[int, int]:
    found = np.flatnonzero(model.actuator_plugin == instances(model)[name])
    proximal, distal = (int(model.actuator_outadr[actuator]) for actuator in found)
    return proximal, distal


def cable_columns(name: str, reading: plugin.CableReading) -> dict[str, Any]:
    return {
        f"tension_{name}_proximal_n": reading.tension_proximal,
        f"tension_{name}_distal_n": reading.tension_distal,
        f"moving_{name}_fraction": reading.moving_fraction,
        f"slack_{name}_m": reading.slack,
        f"dissipated_{name}_j": reading.dissipated,
        f"tension_{name}_nodes_n": reading.tension,
        f"slip_{name}_direction": reading.slip,
    }


def joint_range(model: mujoco.MjModel, name: str) -> tuple[float, float]:
    """Return the limits of a joint [rad], infinite without stops."""
    joint = model.joint(name)
    if not model.jnt_limited[joint.id]:
        return -np.inf, np.inf
    low, high = joint.range
    return float(low), float(high)
