"""Energy that a controlled joint puts into the hands of a passive wearer.

    limbs = [limb_of(place, inertia_of("wrist")) for place in first_wearers("wrist")]
    found = play("wrist", "stiction", "spring", limbs)
    float(found.held.max())      # [J]

The wearer is a spring and a damper to a reference, with inertia added at the joint; he
moves to one side and then holds still. From then on only the device does work. What it
puts into the joint, less what the virtual spring gives back, is energy that a passive
device does not have. The sensors are those of the device, with noise and delay. Of a
device with several axes one is tested, while the others rest.
"""

import copy
import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from cc_mujoco._utils.provenance import POLICY_ENDING
from cc_mujoco.control import AxesController, Controller, axes_controller, controller
from cc_mujoco.control._registry import Unpowered, is_decoupled
from cc_mujoco.device import UNPLUGGED, Axis, Device, DeviceModel, Plant, find_device
from cc_mujoco.device._drive import Drive
from cc_mujoco.device._sensors import AxesMeasuring, Measuring
from cc_mujoco.human import Spring, Task, Transparent, Wearer
from cc_mujoco.human._motion import Motion, Trajectory, minimum_jerk
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.native import _library as native_library
from cc_mujoco.simulation._batch import Batch
from cc_mujoco.simulation._worn_device import WornDevice

MOVE_TIME, SETTLE_TIME, EPISODE_TIME = 0.4, 0.6, 2.0
"""Time of the move, of its transient, and of all with the measurement [s]."""

LIMB_RANGES = {
    "wrist": (0.2, 30.0, 0.04),
    "ankle": (5.0, 500.0, 0.06),
    "finger": (0.05, 5.0, 3e-4),
    "exosuit.hip": (10.0, 500.0, 1.6),
    "exosuit.ankle": (5.0, 500.0, 0.06),
}
"""Least and greatest stiffness of the limb at the joint [N m/rad], and greatest inertia
that is added there [kg m^2], by device, or `DEVICE.AXIS` of several axes.

Stiffness: from a limb that hangs loose to one that is braced as hard as can be, meant
to be wider than what was measured. Wrist: at rest, D. Formica et al., J. Neurophysiol.
108, 2012, and while it grips, V. Falzarano et al., Front. Hum. Neurosci. 15, 2021.
Ankle: 1.1 to 5.4 N m/rad and 0.016 to 0.080 N m s/rad a kilogram of the body in stance,
E. Ficanha et al., J. Medical Devices 12, 2018, far less in swing, H. Lee, E. Rouse, H.
Krebs, IEEE J. Transl. Eng. Health Med. 4, 2016. Hip: 34 to 66 N m/rad and 1.9 to 4.6
N m s/rad in swing, H. van der Kooij et al., IEEE TNSRE 30, 2022, and more when told to
hold still, B. Koopman et al., IEEE Trans. Robotics 32, 2016. Finger: A. Hajian, R.
Howe, J. Biomech. Eng. 119, 1997.

Inertia: a hammer (1 kg at 0.2 m), a ski boot (2.5 kg at 0.15 m), 50 g at 80 mm of a
finger, 2 kg at a foot 0.9 m from the hip (assumed).
"""

PORT_COLUMNS = (
    "joint_torque_nm", "desired_torque_nm", "joint_angle_rad", "joint_velocity_rad_s",
)  # fmt: skip
"""Columns that `extracted_energy` needs, in its order."""
PASSIVITY_REFERENCES = "ideal", "motor-off"
PASSIVITY_TASKS = "spring", "transparent"


@dataclass(frozen=True)
class Limb:
    """Mechanical impedance of a wearer at a joint."""

    stiffness: float  # [N m/rad]
    damping: float  # [N m s/rad]
    inertia: float  # added inertia [kg m^2]


@dataclass(frozen=True)
class _Centred(Task):
    """A virtual environment with its centre at an angle other than 0."""

    task: Task
    centre: float  # [rad]

    def torque(self, angle: Any, velocity: Any, phase: Any) -> Any:
        return self.task.torque(angle - self.centre, velocity, phase)


@dataclass(frozen=True)
class _Aside(Trajectory):
    """A minimum-jerk move from the centre to one side, and then rest."""

    angle: float  # from the middle [rad]
    centre: float  # the middle [rad]
    resting: tuple[tuple[str, float], ...]
    """Other joints that are driven, and their angles [rad]."""

    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        to, step, still = self.angle, minimum_jerk(time / MOVE_TIME), 0.0 * time
        rest = still, still, still
        resting = {name: Motion(time, still + a, *rest) for name, a in self.resting}
        angle, velocity = to * step.value + self.centre, to * step.rate / MOVE_TIME
        acceleration = to * step.curvature / MOVE_TIME**2
        return Motion(time, angle, velocity, acceleration, still, resting)


class WearerEnergy(NamedTuple):
    """Energy and velocity of wearers, each an array (wearers,)."""

    held: Array
    """Most energy put into the joint while the wearer held still, beyond what the
    virtual spring gave back [J].
    """
    begun: Array
    """Most such energy since the start at rest, the wearer's own move included [J]."""
    velocity: Array  # RMS velocity of the joint while he held still [rad/s]


def extracted_energy(
    torque: Array, desired: Array, angle: Array, velocity: Array, step: float, skip: int
) -> Array:
    """Return the largest energy that a port gave beyond that of a virtual spring.

    That is E - max(0, V(0) - V), with E the integral of torque times velocity from the
    first sample on and V the potential of the virtual spring: a passive device that
    makes that spring, or a softer one, or nothing, gives none beyond what its cables
    and its motor held at first. One that is sampled does give some (J. Colgate, G.
    Schenkel, "Passivity of a class of sampled-data systems", J. Robotic Systems 14,
    1997).

    A torque in a sample acted during the last physics step, from the state before it,
    while angle and velocity are those after. So it is multiplied by the velocity at the
    middle of that step, between two samples; taken half a step late, a stiff cable
    would seem to give energy. V is the trapezoidal sum over the angle, which is exact
    for a line, and nothing over a closed path.

    Arrays are (samples, ...): `torque` of the device at the joint, and `desired` of the
    virtual spring at these angles [N m], `angle` [rad] and `velocity` [rad/s]; `step`
    is the time from sample to sample [s], `skip` the physics steps. Returned are (...)
    [J], at least 0.
    """
    share = 0.5 / skip
    acting = (1.0 - share) * velocity[1:] + share * velocity[:-1]
    given = np.cumsum(step * torque[1:] * acting, axis=0)
    spring = 0.5 * (desired[1:] + desired[:-1]) * np.diff(angle, axis=0)
    returned = np.cumsum(spring, axis=0)
    most: Array = np.max(given - np.maximum(returned, 0.0), axis=0)
    return np.maximum(most, 0.0)


def evaluate_ports(columns: dict[str, Array], step: float, skip: int) -> WearerEnergy:
    """Return energy and velocity, from `PORT_COLUMNS` (samples, wearers).

    `step` is the time from sample to sample [s], `skip` the physics steps.
    """
    first = round((MOVE_TIME + SETTLE_TIME) / step)
    torque, desired, angle, speed = (columns[name] for name in PORT_COLUMNS)
    held, begun = (
        extracted_energy(torque[k:], desired[k:], angle[k:], speed[k:], step, skip)
        for k in (first, 0)
    )
    return WearerEnergy(held, begun, np.sqrt(np.mean(speed[first:] ** 2, axis=0)))


def wearer_bounds(device: str | Path | Device, axis: str | None = None) -> Array:
    """Return lower and upper bounds (3, 2) of the `place` of `limb_of`."""
    found = find_device(device)
    own = found.description.axis(axis)
    is_alone = len(found.description.axes) == 1
    name = found.name if is_alone else f"{found.name}.{own.name}"
    if name in LIMB_RANGES:
        soft, stiff, heavy = LIMB_RANGES[name]
    else:
        # Natural frequencies of 2 and 60 rad/s with the inertia of the joint, of a knee
        # a few N m/rad to more than a thousand; at most three times it is added.
        inertia = inertia_of(found, axis)
        soft, stiff, heavy = inertia * 2.0**2, inertia * 60.0**2, 3.0 * inertia
    # Damping over what is critical with the limb's own inertia: with 0.1 to 1 the
    # stiffnesses of ankle and hip have about the dampings that were measured. At least
    # a hundredth of the greatest inertia is added.
    return np.log([(soft, stiff), (0.1, 1.0), (0.01 * heavy, heavy)])


def limb_of(place: Array, inertia: float) -> Limb:
    """Return the wearer for a `place` (3,), at a joint of an inertia [kg m^2].

    A place has logarithms: of stiffness [N m/rad], of damping over critical damping,
    and of added inertia [kg m^2].
    """
    stiffness, ratio, added = (float(x) for x in np.exp(place))
    return Limb(stiffness, 2.0 * ratio * math.sqrt(stiffness * inertia), added)


def inertia_of(device: str | Path | Device, axis: str | None = None) -> float:
    """Return the inertia of an axis, joint and limb, in the neutral pose [kg m^2]."""
    plant = Plant(device)
    model = plant.model()
    limb = plant.description.axis(axis).limb
    return float(model.dof_M0[model.joint(limb).dofadr[0]])


def task_of(axis: Axis, name: str) -> Task:
    """Return the virtual environment of a name in `PASSIVITY_TASKS`, for an axis."""
    if name != "spring":
        return Transparent()
    spring = Spring(spring_stiffness(axis))
    return _Centred(spring, axis.centre) if axis.centre else spring


def spring_stiffness(axis: Axis) -> float:
    return axis.torque_scale / axis.reach


def first_wearers(device: str | Path | Device, axis: str | None = None) -> Array:
    """Return places within `wearer_bounds`: corners and a Latin hypercube (24, 3)."""
    low, high = wearer_bounds(device, axis).T
    return np.asarray(low + first_places(3) * (high - low))


def first_places(width: int, crowd: int = 24, seed: int = 0) -> Array:
    """Return corners of a unit cube and a Latin hypercube in it, (crowd, width)."""
    from scipy.stats import qmc

    corners = np.stack(np.meshgrid(*([0.0, 1.0],) * width), axis=-1).reshape(-1, width)
    cube = qmc.LatinHypercube(width, rng=seed).random(crowd - len(corners))
    return np.vstack([corners, cube])


def play(
    device: str | Path | Device,
    law: str,
    task: str,
    limbs: Sequence[Limb],
    believed: float = 1.0,
    seed: int = 0,
    axis: str | None = None,
    progress: Callable[[float], object] = float,
) -> WearerEnergy:
    """Simulate wearers who move and then hold still; infinite energy if it diverged.

    Args:
        device: Name, file or the device.
        law: Name of a controller, or of `PASSIVITY_REFERENCES`.
        task: One of `PASSIVITY_TASKS`.
        limbs: The wearers.
        believed: Friction in the controller's model, over that of the cables.
        seed: Seed of the noise, the same for all.
        axis: Name of the axis; the only one by default. Others are transparent, and
            their joints rest.
        progress: Called with the simulated time [s] after every control step.

    Raises:
        CableError: nobody moves the joint of the axis.
    """
    device = find_device(device)
    about = device.description
    own = about.axis(axis)
    place = about.axes.index(own)
    ideal = law == "ideal"
    spring = Transparent() if law == "motor-off" else task_of(own, task)
    model = Plant(device, UNPLUGGED if ideal else {}).model()
    if ideal and task == "spring":
        _add_spring(model, own)
    dof = int(model.joint(own.limb).dofadr[0])
    # He moves to where the virtual spring pulls back by the cable, if it is one.
    drives = DeviceModel(about, model).drives(about.period)
    side = 1.0 if drives[place].reach[0] < 0.0 else -1.0
    others = [other for other in about.axes if other is not own]
    resting = tuple((other.limb, other.centre) for other in others)
    aside = _Aside(0.5 * side * own.reach, own.centre, resting)
    tasks = {other.name: Transparent() for other in others} | {own.name: spring}
    exos = []
    for limb in limbs:
        loaded = copy.copy(model)
        loaded.dof_armature[dof] += limb.inertia
        wearer = {own.limb: Wearer(limb.stiffness, limb.damping)}
        exo = WornDevice(about, loaded, aside, tasks, EPISODE_TIME, wearer=wearer)
        exos.append(exo)
    seeds, prefixes = [seed] * len(limbs), exo.device.prefixes
    batch = Batch(exos, seeds, name=law)
    drives = tuple(_believing(about.sensing.equip(d), believed) for d in exo.drives)
    driven = zip(drives, exo.device.driven, strict=True)
    sensors = [Measuring(about.sensing, *own, seeds, batch.steps) for own in driven]
    columns = [prefixes[place] + name for name in PORT_COLUMNS]
    control = _control(law, drives, place, prefixes)
    measure = AxesMeasuring(prefixes, sensors).measure
    found = batch.play(
        control, measure, columns, lambda step, *_: progress(step * exo.period)
    )
    kept = {n: found[c] for n, c in zip(PORT_COLUMNS, columns, strict=True)}
    angle, velocity = kept["joint_angle_rad"], kept["joint_velocity_rad_s"]
    nothing = 0.0 * angle
    kept["desired_torque_nm"] = spring.torque(angle, nothing, nothing)
    if ideal:
        before = angle - exo.period / exo.frame_skip * velocity  # where it acted
        kept["joint_torque_nm"] = spring.torque(before, nothing, nothing)
    else:
        # What a cable cannot give, as a push, is no part of the virtual spring.
        wanted = kept["desired_torque_nm"]
        kept["desired_torque_nm"] = np.clip(wanted, *drives[place].reach)
    energy = evaluate_ports(kept, exo.period, exo.frame_skip)
    return WearerEnergy(*(np.where(batch.going, values, np.inf) for values in energy))


def _add_spring(model: mujoco.MjModel, axis: Axis) -> None:
    joint, added = model.joint(axis.joint), spring_stiffness(axis)
    there = float(joint.stiffness[0])
    if axis.centre:
        rest = there * float(joint.qpos_spring[0]) + added * axis.centre
        joint.qpos_spring[0] = rest / (there + added)
    joint.stiffness[0] += added


def _believing(drive: Drive, believed: float) -> Drive:
    cables = []
    for one in drive.cables:
        names = "friction", "static_friction"
        scaled = {name: believed * getattr(one.cable, name) for name in names}
        cable = one.cable.replace(**scaled)
        cables.append(dataclasses.replace(one, cable=cable))
    return dataclasses.replace(drive, cables=tuple(cables))


def _control(
    law: str, drives: Sequence[Drive], place: int, prefixes: Sequence[str]
) -> Controller:
    """Return the controller `law` for the axis `place`; others have `none`."""
    if law in PASSIVITY_REFERENCES:
        return Unpowered(drives[0], axes=len(drives))
    if len(drives) == 1:
        return controller(law, drives[0])
    if is_decoupled(law):
        return axes_controller(law, drives, prefixes)
    names = [law if n == place else "none" for n in range(len(drives))]
    return AxesController(list(map(controller, names, drives)), prefixes)


class Activity(NamedTuple):
    """Energy that a controller puts into the worst of a few wearers who hold still."""

    energy: float  # [J]
    allowed: float  # a tenth of what the virtual spring holds after his move [J]
    limb: Limb


def activity(
    device: str | Path | Device,
    law: str,
    axis: str | None = None,
    progress: Callable[[float], object] = float,
) -> Activity:
    """Return the energy that a controller puts into a passive wearer, by simulation.

    The wearers are the first ones of the search of `check_passivity.py`, with a virtual
    spring. The search finds larger energies, and no search proves passivity. Results
    are cached by controller, model, description and code.

    `axis` is the only one by default, and `progress` is called with the simulated time
    [s], up to `EPISODE_TIME`.
    """
    device = find_device(device)
    own = device.description.axis(axis)
    model = Plant(device).model()
    whole = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, whole)
    follows = [law, own.name, repr(device.description), whole.tobytes().hex()]
    if law.endswith(POLICY_ENDING):
        follows.append(Path(law).read_bytes().hex())
    energy, allowed, limb = native_library.kept(
        "passivity", follows, lambda: _activity(device, law, own, progress)
    )
    return Activity(energy, allowed, Limb(*limb))


def _activity(
    device: Device, law: str, own: Axis, progress: Callable[[float], object]
) -> tuple[float, float, tuple[float, ...]]:
    inertia = inertia_of(device, own.name)
    limbs = [limb_of(place, inertia) for place in first_wearers(device, own.name)]
    found = play(device, law, "spring", limbs, axis=own.name, progress=progress)
    worst = int(np.argmax(found.held))
    held = 0.5 * spring_stiffness(own) * (0.5 * own.reach) ** 2
    limb = dataclasses.astuple(limbs[worst])
    return float(found.held[worst]), 0.1 * held, limb  # see `Activity.allowed`
