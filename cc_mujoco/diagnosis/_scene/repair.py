"""Scene with the identified effects, as plain MJCF, and motions played through it.

    spec = repair_scene(bench, cables, {"backlash": {"backlash": 0.02}})
    write("scene.xml", spec)
    motor_torque, joint_torque = rollout("scene.xml", time, motor_angle, joint_angle)

The given cables contain the changes by effects; everything else is realised by
`realisation`. The file loads wherever `cc_mujoco` is imported; a comment at its top
names effects and values. In a rollout both joints follow the given angles, whatever
acts on them; MuJoCo simulates cables, actuators, tendons and sensors. So a rollout of
the written scene can be compared with a replay of the fitted model.
"""

import math
import os
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np
from mujoco import MjData, MjModel, MjSpec, mjtObj
from numpy.typing import ArrayLike

from cc_mujoco._utils.atomic_io import replacing
from cc_mujoco.cable import Cable
from cc_mujoco.datasets._bench import Bench, driven_joint
from cc_mujoco.datasets._channels import ANGLES, TORQUES
from cc_mujoco.diagnosis._rig.records import LEAD_SAMPLES, with_lead_in
from cc_mujoco.diagnosis._scene import realisation
from cc_mujoco.diagnosis._scene.realisation import Values
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis.effects import EFFECTS
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray
from cc_mujoco.plugin import settle, step_limits, to_mjcf
from cc_mujoco.plugin._mjcf import instances
from cc_mujoco.plugin._spec import compile_spec, read_spec
from cc_mujoco.report._html import list_words


def repair_scene(
    bench: Bench,
    cables: Sequence[Cable],
    effects: Mapping[str, Values],
    left_out: Mapping[str, Values] | None = None,
) -> MjSpec:
    """Return the scene of a bench with its radii as gears, new cables and effects.

    `effects` are parameters by id. `cables` already contain the effects that act in
    them. These, and `left_out`, which the scene cannot have, are only named in the
    comment of the file.

    Raises:
        CableError: another number of cables, a value that is missing, unknown or not
            finite, or a scene that cannot have the effect.
    """
    if len(cables) != len(bench.cables):
        raise CableError(
            f"the scene {bench.path} has {len(bench.cables)} cables, got {len(cables)}"
        )
    beyond = [name for name in effects if not realisation.is_realisable(bench, name)]
    if beyond:
        raise CableError(
            f"the scene {bench.path} cannot have {', '.join(beyond)}: "
            f"{realisation.unrealisable_reason(bench, beyond[0])}; take the values "
            "from verdict.json"
        )
    table = realisation.realisations()
    in_cables = [name for name in effects if name not in table]
    if in_cables and tuple(cables) == bench.cables:
        raise CableError(
            f"effects {', '.join(in_cables)} act in the cables, but the cables are "
            "those of the scene; give changed ones"
        )
    bench = replace(bench, cables=tuple(cables))
    spec = read_spec(bench.path)
    for name, cable, sign in zip(bench.names, cables, (-1.0, 1.0), strict=False):
        proximal = (bench.motor, sign * bench.motor_radius)
        distal = (bench.joint, sign * bench.joint_radius)
        to_mjcf(spec, name, cable, proximal, None if bench.lever else distal)
    if bench.lever is not None and not bench.tied:
        (_, end) = [a for a in spec.actuators if a.plugin.name == bench.names[0]]
        end.gear[0] *= bench.joint_radius / bench.drawn_radius
    try:
        # A divisor of the scene's own step, so that a control period stays a multiple.
        own, largest = spec.option.timestep, _largest_step(spec, bench)
        spec.option.timestep = own / max(math.ceil(own / largest), 1)
        if bench.lever is None:
            realisation.add_instruments(spec, bench)
        for name, entry in table.items():
            if name in effects:
                _check(name, entry.parameters, effects[name])
                if any(effects[name][key] != 0.0 for key in entry.parameters):
                    entry.apply(spec, bench, effects[name])
        spec.comment = _comment(bench, effects, left_out or {})
        spec.compile()
    except CableError:
        raise
    except ValueError as error:
        reason = str(error).strip().splitlines()[0]
        additions = ", ".join(["sensors", *effects])
        raise CableError(
            f"scene {bench.path} cannot have what is added ({additions}): {reason}"
        ) from None
    return spec


def existing_effects(scene: str | os.PathLike[str]) -> tuple[str, ...]:
    """Return the effects outside the cables that an earlier diagnosis has added."""
    named = re.findall(r"^ {4}(\w+): ", read_spec(scene).comment, re.MULTILINE)
    able = realisation.REALISATIONS
    keyed = {n for n, e in EFFECTS.items() if n not in able and e.edit_spec is None}
    return tuple(name for name in named if name not in keyed)


def write(path: str | os.PathLike[str], spec: MjSpec) -> None:
    """Write a scene atomically, so that it loads from any folder.

    Raises:
        CableError: the scene is incomplete, or the file would not load again.
    """
    with replacing(path) as partial:
        try:
            spec.compile()
            partial.write_text(_text(spec), encoding="utf-8")
            MjModel.from_xml_path(str(partial))
        except ValueError as error:
            reason = str(error).strip().splitlines()[0]
            raise CableError(f"scene {path} cannot be written: {reason}") from None


def _text(spec: MjSpec) -> str:
    """Return the MJCF of a compiled scene, with paths that load from any folder."""
    origin = Path(spec.modelfiledir).absolute()
    before = spec.meshdir, spec.texturedir
    if any(asset.file for asset in [*spec.meshes, *spec.hfields, *spec.skins]):
        spec.meshdir = str(origin / spec.meshdir)
    if any(texture.file or any(texture.cubefiles) for texture in spec.textures):
        spec.texturedir = str(origin / spec.texturedir)
    try:
        return str(spec.to_xml())
    finally:
        spec.meshdir, spec.texturedir = before


def _largest_step(spec: MjSpec, bench: Bench) -> float:
    """Return half the time step at which the cables' ends become unstable [s]."""
    model = spec.compile()
    if bench.tied:  # its pieces are the springs
        found = step_limits(model, MjData(model))
        return 0.5 * min(min(found[name]) for name in bench.names)
    pulleys = (bench.motor, bench.motor_radius), (bench.joint, bench.joint_radius)
    limits = []
    for joint, radius in pulleys:
        inertia = model.dof_M0[model.joint(joint).dofadr[0]]
        stiffness = realisation.rim_stiffness(bench, radius)
        limits.append(2.0 * math.sqrt(inertia / stiffness))
    return 0.5 * min(limits)


def _check(name: str, parameters: Sequence[str], values: Values) -> None:
    for given in values:
        if given not in (*parameters, "joint_angle_offset"):
            raise CableError.unknown(f"parameter of {name}", given, parameters)
    for wanted in parameters:
        if wanted not in values:
            raise CableError(f"effect {name} needs a value for `{wanted}`")
        if not math.isfinite(values[wanted]):
            raise CableError(f"effect {name}: `{wanted}` is not finite")


def _comment(
    bench: Bench, effects: Mapping[str, Values], left_out: Mapping[str, Values]
) -> str:
    lines, table = [], realisation.realisations()
    for name, values in {**effects, **left_out}.items():
        written = ", ".join(f"{key} {value:.6g}" for key, value in values.items())
        how = table[name].note if name in table else "keys of the cable plugin"
        lines.append(
            f"    {name}: {written} ({how})"
            if name in effects
            else f"    not in this scene, {name}: {written}"
        )
    head = f" {bench.path.name}, sha256 {bench.sha256[:16]}, refitted"
    return ";\n".join([head, *lines]).replace("--", "- -") + " "


def require_repairable(bench: Bench) -> None:
    """Require that the scene can be repaired, or say what to change in it."""
    spec = read_spec(bench.path)
    _check_settings(spec, bench)
    typical = {p.name: p.typical for e in EFFECTS.values() for p in e.parameters}
    everything = {  # offsets have no entry in the library
        name: {key: typical.get(key, 0.01) for key in entry.parameters}
        for name, entry in realisation.realisations().items()
        if realisation.is_realisable(bench, name)
    }
    try:
        plain, full = (repair_scene(bench, bench.cables, e) for e in ({}, everything))
    except CableError as error:
        taken = re.search(r"repeated name '(.+)' in (\w+)", str(error))
        if taken is None:
            raise
        raise CableError(
            f"scene {bench.path} has {taken[2]} {taken[1]!r}, and a repaired scene may "
            "need that name for its own; rename it"
        ) from None
    with TemporaryDirectory() as folder:
        try:
            write(Path(folder) / "scene.xml", full)
        except CableError as error:
            reason = str(error).partition("cannot be written: ")[2]
            raise CableError(
                f"scene {bench.path} would not load again once it is written: {reason}"
            ) from None
    # The cable of a lever is interpolated in its file.
    _rehearse_motion(bench.path if bench.lever else plain, plain.option.timestep, bench)


def _check_settings(spec: MjSpec, bench: Bench) -> None:
    # Parts of MuJoCo that cables, instruments or effects are made of.
    flags = "actuation constraint damper limit sensor spring".split()
    bits = (getattr(mujoco.mjtDisableBit, f"mjDSBL_{f.upper()}") for f in flags)
    pairs = zip(flags, bits, strict=True)
    off = [flag for flag, bit in pairs if spec.option.disableflags & int(bit)]
    if off:
        raise CableError(
            f"scene {bench.path} disables {list_words(off)} in <flag>; cables, sensors "
            "and the effects that are added need them enabled"
        )
    for name in ("settotalmass", "boundmass", "boundinertia"):
        if getattr(spec.compiler, name) > 0.0:
            raise CableError(
                f"scene {bench.path} has {name} in <compiler>, which would change the "
                "bodies that effects add; give the bodies their masses instead"
            )


def _rehearse_motion(scene: MjSpec | Path, step: float, bench: Bench) -> None:
    """Require that a short motion in MuJoCo gives the torques of the cables alone."""
    count = min(max(round(0.3 / step), 200), 5000)
    phase = np.linspace(0.0, 4.0 * math.pi, count)
    low, high = bench.span
    swing = min(Limit.rehearsal_swing, 0.45 * (high - low))
    middle = min(max(0.0, low + swing), high - swing)
    joint = middle + swing * np.sin(phase)
    wind_up = 0.1 * Limit.rehearsal_swing * bench.joint_radius / bench.motor_radius
    motor = bench.following(joint) + wind_up * np.sin(1.7 * phase)
    time = step * np.arange(count)
    cables, driven = bench.names, bench.joint
    shown = rollout(scene, time, motor, joint, cables=cables, driven=driven)
    alone = bench.replay(step, motor, joint)
    torques = alone.motor_torque, alone.joint_torque
    for side, torque, own in zip(("motor", "joint"), shown, torques, strict=True):
        difference, most = np.abs(torque - own).max(), np.abs(own).max()
        if not difference <= 1e-3 * most:
            parts = f", and other parts of the <tuple> {side}_torque_nm"
            raise CableError(
                f"scene {bench.path}: played by MuJoCo, {side}_torque_nm differs from "
                f"what its cables do alone by {difference:.2g} N m, with torques of "
                f"{most:.2g} N m; take out of the scene whatever changes the cables' "
                f"forces{'' if bench.lever else parts}"
            )


def rollout(
    scene: str | os.PathLike[str] | MjSpec,
    time: ArrayLike,
    motor_angle: ArrayLike,
    joint_angle: ArrayLike,
    lead_in: float | None = None,
    tilt: float = 0.0,
    cables: Collection[str] | None = None,
    driven: str = "",
    others: Mapping[str, ArrayLike] | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return the torques that the sensors of a scene show along a motion.

    The first sample is at rest in pretension, as in `Transmission.replay`. A recorded
    motion begins elsewhere and needs a `lead_in`, on which the torques depend until the
    whole cable has moved. Time steps are the samples'; they are at most the scene's if
    a joint is free (a pulley with backlash), and at most a sensor's delay. Speeds and
    accelerations are differences of the angles. If sensors delay the angles, the
    returned torques are those that are read together with the given angles.

    Args:
        scene: file, or specification with instruments.
        time: (samples,) evenly spaced [s]; sensors drift with it.
        motor_angle: (samples,) [rad].
        joint_angle: (samples,) [rad]; of a lever positive where the cable pulls.
        lead_in: turns of the motor per turn of the joint (for a lever, of a pulley
            equal to it at angle 0), to come from rest in the pose 0 to the first
            sample, see `records.with_lead_in`; None begins there at rest.
        tilt: angle by which the rig was turned about the joint's axis, positive as the
            joint is, for gravity that a diagnosis found [rad]; no effect on a lever.
        cables: names of the cables to play; others of the scene are left out.
        driven: joint that these drive, where several move them.
        others: (samples,) of other joints that move the cables, by name [rad]; those
            that are not given stay where they are in the scene.

    Returns:
        Torque that the motor puts into its pulley, and torque that the transmission
        puts into the joint, (samples,) each [N m].

    Raises:
        CableError: arrays of unequal length, uneven or not finite, a scene that is no
            bench, or one that does not stay finite.
    """
    clock, angles = _motion(time, motor_angle, joint_angle)
    model, bench = _instrumented_model(scene, cables, driven)
    held = _other_angles(model, bench, others or {}, clock.size)
    if lead_in is not None:
        step = (clock[-1] - clock[0]) / (clock.size - 1)
        before = clock[0] + step * np.arange(-LEAD_SAMPLES, 0)
        turned = np.linspace(0.0, 1.0, Limit.ramp_samples + 1) * angles[1, 0]
        if bench is not None:
            turned = bench.turned(turned)
        if bench is not None and held:
            beside = np.array([held[name] for name in bench.others])
            path = bench.recorded_path(angles[1], beside, Limit.ramp_samples)
            if path is not None:
                turned = bench.along_lead_in(path)
                led = map(path.with_lead_in, path.angles)
                held = dict(zip(path.others, led, strict=True))
        along = lead_in * turned
        angles = np.array(with_lead_in(angles[0], angles[1], lambda _: along, 1))
        clock = np.concatenate([before, clock])
    realisation.tilt_rig(model, tilt)
    view = _Sensors(model) if bench is None else _Forces(model, bench)
    view.joints += tuple(int(model.joint(name).id) for name in held)
    angles = np.array([*angles, *held.values()])
    dt = float(clock[-1] - clock[0]) / (clock.size - 1)
    longest = model.opt.timestep if model.nv > 2 else dt
    # A sensor cannot be late by less than a step.
    wanted = min([longest, *model.sensor_delay[model.sensor_delay > 0.0]])
    substeps = math.ceil(dt / max(wanted, min(dt, model.opt.timestep)) - 1e-6)
    late = view.late
    shown = _play(model, view, clock[0], dt, substeps, angles, math.ceil(late / dt))
    at = np.arange(shown.shape[1]) * dt
    first = 0 if lead_in is None else LEAD_SAMPLES
    motor, joint = (np.interp(at[first : clock.size] + late, at, row) for row in shown)
    return motor, joint


class _Sensors:
    """Sensors of a scene that show the torques of motor and joint."""

    def __init__(self, model: MjModel) -> None:
        sensors = realisation.angle_sensors(model)
        proximal, distal = (model.sensor_objid[sensor] for sensor in sensors)
        # Hinges of motor and joint, and of others that are moved
        self.joints: tuple[int, ...] = (int(proximal), int(distal))
        self.sign = 1.0  # of the joint's angle in the scene over that in the data
        self.late = float(model.sensor_delay[sensors[0]])  # of the shown angles [s]
        self._weights = realisation.torque_weights(model)

    def measure(self, data: MjData) -> FloatArray:
        """Return the motor and joint torque at the last evaluation (2,) [N m]."""
        return np.asarray(self._weights @ data.sensordata)


class _Forces(_Sensors):
    """Torques on motor and lever, computed from forces of a cable without sensors."""

    def __init__(self, model: MjModel, bench: Bench) -> None:
        assert bench.lever is not None
        joints = [model.joint(name) for name in (bench.motor, bench.joint)]
        self.joints = int(joints[0].id), int(joints[1].id)
        self.sign, self.late = bench.lever.sign, 0.0
        self._dofs = [int(joint.dofadr[0]) for joint in joints]
        self._signs = np.array([-1.0, self.sign])
        instance = instances(model)[bench.names[0]]
        ends = np.flatnonzero(model.actuator_plugin == instance)
        # Actuators without input have outputs, too.
        self._ends = model.actuator_outadr[ends]
        self._moment = np.zeros((MjData(model).moment_rownnz.size, model.nv))

    def measure(self, data: MjData) -> FloatArray:
        sparse = data.moment_rownnz, data.moment_rowadr, data.moment_colind
        mujoco.mju_sparse2dense(self._moment, data.actuator_moment, *sparse)
        ends = self._moment[self._ends].T @ data.actuator_force[self._ends]
        others = (
            data.qfrc_spring + data.qfrc_damper + data.qfrc_gravcomp + data.qfrc_fluid
        )
        found: FloatArray = (ends + data.qfrc_passive - others)[self._dofs]
        return self._signs * found


def _play(
    model: MjModel, view: _Sensors, start: float, dt: float, substeps: int,
    angles: FloatArray, more: int,
) -> FloatArray:  # fmt: skip
    """Return torques (2, samples + more) [N m] along angles; the last ones are held."""
    model.opt.timestep = dt / substeps
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    joints = list(view.joints)
    angles = angles * np.array([1.0, view.sign, *(1.0 for _ in joints[2:])])[:, None]
    place, dof = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
    model.dof_armature[dof] += Limit.drive_armature
    # The look-ahead of the cables' ends follows from this state of MuJoCo.
    model.dof_invweight0[dof] /= 1.0 + Limit.drive_armature * model.dof_invweight0[dof]
    # What counts where a joint turns a balanced body.
    model.dof_M0[dof] += Limit.drive_armature
    speed = np.gradient(angles, dt, axis=1)
    force = Limit.drive_armature * np.gradient(speed, dt, axis=1)
    samples = angles.shape[1]
    count = (samples - 1 + more) * substeps + 1
    at = np.arange(count) / substeps  # the last sample is held
    old, signals = np.arange(samples), (angles, speed, force)
    filled = ([np.interp(at, old, row) for row in signal] for signal in signals)
    position, velocity, drive = map(np.column_stack, filled)
    for signal in (velocity, drive):
        signal[(samples - 1) * substeps + 1 :] = 0.0
    data = _laid(model, view, angles[:, 0], start)
    shown = np.empty((2, samples + more))
    qpos, qvel, applied = data.qpos, data.qvel, data.qfrc_applied
    for step in range(count):
        qpos[place] = position[step]
        qvel[dof] = velocity[step]
        applied[dof] = drive[step]
        if step == 0:
            _fill_sensor_history(model, data)
        mujoco.mj_step(model, data)
        if step % substeps == 0:
            shown[:, step // substeps] = view.measure(data)
    if any(warning.number for warning in data.warning) or not np.isfinite(shown).all():
        raise CableError(
            f"the scene does not stay finite along this motion at a step of "
            f"{model.opt.timestep:g} s; reduce its time step"
        )
    return shown


def _laid(model: MjModel, view: _Sensors, angles: FloatArray, start: float) -> MjData:
    """Return data with the joints at these angles [rad] and cables in pretension."""
    motor, joint = view.joints[:2]
    cables = list(instances(model).values())
    ends = np.flatnonzero(np.isin(model.actuator_plugin, cables))
    data = MjData(model)
    hinged = not isinstance(view, _Forces)
    held = ends[model.actuator_trntype[ends] == mujoco.mjtTrn.mjTRN_JOINT]
    others = set(model.actuator_trnid[held, 0].tolist()) - {motor, joint}
    own = model.joint(joint).name
    driven = (t for t in others if driven_joint(model, model.joint(t).name) == own)
    pulleys = list(driven) if hinged else []

    def lay() -> None:
        data.qpos[model.jnt_qposadr[list(view.joints)]] = angles
        for pulley in pulleys:
            # A separate pulley begins in the middle of its play.
            data.qpos[model.jnt_qposadr[pulley]] = angles[1]

    lay()
    mujoco.mj_fwdPosition(model, data)
    # A reset initialises the cables at the initial lengths of the model.
    lengths = model.actuator_outadr[ends]
    model.actuator_length0[lengths] = data.actuator_length[lengths]
    mujoco.mj_resetData(model, data)
    lay()
    if not hinged:
        settle(model, data)
    data.time = start
    return data


def _fill_sensor_history(model: MjModel, data: MjData) -> None:
    """Fill the history of delayed sensors with their present readings."""
    delay, model.sensor_delay[:] = model.sensor_delay.copy(), 0.0
    mujoco.mj_forward(model, data)
    model.sensor_delay[:] = delay
    for sensor in np.flatnonzero(model.sensor_history[:, 0]):
        count, first = int(model.sensor_history[sensor, 0]), model.sensor_adr[sensor]
        seen = data.sensordata[first : first + model.sensor_dim[sensor]]
        times = data.time - model.opt.timestep * np.arange(count, 0, -1.0)
        values = np.tile(seen, (count, 1))
        mujoco.mj_initSensorHistory(model, data, sensor, times, values, 0.0)


def _other_angles(
    model: MjModel, bench: Bench | None, given: Mapping[str, ArrayLike], samples: int
) -> dict[str, FloatArray]:
    """Return the angles (samples,) [rad] of other joints, at `qpos0` if not `given`."""
    names = () if bench is None else bench.others
    if unknown := [name for name in given if name not in names]:
        raise CableError.unknown("joint that moves the cables", unknown[0], names)
    found = {}
    for name in names:
        rest = float(model.qpos0[int(model.joint(name).qposadr[0])])
        angle = np.asarray(given.get(name, np.full(samples, rest)), dtype=np.float64)
        if angle.shape != (samples,) or not np.isfinite(angle).all():
            raise CableError(
                f"the angles of joint {name!r} must be finite and (samples,) = "
                f"({samples},), got {angle.shape}"
            )
        found[name] = angle
    return found


def _delete_strangers(spec: MjSpec, bench: Bench) -> None:
    gone = [a for a in spec.actuators if a.plugin.name in bench.strangers]
    names = {actuator.name for actuator in gone if actuator.name}
    shown = mjtObj.mjOBJ_ACTUATOR
    for sensor in list(spec.sensors):
        if sensor.objtype == shown and sensor.objname in names:
            spec.delete(sensor)
    for actuator in gone:  # and with them the instances of the plugin
        spec.delete(actuator)


def _instrumented_model(
    scene: str | os.PathLike[str] | MjSpec, cables: Collection[str] | None, driven: str
) -> tuple[MjModel, Bench | None]:
    """Return the compiled scene with instruments; the scene itself is not changed.

    A lever has none: then it lacks other axes' cables, and its bench is returned, too.
    """
    if isinstance(scene, MjSpec):
        return scene.copy().compile(), None
    if not os.path.isfile(scene):
        raise CableError(f"scene {scene} is no file; give an MJCF file")
    spec = read_spec(scene)
    bench = None
    if not (all(map(spec.tuple, TORQUES)) and all(map(spec.sensor, ANGLES))):
        bench = Bench.of(os.fspath(scene), cables=cables, driven=driven)
        if bench.lever is not None:
            _delete_strangers(spec, bench)
        else:
            realisation.add_instruments(spec, bench)
            bench = None
    return compile_spec(spec, scene), bench


def _motion(
    time: ArrayLike, motor_angle: ArrayLike, joint_angle: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Return the time (samples,) [s] and both angles (2, samples) [rad], checked."""
    given = time, motor_angle, joint_angle
    clock, motor, joint = (np.asarray(each, dtype=np.float64) for each in given)
    if clock.ndim != 1 or not clock.shape == motor.shape == joint.shape:
        raise CableError(
            f"time, motor_angle and joint_angle have shapes {clock.shape}, "
            f"{motor.shape} and {joint.shape}; all must be (samples,)"
        )
    if clock.size < 3:
        raise CableError(f"a motion of {clock.size} samples; give 3 or more")
    if not np.isfinite([clock, motor, joint]).all():
        raise CableError("time and angles of a motion must be finite")
    steps = np.diff(clock)
    mean = float(steps.mean())
    if not (mean > 0.0 and np.abs(steps - mean).max() <= 1e-3 * mean):
        raise CableError("the samples of a motion must be evenly spaced in time")
    return clock, np.array([motor, joint])
