"""Derivation of a device from its scene: motors, cables, joints, scales, wearers.

A property that neither the scene nor the description file gives takes the default
stated here.
"""

import dataclasses
import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from cc_mujoco import plugin
from cc_mujoco._utils.toml_table import Table
from cc_mujoco.cable import PATHS, Cable
from cc_mujoco.device._description import (
    ASSUMED,
    PERIOD,
    SCENE,
    Axis,
    Cuff,
    Description,
    Keys,
    Slip,
    rounded,
)
from cc_mujoco.device._device_files import hysteresis_of
from cc_mujoco.device._moment_arm import Arms
from cc_mujoco.device._mover import FILTERS, MotorLimits, Mover, joint_actuators
from cc_mujoco.device._sensors import Sensing
from cc_mujoco.errors import CableError, CableWarning
from cc_mujoco.plugin._engine import PLUGIN
from cc_mujoco.plugin._mjcf import instances
from cc_mujoco.plugin._readings import moments
from cc_mujoco.plugin._spec import add_element, compile_spec, no_cable

UNITS = {
    "twist": "motor_angle_rad",
    "motor_velocity": "motor_velocity_rad_s",
    "joint_angle": "joint_angle_rad",
    "joint_velocity": "joint_velocity_rad_s",
    "torque_error": "joint_torque_nm",
    "desired_torque": "desired_torque_nm",
}
"""Keys of `[axis.observation]` and the columns whose unit they are."""

KEYS = {
    "": (
        "scene", "meaning", "trajectory", "period", "root", "rope", "sensors", "axis",
        "wearer", "hysteresis",
    ),
    "axis": (
        "name", "motor", "joint", "torque", "task", "reach", "centre", "safe_torque",
        "safe_speed", "safe_power", "motor_pulley", "joint_pulley", "gearing", "lever",
        "cuff", "observation",
    ),
    "wearer": ("actuator", "stiffness", "damping", "none"),
}  # fmt: skip
"""Keys of the file and of tables in it."""


class _End(NamedTuple):
    actuator: int
    out: int
    joints: tuple[int, ...]


class _Scene(NamedTuple):
    """Scene to be described: specification, moment arms, cables and their ends."""

    name: str
    spec: mujoco.MjSpec
    arms: Arms
    cables: Mapping[str, Cable]
    ends: Mapping[str, tuple[_End, _End]]

    @property
    def model(self) -> mujoco.MjModel:
        return self.arms.model


class _Found(NamedTuple):
    """Axis found in a scene, its table in the description, largest torque and arm."""

    axis: Axis
    keys: Keys
    largest: float  # torque at the joint without friction [N m]
    arm: float  # of the cable at the joint in the neutral pose [m/rad]


def describe(spec: mujoco.MjSpec, scene: str, table: Table) -> Description:
    """Return the description of a scene, and prepare the scene in place.

    `spec` loses its free joints, gets names for unnamed parts and an actuator of the
    wearer where the scene has none. `table` is the description file, empty without one.
    """
    table.only(*KEYS[""])
    keys = Keys(table, {})
    _hold_root(spec, keys)
    _name_parts(spec)
    _require_targets(spec, scene)
    # A copy, as some elements cannot be deleted from a compiled specification.
    model = compile_spec(spec.copy(), scene)
    _warn_of_degrees(model, scene)
    cables = plugin.from_mjcf(spec)
    if not cables:
        raise no_cable(scene)
    arms = Arms(model, mujoco.MjData(model))
    whole = _Scene(scene, spec, arms, cables, _ends(arms, cables))
    found = _axes(whole, table)
    names = [one.axis.name for one in found]
    for one in found:
        label = f"{one.axis.name}." if len(found) > 1 else ""
        keys.sources.update((label + k, v) for k, v in one.keys.sources.items())
    movers = _movers(whole, [one.axis for one in found], keys)
    axes = [_with_cuff(whole, one) for one in found]
    rope = Keys(table.table("rope"), keys.sources)
    rope.table.only("strength", "diameter")
    hysteresis = hysteresis_of(table.table("hysteresis"))
    for name in hysteresis:
        if name not in names:
            where = "axis in the hysteresis of the device"
            raise CableError.unknown(where, name, names)
    return Description(
        scene=scene,
        meaning=keys.text("meaning", "") or f"device of {Path(scene).name}",
        axes=tuple(axes),
        movers=movers,
        sensing=_sensing(table.table("sensors"), found, keys),
        trajectory=keys.text("trajectory", "") or "sine",
        strength=rope.number("strength", math.nan),
        diameter=rope.number("diameter", math.nan, low=1e-6, high=0.1),
        period=_period(keys, float(spec.option.timestep), scene),
        sources=keys.sources,
        hysteresis=hysteresis,
    )


def _warn(sentence: str) -> None:
    warnings.warn(sentence, CableWarning, stacklevel=3)


def _names_of(elements: Iterable[Any]) -> list[str]:
    return [element.name for element in elements if element.name]


def _hold_root(spec: mujoco.MjSpec, keys: Keys) -> None:
    """Delete free joints and keyframes, unless the description has `root = "free"`."""
    choice = keys.table.choice("root", ("held", "free"))
    free = [j for j in spec.joints if j.type == mujoco.mjtJoint.mjJNT_FREE]
    if not free or keys.given("root", choice, "held") == "free":
        return
    if choice is None:
        _warn(
            f"device {keys.table.where}: the body on free joint {free[0].name!r} is "
            'held where it is; root = "free" or "held" in the description says which.'
        )
    # Episodes begin in the neutral pose; keyframes count the coordinates of the root.
    for element in [*spec.keys, *free]:
        spec.delete(element)


def _require_targets(spec: mujoco.MjSpec, scene: str) -> None:
    kinds = {
        mujoco.mjtTrn.mjTRN_JOINT: ("joint", spec.joints),
        mujoco.mjtTrn.mjTRN_TENDON: ("tendon", spec.tendons),
    }
    for actuator in spec.actuators:
        if actuator.plugin.plugin_name != PLUGIN or actuator.trntype not in kinds:
            continue
        kind, elements = kinds[actuator.trntype]
        names = _names_of(elements)
        if actuator.target not in names:
            where = f"{kind} of cable {actuator.plugin.name!r} in scene {scene}"
            raise CableError.unknown(where, str(actuator.target), names)


def _warn_of_degrees(model: mujoco.MjModel, scene: str) -> None:
    """Warn if the range of a hinge exceeds 6 pi rad, which suggests degrees."""
    hinges = (model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE) & (model.jnt_limited != 0)
    plain = model.actuator_biastype == mujoco.mjtBias.mjBIAS_NONE
    for joint in np.flatnonzero(hinges).tolist():
        low, high = model.jnt_range[joint].tolist()
        # A motor that is neither cable nor spring turns a drum, which may go far.
        is_drum = (joint_actuators(model, joint) & plain).any()
        if high - low > 6.0 * math.pi and not is_drum:
            _warn(
                f"scene {scene}: joint {model.joint(joint).name!r} has a range of "
                f"{low:g} to {high:g} rad; if these are degrees, `angle` in <compiler> "
                "must be degree."
            )


def _name_parts(spec: mujoco.MjSpec) -> None:
    """Name the unnamed joints and actuators, so that the device finds them by name."""
    taken = {*_names_of(spec.actuators)}
    for place, joint in enumerate(spec.joints):
        joint.name = joint.name or f"joint_{place}"
    for actuator in spec.actuators:
        if not actuator.name:
            name = f"{actuator.plugin.name or 'actuator'}_{actuator.target}"
            while name in taken:
                name += "_"
            actuator.name = name
            taken.add(name)


def _period(keys: Keys, timestep: float, scene: str) -> float:
    """Return the control period [s]; warn if its default cannot be 1 ms."""
    steps = max(round(PERIOD / timestep), 1)
    fits = abs(steps * timestep - PERIOD) < 1e-9
    default = PERIOD if fits else steps * timestep
    if not fits and "period" not in keys.table.content:
        _warn(
            f"device {scene}: a time step of {1e3 * timestep:g} ms makes a control "
            f"period of {1e3 * default:g} ms instead of 1 ms; `timestep` in <option> "
            "or `period` in the description sets it."
        )
    return keys.number("period", default, low=1e-6)


def _ends(arms: Arms, cables: Mapping[str, Cable]) -> dict[str, tuple[_End, _End]]:
    model, used, found = arms.model, instances(arms.model), {}
    for name in cables:
        if name not in used:
            raise CableError(
                f"cable {name!r} is used by no actuator; it must be used by two, first "
                "the proximal and then the distal end."
            )
        ends = []
        for actuator in np.flatnonzero(model.actuator_plugin == used[name]).tolist():
            out = int(model.actuator_outadr[actuator])
            row = arms.most[out]
            moved = np.flatnonzero(row > 1e-9 * max(float(row.max()), 1e-12))
            joints = tuple(dict.fromkeys(model.dof_jntid[moved].tolist()))
            ends.append(_End(actuator, out, joints))
        found[name] = (ends[0], ends[1])
    return found


def _axis_tables(table: Table, motors: Iterable[str]) -> dict[str, Table]:
    given, names = table.content.get("axis", []), list(motors)
    several = isinstance(given, list)
    tables: dict[str, Table] = {}
    for place, content in enumerate(given if several else [given]):
        where = f"[[axis]] {place + 1}" if several else "[axis]"
        if not isinstance(content, dict):
            raise table.wrong("axis", "a table, written as [axis] or [[axis]]")
        own = Table(f"{table.where}, {where}", content)
        own.only(*KEYS["axis"])
        motor = own.text("motor")
        if motor is None and len(names) > 1:
            raise CableError(f"{own.where} needs `motor`, one of {', '.join(names)}.")
        motor = names[0] if motor is None else motor
        if motor not in names:
            raise CableError.unknown("motor", motor, names, own.where)
        if motor in tables:
            raise CableError(
                f"{own.where} describes motor {motor!r} a second time; an axis "
                "has one table."
            )
        tables[motor] = own
    return tables


def _axes(scene: _Scene, file: Table) -> list[_Found]:
    model = scene.model
    wound: dict[str, list[str]] = {}
    for name, (proximal, _) in scene.ends.items():
        motors = np.flatnonzero(joint_actuators(model, proximal.joints)).tolist()
        if motors:
            wound.setdefault(model.actuator(motors[0]).name, []).append(name)
    if not wound:
        first, (proximal, _) = next(iter(scene.ends.items()))
        held = [model.joint(joint).name for joint in proximal.joints]
        where = f"joint {held[0]!r}" if held else "a joint"
        raise CableError(
            f"no motor winds a cable of scene {scene.name}: give {where}, which moves "
            f"the proximal end of cable {first!r}, an actuator <motor> with a "
            "`ctrlrange`."
        )
    # The order of the file, then that of the scene.
    tables = _axis_tables(file, wound)
    for name in wound:
        tables.setdefault(name, Table(f"scene {scene.name}, motor {name!r}", {}))
    found = [_axis(scene, name, wound[name], own) for name, own in tables.items()]
    found = _separated(found, scene.cables)
    names = [one.axis.name for one in found]
    for twice in names:
        if names.count(twice) > 1:
            raise CableError(
                f"scene {scene.name} has two axes of the name {twice!r}; give each a "
                "`name` in [[axis]]."
            )
    return found


def _separated(found: list[_Found], cables: Mapping[str, Cable]) -> list[_Found]:
    """Return the axes; by default name those that share a joint after their motors."""
    joints = [one.axis.joint for one in found]
    named = []
    for one in found:
        axis = one.axis
        if joints.count(axis.joint) > 1:
            for name in axis.cables:
                if cables[name].path != PATHS[0]:
                    raise CableError(
                        f"several motors drive joint {axis.joint!r}, and cable "
                        f"{name!r} of motor {axis.motor!r} has path = "
                        f"{cables[name].path!r}: what each motor contributes is known "
                        "of guided cables only; lead that cable in a conduit."
                    )
            if one.keys.table.text("name") is None:
                axis = dataclasses.replace(axis, name=axis.motor)
        named.append(one._replace(axis=axis))
    return named


def _axis(scene: _Scene, name: str, wound: Sequence[str], table: Table) -> _Found:
    model, ends, keys = scene.model, scene.ends, Keys(table, {}, "axis.")
    motor = int(model.actuator(name).id)
    drum = int(model.actuator_trnid[motor, 0])
    _require_hinge(model, drum, f"motor {name!r} turns")
    torque = _torque_limit(scene, motor, keys)
    joint = _driven_joint(scene, wound, drum, keys)
    moved = model.joint(joint).name
    _require_hinge(model, joint, f"motor {name!r} drives")
    own = [n for n in wound if joint in ends[n][1].joints]
    drums, joints = (
        {n: float(scene.arms.neutral[ends[n][side].out, dof]) for n in own}
        for side, dof in enumerate(model.jnt_dofadr[[drum, joint]].tolist())
    )
    proximal, distal = drums[own[0]], joints[own[0]]
    if not proximal or not distal:
        raise CableError(
            f"cable {own[0]!r} has no lever arm at joint {moved!r} in the pose `qpos0`;"
            " give the scene a neutral pose in which it pulls."
        )
    largest = torque * abs(distal / proximal)
    one_way = len({arm < 0.0 for arm in drums.values()}) == 1
    # Two cables that turn the joint the same way hold each other taut.
    against = [n for n in own if joints[n] * drums[n] * distal * proximal < 0.0]
    if against:
        _warn(
            f"motor {name!r} turns joint {moved!r} one way by cable {own[0]!r} and the "
            f"other way by cable {against[0]!r}, so that they only pull against each "
            "other; one of their gears has the wrong sign."
        )
    pull_pull = len(own) == 2 and not (one_way or against)
    centre, reach = excursion(model, joint, table.number("reach", 1e-3))
    reach = keys.number("reach", reach, SCENE, low=1e-3, high=2.0 * math.pi)
    centre = keys.number("centre", centre, SCENE, low=-math.inf)
    _warn_of_dead_centre(scene, own[0], joint, centre, reach)
    # A cable pulls its joint against its own arm.
    way = -math.copysign(1.0, distal) if one_way else 1.0
    demanded = rounded(0.2 * largest)
    cables = {n: scene.cables[n] for n in own}
    friction = max(cable.friction * cable.wrap for cable in cables.values())
    rest = sum(abs(joints[n]) * cable.pretension for n, cable in cables.items())
    slip = Slip(friction, rest if pull_pull else 0.0)
    observation = Keys(table.table("observation"), keys.sources, "axis.observation.")
    units = _units(observation, reach, largest, demanded)
    axis = Axis(
        name=table.text("name") or moved,
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
        task=keys.text("task", "") or f"hold:{way * demanded:g}",
        safe_torque=keys.number("safe_torque", slip.safe_torque(demanded), low=1e-9),
        safe_is_assumed=table.number("safe_torque", 1e-9) is None,
        slip=slip,
        safe_speed=keys.number("safe_speed", math.inf, low=1e-9),
        safe_power=keys.number("safe_power", math.inf, low=1e-9),
        motor_pulley=keys.number("motor_pulley", 0.0),
        gearing=keys.given("gearing", table.number("gearing", 1e-9), None),
        joint_pulley=keys.number("joint_pulley", 0.0),
        lever=_lever(scene, ends[own[0]][1], joint, keys),
    )
    return _Found(axis, keys, largest, abs(distal))


def _warn_of_dead_centre(
    scene: _Scene, cable: str, joint: int, centre: float, reach: float
) -> None:
    """Warn if a cable's moment arm nearly vanishes within `centre` +- `reach` [rad]."""
    model, out = scene.model, scene.ends[cable][1].out
    angles = np.linspace(centre - reach, centre + reach, 9)
    poses = np.repeat(model.qpos0[None], len(angles), axis=0)
    poses[:, model.jnt_qposadr[joint]] = angles
    found = moments(model, mujoco.MjData(model), list(poses))
    arms = found[:, out, model.jnt_dofadr[joint]]
    arms = arms * math.copysign(1.0, float(arms.sum()))
    least, most = int(arms.argmin()), float(np.abs(arms).max())
    if arms[least] < 0.15 * most:
        _warn(
            f"cable {cable!r} hardly turns joint {model.joint(joint).name!r} at "
            f"{angles[least]:.3g} rad, where its arm is {1e3 * arms[least]:.2g} mm of "
            f"{1e3 * most:.2g} mm at most; `reach` and `centre` in [axis] set where "
            "named trajectories go."
        )


def _require_hinge(model: mujoco.MjModel, joint: int, what: str) -> None:
    if model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_HINGE:
        raise CableError(
            f"joint {model.joint(joint).name!r}, which {what}, must be a hinge."
        )


def _torque_limit(scene: _Scene, motor: int, keys: Keys) -> float:
    """Return a motor's largest torque [N m]; write one from the file to the scene."""
    model = scene.model
    name, gain = model.actuator(motor).name, float(model.actuator_gainprm[motor, 0])
    gear = float(model.actuator_gear[motor, 0])
    if gear == 0.0:
        raise CableError(f"motor {name!r} has `gear` 0, by which it turns nothing.")
    given = keys.table.number("torque", 1e-9)
    if model.actuator_gaintype[motor] == mujoco.mjtGain.mjGAIN_DCMOTOR:
        return _make_motor(scene, motor, keys.given("torque", given, None, SCENE))
    has_bias = model.actuator_biastype[motor] != mujoco.mjtBias.mjBIAS_NONE
    if (
        model.actuator_gaintype[motor] != mujoco.mjtGain.mjGAIN_FIXED
        or int(model.actuator_dyntype[motor])
        not in (mujoco.mjtDyn.mjDYN_NONE.value, *FILTERS)
        or (has_bias and np.any(model.actuator_biasprm[motor]))
    ):
        raise CableError(
            f"actuator {name!r} is no source of torque: controllers command the torque "
            "of a motor; make it a <motor> with `ctrlrange` or `forcerange`."
        )
    assumed = MotorLimits.of(model, motor).torque
    torque = float(keys.given("torque", given, assumed, SCENE))
    if given is not None:
        limit = given / abs(gain * gear)
        scene.spec.actuator(name).ctrlrange = [-limit, limit]
    if not math.isfinite(torque):
        raise CableError(
            f"motor {name!r} has no limit: give it a `ctrlrange`, or write its largest "
            "torque as `torque` in [axis]."
        )
    return torque


def _make_motor(scene: _Scene, motor: int, torque: float | None) -> float:
    """Turn a `<dcmotor>` of the scene into a `<motor>`; return its torque limit [N m].

    By default that is its stall torque at the smaller end of its voltage `ctrlrange`.
    """
    model = scene.model
    name, gear = model.actuator(motor).name, abs(float(model.actuator_gear[motor, 0]))
    if torque is None:
        if not model.actuator_ctrllimited[motor]:
            raise CableError(
                f"dcmotor {name!r} has no largest voltage: give it a `ctrlrange` [V], "
                "or write its largest torque as `torque` in [axis]."
            )
        low, high = model.actuator_ctrlrange[motor].tolist()
        if not low < 0.0 < high:
            raise CableError(
                f"the `ctrlrange` of dcmotor {name!r} goes from {low:g} to {high:g} V; "
                "it must go from below 0 to above 0."
            )
        resistance, constant = model.actuator_gainprm[motor, :2].tolist()
        torque = min(-low, high) * constant / resistance * gear
    _warn(
        f"dcmotor {name!r} becomes a motor of {torque:.3g} N m at every speed: its "
        "amplifier is taken to control the current, and its voltage, cogging and "
        "friction are left out."
    )
    actuator = scene.spec.actuator(name)
    actuator.set_to_motor()
    actuator.ctrllimited = True
    actuator.ctrlrange = [-torque / gear, torque / gear]
    return torque


def _driven_joint(scene: _Scene, wound: Sequence[str], drum: int, keys: Keys) -> int:
    model = scene.model
    ends = [scene.ends[name][1] for name in wound]
    moved = [joint for end in ends for joint in end.joints if joint != drum]
    joints = {model.joint(joint).name: joint for joint in moved}
    if not joints:
        raise CableError(
            f"cable {wound[0]!r} moves no joint: attach its distal end to a joint, or "
            "to a tendon that crosses one."
        )
    given = keys.table.text("joint")
    if given is not None and given not in joints:
        raise CableError.unknown("joint", given, joints, keys.table.where)
    # Of several, the one with the longest arm.
    row = scene.arms.mean[ends[0].out]
    longest = max(joints, key=lambda name: float(row[model.jnt_dofadr[joints[name]]]))
    origin = SCENE if len(joints) == 1 else ASSUMED
    return joints[keys.given("joint", given, longest, origin)]


def excursion(
    model: mujoco.MjModel, joint: int, given: float | None = None
) -> tuple[float, float]:
    """Return centre and amplitude of the built-in trajectories at a joint [rad].

    The centre is the neutral angle or, if that is near a stop, the middle of the range.
    `given` is the amplitude of the description [rad], used if the range has room for
    it.
    """
    neutral = float(model.qpos0[model.jnt_qposadr[joint]])
    if not model.jnt_limited[joint]:
        return neutral, 0.5  # without stops [rad]
    low, high = model.jnt_range[joint].tolist()
    if given is not None and low <= neutral - given and neutral + given <= high:
        return neutral, given
    span = high - low
    low, high = low + 0.1 * span, high - 0.1 * span  # a margin from either stop
    if min(high - neutral, neutral - low) < 0.25 * span:
        neutral = 0.5 * (low + high)
    reach = min(high - neutral, neutral - low)
    return rounded(neutral, 6), rounded(min(reach, 1.0), 3)


def _units(
    keys: Keys, reach: float, largest: float, demanded: float
) -> dict[str, float]:
    """Return each observed column's scale, by reach, largest and usual torque."""
    keys.table.only(*UNITS, "phase")
    # Usual sizes of a motion within `reach`: observations of a policy are about 1.
    defaults = {
        "twist": rounded(0.2 * reach),
        "motor_velocity": 2.0,  # rad/s
        "joint_angle": rounded(0.5 * reach),
        "joint_velocity": 2.0,  # rad/s
        "torque_error": rounded(0.05 * largest),
        "desired_torque": demanded,
    }
    units = {UNITS[key]: keys.number(key, v, low=1e-9) for key, v in defaults.items()}
    phase = keys.given("phase", keys.table.flag("phase"), False)
    return units | {"phase_sine": 1.0, "phase_cosine": 1.0} if phase else units


def _lever(scene: _Scene, end: _End, joint: int, keys: Keys) -> tuple[str, ...]:
    """Return the sites that move with a lever; () for a pulley or an open path."""
    spec, model = scene.spec, scene.model
    given = keys.given("lever", keys.table.content.get("lever"), None, SCENE)
    if given is not None:
        listed = given if isinstance(given, list) else [given]
        for site in listed:
            if not isinstance(site, str) or spec.site(site) is None:
                where = f"site in {keys.table.where}, lever"
                raise CableError.unknown(where, str(site), _names_of(spec.sites))
        return tuple(listed)
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


def _sensing(table: Table, found: Sequence[_Found], file: Keys) -> Sensing:
    """Return the sensors as in the file.

    Default noise is 0.2 % of the weakest axis's largest torque [N m] and tension [N].
    """
    names = [field.name for field in dataclasses.fields(Sensing)]
    table.only(*names)
    keys = Keys(table, file.sources, "sensors.")
    torque = min(one.largest for one in found)
    tension = min(one.largest / one.arm for one in found)
    values: dict[str, Any] = {
        "torque_noise": rounded(0.002 * torque),
        "tension_noise": rounded(0.002 * tension),
    }
    for name in names:
        read = table.flag if name == "joint_sensor" else partial(table.number, low=0.0)
        given: Any = keys.given(name, read(name), None)
        if given is not None:
            values[name] = given
    if "delay" in table.content:
        if not values["delay"].is_integer():
            raise table.wrong("delay", "a whole number of control steps")
        values["delay"] = int(values["delay"])
    return Sensing(**values)


def known_torque_noise(description: Description) -> float:
    """Return the noise of the joint torque sensor [N m]; 0 if it is only assumed."""
    assumed = description.sources.get("sensors.torque_noise") == ASSUMED
    return 0.0 if assumed else description.sensing.torque_noise


def _movers(scene: _Scene, axes: Sequence[Axis], keys: Keys) -> dict[str, str]:
    """Return the wearer's actuators by joint; add to the scene those it lacks."""
    spec, model = scene.spec, scene.model
    driven = [axis.joint for axis in axes]
    hinges = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE).tolist()
    names = [*driven, *(model.joint(hinge).name for hinge in hinges)]
    drums = {axis.drum for axis in axes} - {*driven}
    joints = [name for name in dict.fromkeys(names) if name not in drums]
    wearers = keys.table.tables("wearer")
    for joint, own in wearers.items():
        own.only(*KEYS["wearer"])
        if joint not in ("*", *joints):
            raise CableError.unknown(f"joint of the body in {own.where}", joint, joints)
    every = wearers.get("*")  # of every joint that nothing else moves
    found: dict[str, str] = {}
    for joint in joints:
        one, label = wearers.get(joint), f"wearer.{joint}"
        existing = _springs(model, joint)
        if one is None and existing:
            found[joint], keys.sources[label] = existing[0], SCENE
            continue
        if one is None and joint in driven and _is_moved(scene.arms, joint):
            keys.sources[label] = SCENE
            continue  # muscles or other actuators move the body by themselves
        if one is None and joint not in driven and every is None:
            continue
        one = one or every or Table(label, {})
        keys.given(label, one.content or None, None)
        if one.content.get("none", False):
            if len(one.content) > 1:
                raise CableError(
                    f"{one.where}: with `none` nothing else goes, as nobody moves "
                    "that joint."
                )
            continue
        name = one.text("actuator")
        if name is not None and name not in existing:
            where = f"actuator in {one.where} (a position actuator at that joint)"
            raise CableError.unknown(where, name, existing)
        name = name or next(iter(existing), "")
        stiffness, damping = one.number("stiffness", 1e-6), one.number("damping", 0)
        if not name:
            inertia = float(model.dof_M0[model.joint(joint).dofadr[0]])
            # Assumed: 25 rad/s, and a damping ratio of 0.7.
            if stiffness is None:
                stiffness = rounded(inertia * 25.0**2)
            if damping is None:
                damping = rounded(2.0 * 0.7 * math.sqrt(inertia * stiffness))
            name = f"wearer_{joint}"
            added = add_element(spec, "actuator", name=name, target=joint)
            added.trntype = mujoco.mjtTrn.mjTRN_JOINT
            added.gaintype = mujoco.mjtGain.mjGAIN_FIXED
            added.biastype = mujoco.mjtBias.mjBIAS_AFFINE
            added.gainprm[0] = stiffness
            added.biasprm[:3] = (0.0, -stiffness, -damping)
        elif stiffness is not None or damping is not None:
            mover = Mover.of(model, name)
            given = {"stiffness": stiffness, "damping": damping}
            known = {key: value for key, value in given.items() if value is not None}
            wearer = dataclasses.replace(mover.wearer, **known)
            mover.impose(spec.actuator(name), wearer)
        found[joint] = name
    return found


def _springs(model: mujoco.MjModel, joint: str) -> list[str]:
    """Return the position actuators at a joint that have no activation dynamics."""
    springs = (
        joint_actuators(model, model.joint(joint).id)
        & (model.actuator_gaintype == mujoco.mjtGain.mjGAIN_FIXED)
        & (model.actuator_biastype == mujoco.mjtBias.mjBIAS_AFFINE)
        & (model.actuator_biasprm[:, 1] < 0.0)
        & (model.actuator_gainprm[:, 0] != 0.0)
        & (model.actuator_dyntype == mujoco.mjtDyn.mjDYN_NONE)
    )
    return [model.actuator(place).name for place in np.flatnonzero(springs).tolist()]


def _is_moved(arms: Arms, joint: str) -> bool:
    """Return whether actuators on tendons or sites, other than cables, move a joint."""
    model = arms.model
    others = model.actuator_trntype != mujoco.mjtTrn.mjTRN_JOINT
    reach = arms.most[model.actuator_outadr, model.joint(joint).dofadr[0]]
    return bool((others & (model.actuator_plugin < 0) & (reach > 1e-9)).any())


def _with_cuff(scene: _Scene, found: _Found) -> Axis:
    """Attach the cables of an axis with a cuff to a frame that is strapped to the limb.

    The scene gets the frame's body and hinge, and a tendon as the strap, with the
    `stiffness`, `damping` and `inertia` of the description. The axis that is returned
    has the frame's joint. A cable that wraps around the limb itself is refused.
    """
    spec, model, axis = scene.spec, scene.model, found.axis
    if "cuff" not in found.keys.table.content:
        return axis
    table = found.keys.table.table("cuff")
    table.only("stiffness", "damping", "inertia")
    stiffness = table.number("stiffness", 1e-6)
    if stiffness is None:
        raise CableError(f"{table.where} needs `stiffness`, in N m/rad.")
    damping = table.number("damping", 0.0) or 0.0
    inertia = table.number("inertia", 1e-9)
    joint = model.joint(axis.joint)
    if inertia is None:
        inertia = 0.05 * float(model.dof_M0[joint.dofadr[0]])
    limb = model.body(int(model.jnt_bodyid[joint.id]))
    parent = spec.body(model.body(int(limb.parentid[0])).name)
    if model.body_jntnum[limb.id] != 1 or parent is None:
        raise CableError(
            f"{table.where}: joint {axis.joint!r} must be the only one of its body."
        )
    name = f"{axis.joint}_frame"
    if spec.body(name) is not None:
        raise CableError(
            f"{table.where}: the scene has a body {name!r} already, as of the cuff of "
            "another motor at that joint; a joint takes one cuff."
        )
    frame = parent.add_body(name=name, pos=limb.pos, quat=limb.quat)
    frame.explicitinertial = True
    # The hinge's armature is the inertia about the axis; MuJoCo needs a mass.
    frame.mass, frame.inertia = 1e-6, [1e-9, 1e-9, 1e-9]
    hinge = add_element(frame, "joint", name=name, armature=inertia)
    hinge.type = mujoco.mjtJoint.mjJNT_HINGE
    hinge.pos, hinge.axis = model.jnt_pos[joint.id], model.jnt_axis[joint.id]
    hinge.ref = float(model.qpos0[joint.qposadr[0]])
    _move_ends(spec, axis, limb.name, frame, table)
    tendon = f"{axis.joint}_cuff"
    strap = add_element(spec, "tendon", name=tendon)
    strap.wrap_joint(name, 1.0)
    strap.wrap_joint(axis.joint, -1.0)
    strap.stiffness[0], strap.damping[0] = stiffness, damping
    strap.springlength = [0.0, 0.0]
    cuff = Cuff(stiffness, damping, inertia, tendon)
    return dataclasses.replace(axis, joint=name, cuff=cuff)


def _move_ends(
    spec: mujoco.MjSpec, axis: Axis, limb: str, frame: mujoco.MjsBody, table: Table
) -> None:
    """Move the ends of an axis's cables from the limb's joint and sites to `frame`."""
    tendons = set()
    for actuator in spec.actuators:
        if actuator.plugin.name not in axis.cables:
            continue
        if actuator.target == axis.joint:
            actuator.target = frame.name
        elif actuator.trntype == mujoco.mjtTrn.mjTRN_TENDON:
            tendons.add(actuator.target)
    moved: set[str] = set()
    for name in tendons:
        for wrap in spec.tendon(name).path:
            if wrap.target is None or wrap.target.parent.name != limb:
                continue
            if wrap.type != mujoco.mjtWrap.mjWRAP_SITE:
                raise CableError(
                    f"{table.where}: tendon {name!r} wraps around geom "
                    f"{wrap.target.name!r} of the limb; a cuff needs a frame that the "
                    "scene has itself."
                )
            moved.add(wrap.target.name)
    for name in moved:
        old = spec.site(name)
        place = old.pos.copy()
        old.name = f"{name}_limb"
        add_element(frame, "site", name=name, pos=place, size=old.size, group=old.group)
