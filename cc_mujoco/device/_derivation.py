"""Derivation of a device from its scene: motors, cables, joints, wearer, scales.

What the scene does not tell has the defaults stated here, unless the file beside the
scene gives it. The wearer is added to the scene where it has none.
"""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from cc_mujoco import plugin
from cc_mujoco._utils.toml_table import Table
from cc_mujoco.cable import PATHS, Cable
from cc_mujoco.device._cuff import add_cuff
from cc_mujoco.device._description import FREE_ROOTS, PERIOD, Axis, Description
from cc_mujoco.device._moment_arm import moments, neutral_moments, swept_moments
from cc_mujoco.device._mover import MotorLimits, Mover
from cc_mujoco.device._sensors import Sensing
from cc_mujoco.errors import CableError, CableWarning
from cc_mujoco.human import Wearer
from cc_mujoco.plugin._config import PLUGIN
from cc_mujoco.plugin._mjcf import instances
from cc_mujoco.plugin._spec import add_element

TORQUE_SHARE = 0.2
"""Share of the largest torque at the joint that the default task demands."""
NOISE_SHARE = 0.002
"""Noise of the assumed torque sensor, as a share of the largest torque at the joint."""
MARGIN = 0.1
"""Share of the range of a joint that named motions keep from either stop."""
DEFAULT_REACH = 0.5
"""Excursion of named motions at a joint without stops [rad]."""
WEARER_FREQUENCY, WEARER_DAMPING = 25.0, 0.7
"""Natural frequency [rad/s] and damping ratio of an assumed wearer at the joint."""
DEAD_SHARE = 0.15
"""Share of its longest arm below which a cable hardly turns its joint."""
MAX_RANGE = 6.0 * math.pi
"""Range of a driven hinge that looks like degrees [rad]."""
EVERY = "*"
"""Name in `[wearer]` that stands for every joint that nothing else moves."""

GIVEN, SCENE, ASSUMED = "given", "scene", "assumed"
"""Origins of a property."""

UNITS = {
    "twist": "motor_angle_rad",
    "motor_velocity": "motor_velocity_rad_s",
    "joint_angle": "joint_angle_rad",
    "joint_velocity": "joint_velocity_rad_s",
    "torque_error": "joint_torque_nm",
    "desired_torque": "desired_torque_nm",
}
"""Keys of `[axis.observation]` and the columns whose unit they are."""
PHASE = ("phase_sine", "phase_cosine")
"""Columns that are observed where `phase` is true."""

AXIS_KEYS = (
    "name",
    "motor",
    "joint",
    "torque",
    "task",
    "reach",
    "centre",
    "safe_torque",
    "motor_pulley",
    "joint_pulley",
    "gearing",
    "lever",
    "cuff",
    "observation",
)
WEARER_KEYS = ("actuator", "stiffness", "damping", "none")
KEYS = (
    "scene",
    "meaning",
    "trajectory",
    "period",
    "root",
    "rope",
    "sensors",
    "axis",
    "wearer",
)


class _End(NamedTuple):
    """One end of a cable in a compiled model."""

    actuator: int
    out: int
    joints: tuple[int, ...]
    """Joints that move it."""


class _Reader:
    """Values of a file, or defaults, whose origins are recorded."""

    def __init__(self) -> None:
        self.sources: dict[str, str] = {}

    def note(self, key: str, origin: str) -> None:
        """Record where a value is from."""
        self.sources[key] = origin

    def number(
        self,
        table: Table,
        key: str,
        default: float,
        origin: str,
        *,
        low: float = 0.0,
        high: float = math.inf,
        label: str = "",
    ) -> float:
        """Return a number of a table, or a default of some origin."""
        given = table.number(key, low)
        if given is not None and given > high:
            raise table.wrong(key, f"at most {high:.4g}, in SI units and radians")
        self.note(label + key, origin if given is None else GIVEN)
        return default if given is None else given


def describe(spec: mujoco.MjSpec, scene: str, table: Table) -> Description:
    """Return the description of a scene; gives it a wearer where it has none.

    Args:
        spec: The scene; bodies that are to be held, names and wearers are changed.
        scene: Its name or path.
        table: File of the description; empty where there is none.

    Raises:
        CableError: The scene is no device, or the file says what it does not have.
    """
    table.only(*KEYS)
    read = _Reader()
    _hold_root(spec, table, read)
    _name_parts(spec)
    _require_targets(spec, scene)
    model = _compile(spec, scene)
    _require_radians(model, scene)
    cables = plugin.from_mjcf(spec)
    if not cables:
        raise CableError(
            f"scene {scene} has no cable: give it a `plugin` of {PLUGIN!r}, or write "
            "one with `add_cable` or `add_friction`."
        )
    ends = _ends(model, cables)
    tables = _axis_tables(table)
    wearers = table.tables("wearer")
    for joint, own in wearers.items():
        own.only(*WEARER_KEYS)
        if joint != EVERY and spec.joint(joint) is None:
            raise CableError.unknown(
                f"joint in {own.where}", joint, _names(spec.joints)
            )
    axes = _axes(spec, model, scene, cables, ends, tables, read)
    movers = _movers(spec, model, axes, wearers, read)
    for place, axis in enumerate(axes):
        given = next((t for t in tables if t.text("motor") in (None, axis.motor)), None)
        if given is not None and "cuff" in given.content:
            axes[place] = add_cuff(spec, model, axis, given.table("cuff"))
    description = Description(
        scene=scene,
        meaning=table.text("meaning") or f"device of {Path(scene).name}",
        axes=tuple(axes),
        movers=movers,
        sensing=_sensing(table.table("sensors"), model, axes, ends, read),
        trajectory=table.text("trajectory") or "sine",
        strength=read.number(table.table("rope"), "strength", math.nan, ASSUMED),
        diameter=read.number(
            table.table("rope"), "diameter", math.nan, ASSUMED, low=1e-6, high=0.1
        ),
        period=_period(table, float(spec.option.timestep), scene, read),
        sources=read.sources,
    )
    table.table("rope").only("strength", "diameter")
    for key in ("meaning", "trajectory"):
        read.note(key, GIVEN if key in table.content else ASSUMED)
    return description


def _period(table: Table, timestep: float, scene: str, read: _Reader) -> float:
    """Return the control period [s]; warns where it cannot be 1 ms."""
    steps = max(round(PERIOD / timestep), 1)
    fits = abs(steps * timestep - PERIOD) < 1e-9
    default = PERIOD if fits else steps * timestep
    if not fits and "period" not in table.content:
        warnings.warn(
            f"device {scene}: a time step of {1e3 * timestep:g} ms makes a control "
            f"period of {1e3 * default:g} ms instead of 1 ms; `timestep` in <option> "
            "or `period` in the description sets it.",
            stacklevel=2,
        )
    return read.number(table, "period", default, ASSUMED, low=1e-6)


def _compile(spec: mujoco.MjSpec, scene: str) -> mujoco.MjModel:
    try:
        # A copy, as elements of what was compiled cannot all be taken out later.
        return spec.copy().compile()
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise CableError(f"scene {scene} does not compile: {reason}") from None


def _names(elements: Iterable[Any]) -> list[str]:
    return [element.name for element in elements if element.name]


def _hold_root(spec: mujoco.MjSpec, table: Table, read: _Reader) -> None:
    """Take the free joints out, unless the description lets them be free."""
    choice = table.choice("root", FREE_ROOTS)
    free = [j for j in spec.joints if j.type == mujoco.mjtJoint.mjJNT_FREE]
    if not free:
        return
    read.note("root", ASSUMED if choice is None else GIVEN)
    if choice == "free":
        return
    if choice is None:
        warnings.warn(
            f"device {table.where}: the body on free joint {free[0].name!r} is held "
            'where it is; root = "free" or "held" in the description says which.',
            CableWarning,
            stacklevel=2,
        )
    # Episodes begin in the neutral pose; keyframes count the coordinates of the root.
    for element in [*spec.keys, *free]:
        spec.delete(element)


def _require_targets(spec: mujoco.MjSpec, scene: str) -> None:
    """Refuse an end of a cable on a joint or a tendon that is not there."""
    kinds = {
        mujoco.mjtTrn.mjTRN_JOINT: ("joint", spec.joints),
        mujoco.mjtTrn.mjTRN_TENDON: ("tendon", spec.tendons),
    }
    for actuator in spec.actuators:
        if actuator.plugin.plugin_name != PLUGIN or actuator.trntype not in kinds:
            continue
        kind, elements = kinds[actuator.trntype]
        names = _names(elements)
        if actuator.target not in names:
            where = f"{kind} of cable {actuator.plugin.name!r} in scene {scene}"
            raise CableError.unknown(where, str(actuator.target), names)


def _require_radians(model: mujoco.MjModel, scene: str) -> None:
    """Warn of the range of a hinge that looks like degrees."""
    hinges = (model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE) & (model.jnt_limited != 0)
    driven = [j for j in np.flatnonzero(hinges) if not _is_drum(model, int(j))]
    for joint in driven:
        low, high = model.jnt_range[joint].tolist()
        if high - low > MAX_RANGE:
            warnings.warn(
                f"scene {scene}: joint {model.joint(int(joint)).name!r} has a range of "
                f"{low:g} to {high:g} rad; if these are degrees, `angle` in <compiler> "
                "must be degree.",
                CableWarning,
                stacklevel=2,
            )


def _is_drum(model: mujoco.MjModel, joint: int) -> bool:
    """Return whether a motor other than a cable and a spring turns a joint."""
    on = (model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT) & (
        model.actuator_trnid[:, 0] == joint
    )
    free = (model.actuator_plugin < 0) & (
        model.actuator_biastype == mujoco.mjtBias.mjBIAS_NONE
    )
    return bool((on & free).any())


def _name_parts(spec: mujoco.MjSpec) -> None:
    """Name what a device has to find again: actuators and joints without a name."""
    taken = {*_names(spec.actuators)}
    for place, joint in enumerate(spec.joints):
        if not joint.name:
            joint.name = f"joint_{place}"
    for actuator in spec.actuators:
        if not actuator.name:
            base = actuator.plugin.name or "actuator"
            name = f"{base}_{actuator.target}"
            while name in taken:
                name += "_"
            actuator.name = name
            taken.add(name)


def _ends(
    model: mujoco.MjModel, cables: Mapping[str, Cable]
) -> dict[str, tuple[_End, _End]]:
    """Return both ends of every cable."""
    moments = np.abs(swept_moments(model)).max(axis=0)
    found = {}
    for name, instance in instances(model).items():
        used = np.flatnonzero(model.actuator_plugin == instance).tolist()
        ends = []
        for actuator in used:
            out = int(model.actuator_outadr[actuator])
            row = moments[out]
            moved = np.flatnonzero(row > 1e-9 * max(float(row.max()), 1e-12))
            joints = tuple(
                dict.fromkeys(int(model.dof_jntid[dof]) for dof in moved.tolist())
            )
            ends.append(_End(actuator, out, joints))
        found[name] = (ends[0], ends[1])
    return {name: found[name] for name in cables}


def _axis_tables(table: Table) -> list[Table]:
    """Return the tables of the axes, as far as the file has them."""
    given = table.content.get("axis", [])
    several = isinstance(given, list)
    listed = given if several else [given]
    tables = []
    for place, content in enumerate(listed):
        where = f"[[axis]] {place + 1}" if several else "[axis]"
        if not isinstance(content, dict):
            raise table.wrong("axis", "a table, written as [axis] or [[axis]]")
        own = Table(f"{table.where}, {where}", content)
        own.only(*AXIS_KEYS)
        tables.append(own)
    return tables


def _axes(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    scene: str,
    cables: Mapping[str, Cable],
    ends: Mapping[str, tuple[_End, _End]],
    tables: list[Table],
    read: _Reader,
) -> list[Axis]:
    """Return the axes: one for each motor that winds cables."""
    wound: dict[int, list[str]] = {}
    for name, (proximal, _) in ends.items():
        motor = _motor_of(model, proximal)
        if motor is not None:
            wound.setdefault(motor, []).append(name)
    if not wound:
        first = next(iter(ends))
        held = [model.joint(joint).name for joint in ends[first][0].joints]
        where = f"joint {held[0]!r}" if held else "a joint"
        raise CableError(
            f"no motor winds a cable of scene {scene}: give {where}, which moves the "
            f"proximal end of cable {first!r}, an actuator <motor> with a `ctrlrange`."
        )
    motors = {model.actuator(motor).name: motor for motor in wound}
    given: dict[str, Table] = {}
    for table in tables:
        motor_name = table.text("motor")
        if motor_name is None:
            if len(motors) > 1:
                raise CableError(
                    f"{table.where} needs `motor`, one of {', '.join(motors)}."
                )
            (motor_name,) = motors
        if motor_name not in motors:
            raise CableError.unknown(f"motor in {table.where}", motor_name, motors)
        if motor_name in given:
            raise CableError(
                f"{table.where} describes motor {motor_name!r} a second time; an axis "
                "has one table."
            )
        given[motor_name] = table
    # The order of the file, then that of the scene.
    order = [*given, *(name for name in motors if name not in given)]
    axes: list[Axis] = []
    sources = []
    for name in order:
        table = given.get(name, Table(f"scene {scene}, motor {name!r}", {}))
        one = _axis(spec, model, motors[name], wound[motors[name]], ends, table, read)
        origins = [key for key in read.sources if key.startswith("axis.")]
        sources.append({key: read.sources.pop(key) for key in origins})
        axes.append(one)
    _separate(axes, cables, given)
    for axis, own in zip(axes, sources, strict=True):
        label = f"{axis.name}." if len(axes) > 1 else ""
        read.sources |= {label + key: origin for key, origin in own.items()}
    names = [axis.name for axis in axes]
    for twice in names:
        if names.count(twice) > 1:
            raise CableError(
                f"scene {scene} has two axes of the name {twice!r}; give each a `name` "
                "in [[axis]]."
            )
    return axes


def _separate(
    axes: list[Axis], cables: Mapping[str, Cable], given: Mapping[str, Table]
) -> None:
    """Name axes that drive one joint by their motors, unless the file names them.

    Raises:
        CableError: Their cables pull the joint in one sum, so nothing separates them.
    """
    joints = [axis.joint for axis in axes]
    for place, axis in enumerate(axes):
        if joints.count(axis.joint) == 1:
            continue
        for name in axis.cables:
            if cables[name].path != PATHS[0]:
                raise CableError(
                    f"several motors drive joint {axis.joint!r}, and cable {name!r} of "
                    f"motor {axis.motor!r} has path = {cables[name].path!r}: what each "
                    "motor contributes is known of guided cables only; lead that "
                    "cable in a conduit."
                )
        table = given.get(axis.motor)
        if table is None or table.text("name") is None:
            axes[place] = dataclasses.replace(axis, name=axis.motor)


def _motor_of(model: mujoco.MjModel, end: _End) -> int | None:
    """Return the actuator that turns what a proximal end is wound on."""
    for actuator in range(model.nu):
        joint = int(model.actuator_trnid[actuator, 0])
        if (
            model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT
            and joint in end.joints
            and model.actuator_plugin[actuator] < 0
        ):
            return actuator
    return None


def _axis(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    motor: int,
    wound: list[str],
    ends: Mapping[str, tuple[_End, _End]],
    table: Table,
    read: _Reader,
) -> Axis:
    """Return the axis of a motor."""
    name = model.actuator(motor).name
    drum = int(model.actuator_trnid[motor, 0])
    _require_hinge(model, drum, f"motor {name!r} turns")
    torque = _torque_limit(spec, model, motor, table, read)
    joint = _driven_joint(model, wound, ends, drum, table, read)
    moved = model.joint(joint).name
    _require_hinge(model, joint, f"motor {name!r} drives")
    own = [n for n in wound if joint in ends[n][1].joints]
    arms = {n: _arms(model, ends[n], drum, joint) for n in own}
    proximal, distal = arms[own[0]]
    if not proximal or not distal:
        raise CableError(
            f"cable {own[0]!r} has no lever arm at joint {moved!r} in the pose `qpos0`;"
            " give the scene a neutral pose in which it pulls."
        )
    largest = torque * abs(distal / proximal)
    pulls = [p for n in own for p in [arms[n][1] / arms[n][0]]]
    signs = {p < 0.0 for p, _ in arms.values()}
    pull_pull = len(own) == 2 and len(signs) == 2 and len({p > 0.0 for p in pulls}) == 1
    one_way = len(signs) == 1
    centre, reach = excursion(model, joint, table.number("reach", 1e-3))
    reach = read.number(
        table, "reach", reach, SCENE, low=1e-3, high=2.0 * math.pi, label="axis."
    )
    centre = read.number(table, "centre", centre, SCENE, low=-math.inf, label="axis.")
    _warn_of_dead_centre(model, ends[own[0]][1], joint, own[0], (centre, reach))
    # A cable pulls its joint against its own arm.
    way = -math.copysign(1.0, distal) if one_way else 1.0
    demanded = _rounded(TORQUE_SHARE * largest)
    task = table.text("task")
    read.note("axis.task", ASSUMED if task is None else GIVEN)
    gearing = table.number("gearing", 1e-9)
    read.note("axis.gearing", ASSUMED if gearing is None else GIVEN)
    units = _units(table.table("observation"), reach, largest, read)
    axis_name = table.text("name") or moved
    return Axis(
        name=axis_name,
        motor=name,
        drum=model.joint(drum).name,
        joint=moved,
        limb=moved,
        cables=tuple(wound),
        pull_pull=pull_pull,
        torque=torque,
        reach=reach,
        centre=centre,
        torque_scale=units["joint_torque_nm"],
        units=units,
        task=task or f"hold:{way * demanded:g}",
        safe_torque=read.number(
            table, "safe_torque", math.inf, ASSUMED, low=1e-9, label="axis."
        ),
        motor_pulley=read.number(table, "motor_pulley", 0.0, ASSUMED, label="axis."),
        gearing=gearing,
        joint_pulley=read.number(table, "joint_pulley", 0.0, ASSUMED, label="axis."),
        lever=_lever(spec, model, ends[own[0]][1], joint, table, read),
    )


def _warn_of_dead_centre(
    model: mujoco.MjModel,
    end: _End,
    joint: int,
    cable: str,
    motion: tuple[float, float],
) -> None:
    """Warn of angles of named motions at which a cable hardly turns its joint."""
    place, dof = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
    centre, reach = motion
    angles = np.linspace(centre - reach, centre + reach, 9)
    poses = np.repeat(model.qpos0[None], len(angles), axis=0)
    poses[:, place] = angles
    arms = moments(model, list(poses))[:, end.out, dof]
    least = int(np.argmin(arms * math.copysign(1.0, float(arms.sum()))))
    share = float(arms[least] / np.abs(arms).max())
    if abs(share) < DEAD_SHARE or share * float(arms.sum()) < 0.0:
        warnings.warn(
            f"cable {cable!r} hardly turns joint {model.joint(joint).name!r} at "
            f"{angles[least]:.3g} rad, where its arm is {1e3 * arms[least]:.2g} mm of "
            f"{1e3 * np.abs(arms).max():.2g} mm at most; `reach` and `centre` in "
            "[axis] set where named motions go.",
            CableWarning,
            stacklevel=2,
        )


def _require_hinge(model: mujoco.MjModel, joint: int, what: str) -> None:
    if model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_HINGE:
        raise CableError(
            f"joint {model.joint(joint).name!r}, which {what}, must be a hinge."
        )


def _torque_limit(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    motor: int,
    table: Table,
    read: _Reader,
) -> float:
    """Return the largest torque of a motor [N m]; writes a given one into the scene."""
    name = model.actuator(motor).name
    gain, gear = (
        float(model.actuator_gainprm[motor, 0]),
        float(model.actuator_gear[motor, 0]),
    )
    dynamic = (
        mujoco.mjtDyn.mjDYN_NONE,
        mujoco.mjtDyn.mjDYN_FILTER,
        mujoco.mjtDyn.mjDYN_FILTEREXACT,
    )
    if (
        model.actuator_gaintype[motor] != mujoco.mjtGain.mjGAIN_FIXED
        or int(model.actuator_dyntype[motor]) not in map(int, dynamic)
        or (
            model.actuator_biastype[motor] != mujoco.mjtBias.mjBIAS_NONE
            and np.any(model.actuator_biasprm[motor])
        )
    ):
        raise CableError(
            f"actuator {name!r} is no source of torque: controllers command the torque "
            "of a motor; make it a <motor> with `ctrlrange` or `forcerange`."
        )
    given = table.number("torque", 0.0)
    if given is not None:
        limit = given / abs(gain * gear)
        spec.actuator(name).ctrlrange = [-limit, limit]
        read.note("axis.torque", GIVEN)
        return given
    torque = MotorLimits.of(model, motor).torque
    if not math.isfinite(torque):
        raise CableError(
            f"motor {name!r} has no limit: give it a `ctrlrange`, or write its largest "
            "torque as `torque` in [axis]."
        )
    read.note("axis.torque", SCENE)
    return torque


def _driven_joint(
    model: mujoco.MjModel,
    wound: list[str],
    ends: Mapping[str, tuple[_End, _End]],
    drum: int,
    table: Table,
    read: _Reader,
) -> int:
    """Return the joint that a motor's cables drive."""
    candidates = [
        joint for name in wound for joint in ends[name][1].joints if joint != drum
    ]
    names = [model.joint(joint).name for joint in dict.fromkeys(candidates)]
    if not names:
        raise CableError(
            f"cable {wound[0]!r} moves no joint: attach its distal end to a joint, or "
            "to a tendon that crosses one."
        )
    given = table.text("joint")
    if given is not None:
        if given not in names:
            raise CableError.unknown(f"joint in {table.where}", given, names)
        read.note("axis.joint", GIVEN)
        return int(model.joint(given).id)
    read.note("axis.joint", SCENE if len(names) == 1 else ASSUMED)
    if len(names) == 1:
        return int(model.joint(names[0]).id)
    # Of several, the one with the longest arm.
    moments = np.abs(swept_moments(model)).mean(axis=0)
    row = moments[ends[wound[0]][1].out]
    joints = [int(model.joint(name).id) for name in names]
    return max(joints, key=lambda joint: float(row[model.jnt_dofadr[joint]]))


def _arms(
    model: mujoco.MjModel, ends: tuple[_End, _End], drum: int, joint: int
) -> tuple[float, float]:
    """Return the displacement of both ends per angle in the neutral pose [m/rad]."""
    dense = neutral_moments(model)
    proximal, distal = ends
    return (
        float(dense[proximal.out, model.jnt_dofadr[drum]]),
        float(dense[distal.out, model.jnt_dofadr[joint]]),
    )


def excursion(
    model: mujoco.MjModel, joint: int, given: float | None = None
) -> tuple[float, float]:
    """Return centre and reach of named motions at a joint [rad].

    The centre is the neutral angle, unless that is too near to a stop.
    """
    neutral = float(model.qpos0[model.jnt_qposadr[joint]])
    if not model.jnt_limited[joint]:
        return neutral, DEFAULT_REACH
    low, high = model.jnt_range[joint].tolist()
    if given is not None and low <= neutral - given and neutral + given <= high:
        return neutral, given
    span = high - low
    low, high = low + MARGIN * span, high - MARGIN * span
    if min(high - neutral, neutral - low) < 0.25 * span:
        neutral = 0.5 * (low + high)
    reach = min(high - neutral, neutral - low)
    return _rounded(neutral, 6), _rounded(min(reach, 1.0), 3)


def _units(
    table: Table, reach: float, largest: float, read: _Reader
) -> dict[str, float]:
    """Return the sizes that count as 1, by column."""
    table.only(*UNITS, "phase")
    defaults = {
        "twist": _rounded(0.2 * reach),
        "motor_velocity": 2.0,
        "joint_angle": _rounded(0.5 * reach),
        "joint_velocity": 2.0,
        "torque_error": _rounded(0.05 * largest),
        "desired_torque": _rounded(TORQUE_SHARE * largest),
    }
    units = {
        UNITS[key]: read.number(
            table, key, value, ASSUMED, low=1e-9, label="axis.observation."
        )
        for key, value in defaults.items()
    }
    phase = table.content.get("phase", False)
    if not isinstance(phase, bool):
        raise table.wrong("phase", "true or false")
    read.note("axis.observation.phase", GIVEN if "phase" in table.content else ASSUMED)
    return units | dict.fromkeys(PHASE, 1.0) if phase else units


def _lever(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    end: _End,
    joint: int,
    table: Table,
    read: _Reader,
) -> tuple[str, ...]:
    """Return the sites that move with a lever; none for a pulley or an open path."""
    given = table.content.get("lever")
    if given is not None:
        listed = given if isinstance(given, list) else [given]
        for site in listed:
            if not isinstance(site, str) or spec.site(site) is None:
                raise CableError.unknown(
                    f"site in {table.where}, lever", str(site), _names(spec.sites)
                )
        read.note("axis.lever", GIVEN)
        return tuple(listed)
    read.note("axis.lever", SCENE)
    if model.actuator_trntype[end.actuator] != mujoco.mjtTrn.mjTRN_TENDON:
        return ()
    held = model.tendon(int(model.actuator_trnid[end.actuator, 0])).name
    path = spec.tendon(held).path
    sites = [w.target for w in path if w.type == mujoco.mjtWrap.mjWRAP_SITE]
    if len(sites) != 2 or len(path) != 2:
        return ()
    body = model.body(int(model.jnt_bodyid[joint])).name
    own = [site.name for site in sites if site.parent.name == body and site.name]
    return tuple(own[-1:])


def _movers(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    axes: list[Axis],
    wearers: Mapping[str, Table],
    read: _Reader,
) -> dict[str, str]:
    """Return the actuators by which the wearer moves joints; adds those that lack."""
    drums = {axis.drum for axis in axes}
    driven = [axis.joint for axis in axes]
    others = [
        model.joint(j).name
        for j in range(model.njnt)
        if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE
        and model.joint(j).name not in (*drums, *driven)
    ]
    every = wearers.get(EVERY)
    found: dict[str, str] = {}
    for joint in dict.fromkeys((*driven, *others)):
        table = wearers.get(joint)
        label = f"wearer.{joint}"
        existing = _springs(model, joint)
        if table is None and not existing and (joint in driven or every is not None):
            if joint in driven and _is_moved(model, joint, axes):
                read.note(label, SCENE)
                continue  # muscles or other actuators move the body by themselves
            table = every or Table(label, {})
        if table is None:
            if existing:
                found[joint] = existing[0]
                read.note(label, SCENE)
            continue
        read.note(label, GIVEN if table.content else ASSUMED)
        if table.content.get("none", False):
            continue
        name = table.text("actuator")
        if name is not None and name not in existing:
            raise CableError.unknown(
                f"actuator in {table.where} (a position actuator at that joint)",
                name,
                existing,
            )
        if name is None:
            name = existing[0] if existing else ""
        stiffness, damping = table.number("stiffness", 1e-6), table.number("damping", 0)
        if not name:
            inertia = float(model.dof_M0[model.joint(joint).dofadr[0]])
            if stiffness is None:
                stiffness = _rounded(inertia * WEARER_FREQUENCY**2)
            if damping is None:
                damping = _rounded(
                    2.0 * WEARER_DAMPING * math.sqrt(inertia * stiffness)
                )
            name = f"wearer_{joint}"
            added = add_element(
                spec,
                "actuator",
                name=name,
                trntype=mujoco.mjtTrn.mjTRN_JOINT,
                target=joint,
                gaintype=mujoco.mjtGain.mjGAIN_FIXED,
                biastype=mujoco.mjtBias.mjBIAS_AFFINE,
            )
            added.gainprm[0] = stiffness
            added.biasprm[:3] = (0.0, -stiffness, -damping)
        elif stiffness is not None or damping is not None:
            mover = Mover.of(model, int(model.actuator(name).id))
            mover.impose(
                spec.actuator(name),
                Wearer(
                    mover.wearer.stiffness if stiffness is None else stiffness,
                    mover.wearer.damping if damping is None else damping,
                ),
            )
        found[joint] = name
    return found


def _springs(model: mujoco.MjModel, joint: str) -> list[str]:
    """Return the actuators that pull a joint to where their control says."""
    place = model.joint(joint).id
    return [
        model.actuator(a).name
        for a in range(model.nu)
        if model.actuator_trntype[a] == mujoco.mjtTrn.mjTRN_JOINT
        and model.actuator_trnid[a, 0] == place
        and model.actuator_plugin[a] < 0
        and model.actuator_gaintype[a] == mujoco.mjtGain.mjGAIN_FIXED
        and model.actuator_biastype[a] == mujoco.mjtBias.mjBIAS_AFFINE
        and model.actuator_biasprm[a, 1] < 0.0
        and model.actuator_gainprm[a, 0] != 0.0
        and model.actuator_dyntype[a] == mujoco.mjtDyn.mjDYN_NONE
    ]


def _is_moved(model: mujoco.MjModel, joint: str, axes: list[Axis]) -> bool:
    """Return whether actuators other than cables move a joint, such as muscles."""
    dof = int(model.joint(joint).dofadr[0])
    moments = np.abs(swept_moments(model)).max(axis=0)
    motors = {axis.motor for axis in axes}
    return any(
        model.actuator_plugin[a] < 0
        and model.actuator(a).name not in motors
        and model.actuator_trntype[a] != mujoco.mjtTrn.mjTRN_JOINT
        and moments[int(model.actuator_outadr[a]), dof] > 1e-9
        for a in range(model.nu)
    )


def _sensing(
    table: Table,
    model: mujoco.MjModel,
    axes: list[Axis],
    ends: Mapping[str, tuple[_End, _End]],
    read: _Reader,
) -> Sensing:
    """Return the sensors; noise that is not given goes with the largest torque."""
    names = [field.name for field in dataclasses.fields(Sensing)]
    table.only(*names)
    scales = [axis.units["joint_torque_nm"] / 0.05 for axis in axes]
    arms = [
        abs(
            _arms(
                model,
                ends[axis.cables[0]],
                int(model.joint(axis.drum).id),
                int(model.joint(axis.limb).id),
            )[1]
        )
        or 1.0
        for axis in axes
    ]
    noise = _rounded(NOISE_SHARE * min(scales))
    defaults = {
        "torque_noise": noise,
        "tension_noise": _rounded(
            NOISE_SHARE * min(s / a for s, a in zip(scales, arms, strict=True))
        ),
    }
    found: dict[str, Any] = {}
    for name in names:
        given = table.number(name, 0.0)
        read.note(f"sensors.{name}", ASSUMED if given is None else GIVEN)
        if given is not None:
            found[name] = int(given) if name == "delay" else given
        elif name in defaults:
            found[name] = defaults[name]
    return Sensing(**found)


def known_torque_noise(description: Description) -> float:
    """Return the noise of the joint torque sensor, 0 where it is only assumed [N m]."""
    assumed = description.sources.get("sensors.torque_noise") == ASSUMED
    return 0.0 if assumed else description.sensing.torque_noise


def _rounded(value: float, digits: int = 2) -> float:
    """Return a number with few digits."""
    return float(f"{value:.{digits}g}")
