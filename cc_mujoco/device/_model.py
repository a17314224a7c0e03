"""A device on a MuJoCo model: the indices of its parts in the arrays, and readings.

Readings take the arrays of one simulation or, with a leading axis, of several. Both
give the same bits, because the arithmetic is elementwise.
"""

import copy
import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco import plugin
from cc_mujoco.cable._cable import PATHS, Cable
from cc_mujoco.device import Plant
from cc_mujoco.device._axis_record import AXIS, Physics
from cc_mujoco.device._description import Axis, Description
from cc_mujoco.device._device import Device, Nominal
from cc_mujoco.device._drive import CableDrive, Drive
from cc_mujoco.device._moment_arm import Arms, TabledWinding, Winding, open_winding
from cc_mujoco.device._mover import FILTERS, MotorLimits, Mover
from cc_mujoco.device._observation import Observed
from cc_mujoco.device._sensors import WINDING_COLUMNS, Sensing
from cc_mujoco.errors import CableError
from cc_mujoco.human import Wearer
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.plugin._mjcf import make_room, write_cable


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
        axis: Axis,
        arms: Arms,
        cables: Mapping[str, plugin.Reader],
        mover: Mover | None,
        others: Sequence[Axis],
    ) -> None:
        """Look up indices; `cables` are all there are, `others` other motors' axes."""
        self.axis, self.model = axis, arms.model
        model = arms.model
        motor = model.actuator(axis.motor)
        self._motor = int(motor.id)
        self.motor_control = int(model.actuator_ctrladr[motor.id])
        turning, joint = model.joint(axis.drum), model.joint(axis.joint)
        self.places = Places(
            motor_q=int(turning.qposadr[0]),
            motor_v=int(turning.dofadr[0]),
            joint_q=int(joint.qposadr[0]),
            joint_v=int(joint.dofadr[0]),
            motor_out=int(model.actuator_outadr[motor.id]),
            wearer_out=-1 if mover is None else mover.out,
        )
        self._proximal, self._distal = (
            {n: float(arms.neutral[cables[n].outputs[side], dof]) for n in axis.cables}
            for side, dof in enumerate((self.places.motor_v, self.places.joint_v))
        )
        winds = all(arm > 0.0 for arm in self._proximal.values())
        self.sense = -1.0 if winds else 1.0
        """Sign of the motor's angle in the columns; positive angles wind cables that
        only pull."""
        self.motor_gear = self.sense * float(motor.gear[0])
        """Torque of the motor, as in the columns, per its force [N m/N or 1]."""
        limits = MotorLimits.of(model, self._motor)
        self.torque_limit = limits.torque  # torque of the motor at an action of 1 [N m]
        self.motor_scale = self.sense * limits.control
        """Control of the motor at an action of 1."""
        low, high = sorted(self.sense * end for end in limits.torques)
        self._torques = low, high
        self.driven = tuple(name for name in axis.cables if self._distal[name])
        """Names of the cables from the motor to the joint."""
        name = self.driven[0]
        self.first = cables[name].outputs
        """Indices in `actuator_force` of both ends of the first cable of the joint."""
        self.proximal_arm = self._proximal[name]
        """Displacement of that cable's proximal end per angle of the drum [m/rad]."""
        motor_arm = self.sense * self.proximal_arm
        self.ratio = self._distal[name] / motor_arm
        """Joint torque per motor torque without friction in the neutral pose [-]."""
        self.winding: Winding | TabledWinding | None
        """Winding of the first cable's distal end (of its open part if it leaves its
        conduit); None on a round pulley."""
        # No controller knows a cable of which other joints wind an open part.
        self._unknown = False
        self.shared_ratios: dict[str, float] = {}
        """Ratio at every joint of another axis that the cable turns [-]."""
        cable, end = cables[name].cable, self.first[1]
        if cable.path == PATHS[2]:  # it leaves its conduit
            tendon, mouth = model.tendon(cable.route).id, model.site(cable.mouth).id
            self.winding = open_winding(model, int(tendon), int(mouth), axis.joint)
            self._unknown = self.winding is None
        else:
            joints = {one.joint for one in others}
            self.winding = arms.winding(end, axis.joint, joints, motor_arm)
            for joint in filter(joints.__contains__, self.crossed):
                arm = float(arms.neutral[end, model.joint(joint).dofadr[0]])
                self.shared_ratios[joint] = arm / motor_arm
        self._mover = mover
        # The cables of other motors count among the actuators at their joint.
        rivals = {n for one in others if one.joint == axis.joint for n in one.cables}
        known = {out for one in cables.values() for out in one.outputs}
        known -= {cables[name].outputs[1] for name in rivals}
        known.add(self.places.wearer_out)
        self._others = arms.others(self.places.joint_v, known)
        medium = model.opt.density or model.opt.viscosity
        self._weightless = bool(np.any(model.body_gravcomp) or medium)

    def paid_out(self, data: mujoco.MjData) -> float:
        """Return the first cable's length pulled out at the joint from neutral [m]."""
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
        return self.winding.others if self.winding else ()

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
        others = self._others
        outs, arms = [one.out for one in others], [one.place for one in others]
        same = ("motor_control", "sense", "motor_gear", "motor_scale", "torque_limit")
        found = places._asdict() | {name: getattr(self, name) for name in same}
        found |= {
            "cuffed": self.axis.cuff is not None,
            "weightless": self._weightless,
            "others": len(outs),
            "other_outs": hold(np.array([*outs, *arms], np.int64)),
            "other_arms": hold(np.array([one.gear for one in others])),
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
        self.readers = {n: plugin.Reader(model, n) for n in plugin.cables(model)}
        """Readers of the cables of the model, by name."""
        self._require_parts()
        self.frame_skip = description.frame_skip(float(model.opt.timestep))
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
        arms, axes = Arms(model, data or mujoco.MjData(model)), description.axes
        joints = dict.fromkeys((*(axis.limb for axis in axes), *self.movers))
        self.ranges = {joint: joint_range(model, joint) for joint in joints}
        """Limits of the joints that the wearer moves, those of the axes first [rad]."""
        self.axes = tuple(
            AxisModel(
                *(axis, arms, self.readers, self.movers.get(axis.limb)),
                others=[one for one in axes if one.motor != axis.motor],
            )
            for axis in axes
        )
        """The axes, in the order of the description."""
        self.prefixes = description.prefixes  # beginnings of the columns of each axis
        self.motor_controls = [axis.motor_control for axis in self.axes]
        self.torque_limits = np.array([axis.torque_limit for axis in self.axes])
        """Torques of the motors at an action of 1 [N m]."""
        self.script_controls = [mover.control for mover in self.movers.values()]
        """Controls of the wearer."""
        self.cables = {name: reader.cable for name, reader in self.readers.items()}
        """Cables by name, with the parameters that they are simulated with."""
        self.written: dict[str, Cable] = {}
        """Cables that `start` writes into the model first, see `with_cables`."""

    @classmethod
    def of(cls, plant: Plant | Nominal | str | Path) -> "DeviceModel":
        """Return the compiled model of a plant, or of a device as its scene has it."""
        plant = plant if isinstance(plant, Plant) else Plant(plant)
        return cls(plant.description, plant.model())

    def _require_parts(self) -> None:
        """Raise `CableError` if the model lacks a part of the description."""
        model, scene = self.model, self.description.scene
        joints = {model.joint(j).name for j in range(model.njnt)}
        actuators = {model.actuator(a).name for a in range(model.nu)}
        for axis in self.description.axes:
            for kind, names, there in (
                ("joint", (axis.drum, axis.joint), joints),
                ("actuator", (axis.motor,), actuators),
                ("cable", axis.cables, self.readers),
            ):
                for name in names:
                    if name not in there:
                        raise CableError(
                            f"the model is no variant of the scene {scene!r}: it has "
                            f"no {kind} {name!r}."
                        )

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

    def with_cables(self, cables: Mapping[str, Cable]) -> "DeviceModel":
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
        for name, reader in self.readers.items():
            columns |= cable_columns(name, reader.read(plugin_state))
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
