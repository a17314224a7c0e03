"""Energy that a controlled joint puts into the hands of a passive wearer.

    found = play("wrist", "stiction", "spring", first_wearers("wrist"))
    float(found.held.max())      # [J]

The wearer is a spring and a damper to a reference, with inertia added at the joint; he
moves to one side and then holds still. From then on nobody does work but the device.
What it puts into the joint, less what the virtual spring gives back, is energy that a
passive device does not have. The sensors are those of the device, noise and delay
included.
"""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import mujoco
import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray
from scipy.stats import qmc

from cc_mujoco.control import controller
from cc_mujoco.device import UNPLUGGED, Plant
from cc_mujoco.device._device import Device
from cc_mujoco.device._registry import DEVICES, find_device
from cc_mujoco.device._sensors import Measuring
from cc_mujoco.human import Spring, Task, Transparent, Wearer
from cc_mujoco.human._motion import Motion, Trajectory, minimum_jerk
from cc_mujoco.simulation._batch import FRAME_SKIP, Fleet
from cc_mujoco.simulation._batched_controller import Unpowered
from cc_mujoco.simulation._loop import Trace, run
from cc_mujoco.simulation._worn_device import WornDevice

Array = NDArray[np.float64]

MOVE_TIME, SETTLE_TIME, HOLD_TIME = 0.4, 0.6, 1.0
"""Time of the move, of its transient, and of the measurement [s]."""

LIMB_RANGES = {
    "wrist": (0.2, 30.0, 0.04),
    "ankle": (5.0, 500.0, 0.06),
    "finger": (0.05, 5.0, 3e-4),
    "exosuit": (10.0, 500.0, 1.6),
}
"""Least and greatest stiffness of the limb at the joint [N m/rad], and greatest inertia
that is added there [kg m^2], by device.

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

DAMPING_RATIO_RANGE = 0.1, 1.0
"""Damping, over what is critical for that stiffness with the limb's own inertia [-].
With it the stiffnesses of ankle and hip have about the dampings that were measured."""

MIN_INERTIA_SHARE = 0.01
"""Least inertia that is added, over the greatest [-]."""

PORT_COLUMNS = (
    "joint_torque_nm",
    "desired_torque_nm",
    "joint_angle_rad",
    "joint_velocity_rad_s",
)
"""Columns that `extracted_energy` needs, in its order."""
PASSIVITY_REFERENCES = "ideal", "motor-off"
PASSIVITY_TASKS = "spring", "transparent"


@dataclass(frozen=True)
class Limb:
    """A wearer at a joint."""

    stiffness: float
    """[N m/rad]."""
    damping: float
    """[N m s/rad]."""
    inertia: float
    """Added inertia [kg m^2]."""


@dataclass(frozen=True)
class Damped(Task):
    """A virtual environment with a virtual damper."""

    task: Task
    damping: float
    """[N m s/rad]."""

    def torque(self, angle: Any, velocity: Any, phase: Any) -> Any:
        """Return the torque of both [N m]; see `Task.torque`."""
        return self.task.torque(angle, velocity, phase) - self.damping * velocity


@dataclass(frozen=True)
class _Aside(Trajectory):
    """A minimum-jerk move from the middle to one side, and then rest."""

    angle: float
    """[rad]."""

    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        to, step = self.angle, minimum_jerk(time / MOVE_TIME)
        return Motion(
            time,
            to * step.value,
            to * step.rate / MOVE_TIME,
            to * step.curvature / MOVE_TIME**2,
            0.0 * time,
        )


class WearerEnergy(NamedTuple):
    """Energy and motion of wearers, each an array (wearers,)."""

    held: Array
    """Most energy put into the joint while he held still, beyond what the virtual
    spring gave back [J]."""
    begun: Array
    """Most such energy from the beginning on, at rest, his own move included [J]: more
    than all that he put in and friction took."""
    velocity: Array
    """RMS velocity of the joint while he held still [rad/s]."""
    stroke: Array
    """Range from the least to the greatest angle meanwhile [rad]."""
    frequency: Array
    """Peak of the spectrum of that velocity [Hz]; in steps of 1 / `HOLD_TIME`."""


def extracted_energy(
    torque: Array, desired: Array, angle: Array, velocity: Array, step: float
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

    Args:
        torque: Of the device at the joint, (samples, ...) [N m].
        desired: Of the virtual spring at these angles [N m].
        angle: Of the joint [rad].
        velocity: Of the joint [rad/s].
        step: From sample to sample [s], of `FRAME_SKIP` physics steps.

    Returns:
        (...) [J], at least 0.
    """
    share = 0.5 / FRAME_SKIP
    acting = (1.0 - share) * velocity[1:] + share * velocity[:-1]
    given = np.cumsum(step * torque[1:] * acting, axis=0)
    spring = 0.5 * (desired[1:] + desired[:-1]) * np.diff(angle, axis=0)
    returned = np.cumsum(spring, axis=0)
    most: Array = np.max(given - np.maximum(returned, 0.0), axis=0)
    return np.maximum(most, 0.0)


def evaluate_ports(columns: dict[str, Array], step: float) -> WearerEnergy:
    """Return energy and motion, from columns of episodes (samples, wearers)."""
    series = [columns[name] for name in PORT_COLUMNS]
    first = round((MOVE_TIME + SETTLE_TIME) / step)
    still = [values[first:] for values in series]
    *_, angle, velocity = still
    spectrum = np.abs(np.fft.rfft(velocity - velocity.mean(axis=0), axis=0))
    peak = np.argmax(spectrum, axis=0)
    return WearerEnergy(
        extracted_energy(still[0], still[1], still[2], still[3], step),
        extracted_energy(series[0], series[1], series[2], series[3], step),
        np.sqrt(np.mean(velocity**2, axis=0)),
        np.ptp(angle, axis=0),
        np.fft.rfftfreq(len(velocity), step)[peak],
    )


def wearer_bounds(scene: str) -> Array:
    """Return logarithms of the bounds of wearers, (3, 2); see `limb_of`."""
    soft, stiff, heavy = LIMB_RANGES[scene]
    return np.log(
        [(soft, stiff), DAMPING_RATIO_RANGE, (MIN_INERTIA_SHARE * heavy, heavy)]
    )


def limb_of(place: Array, inertia: float) -> Limb:
    """Return the wearer at a place in the box.

    Args:
        place: logarithms of stiffness [N m/rad], damping over critical, and added
            inertia [kg m^2], (3,).
        inertia: of the joint [kg m^2].
    """
    stiffness, ratio, added = (float(x) for x in np.exp(place))
    return Limb(stiffness, 2.0 * ratio * math.sqrt(stiffness * inertia), added)


def inertia_of(scene: str) -> float:
    """Return the inertia of a joint with the limb in the neutral pose [kg m^2]."""
    model = Plant(scene).model()
    return float(model.dof_M0[model.joint(DEVICES[scene].joint).dofadr[0]])


def task_of(scene: str, name: str, damping: float = 0.0) -> Task:
    """Return the virtual environment: a spring that suits the device, or nothing.

    Args:
        scene: Name of the device's scene.
        name: Of `PASSIVITY_TASKS`.
        damping: Of a virtual damper besides, over what is critical for a spring that
            suits and the inertia of the joint [-].
    """
    setup = DEVICES[scene]
    stiffness = setup.torque_scale / setup.reach
    task = Spring(stiffness) if name == "spring" else Transparent()
    damper = 2.0 * damping * math.sqrt(stiffness * inertia_of(scene)) if damping else 0
    return Damped(task, damper) if damper else task


def first_wearers(scene: str, crowd: int = 24, seed: int = 0) -> Array:
    """Return places in the box: its corners, and a Latin hypercube (crowd, 3)."""
    low, high = wearer_bounds(scene).T
    places: Array = low + first_places(3, crowd, seed) * (high - low)
    return places


def first_places(width: int, crowd: int = 24, seed: int = 0) -> Array:
    """Return corners of a unit cube and a Latin hypercube in it, (crowd, width)."""
    corners = np.stack(np.meshgrid(*([0.0, 1.0],) * width), axis=-1).reshape(-1, width)
    cube = qmc.LatinHypercube(width, rng=seed).random(crowd - len(corners))
    return np.vstack([corners, cube])


def play(
    scene: str,
    law: str,
    task: str,
    limbs: Sequence[Limb],
    believed: float = 1.0,
    damping: float = 0.0,
    seed: int = 0,
    variant: mujoco.MjModel | None = None,
) -> WearerEnergy:
    """Simulate wearers who move and then hold still, all at once.

    Args:
        scene: Name of the device's scene.
        law: Name of a controller, or of `PASSIVITY_REFERENCES`.
        task: Of `PASSIVITY_TASKS`.
        limbs: The wearers.
        believed: Friction that the controller believes, over that of the cables.
        damping: Of a virtual damper besides; see `task_of`.
        seed: Of the noise, the same for all.
        variant: Of the scene, to be played in its place.

    Returns:
        Energy and motion; infinite where the simulation diverged.
    """
    setup = DEVICES[scene]
    ideal = law == "ideal"
    spring = Transparent() if law == "motor-off" else task_of(scene, task)
    task_felt = spring if law in PASSIVITY_REFERENCES else task_of(scene, task, damping)
    changes = UNPLUGGED if ideal else {}
    model = variant or Plant(scene, changes).model()
    joint = model.joint(setup.joint)
    dof = int(joint.dofadr[0])
    if ideal and isinstance(spring, Spring):
        joint.stiffness[0] += spring.stiffness
    # He moves to where the virtual spring pulls back by the cable, if it is one.
    side = 1.0 if Device(setup, None, model).drive(1.0).reach[0] < 0.0 else -1.0
    aside = _Aside(0.5 * side * setup.reach)
    exos = []
    for limb in limbs:
        own = copy.copy(model)
        own.dof_armature[dof] += limb.inertia
        wearer = Wearer(limb.stiffness, limb.damping)
        exos.append(
            WornDevice(
                setup,
                aside,
                task_felt,
                MOVE_TIME + SETTLE_TIME + HOLD_TIME,
                FRAME_SKIP,
                wearer,
                own,
            )
        )
    exo = exos[0]
    scripts = [e.author.write(seeding.np_random(seed)[0]) for e in exos]
    fleet = Fleet(exo, [e.device for e in exos], scripts)
    drive = setup.sensing.equip(exo.drive)
    drive = dataclasses.replace(
        drive,
        cable_drives=tuple(
            tuple(
                dataclasses.replace(
                    one,
                    cable=one.cable.replace(
                        friction=believed * one.cable.friction,
                        static_friction=believed * one.cable.static_friction,
                    ),
                )
                for one in row
            )
            for row in drive.cable_drives
        ),
    )
    seeds = [seed] * len(limbs)
    measuring = Measuring(setup.sensing, drive, exo.device.driven, seeds, fleet.steps)
    trace = Trace(PORT_COLUMNS, fleet.steps, fleet.going)
    control = (
        Unpowered(drive) if law in PASSIVITY_REFERENCES else controller(law, drive)
    )
    with np.errstate(all="ignore"):  # what diverged is not a number
        run(fleet, control, trace.keep, measure=measuring.measure, name=law)
    kept = trace.columns
    angle, velocity = kept["joint_angle_rad"], kept["joint_velocity_rad_s"]
    nothing = 0.0 * angle
    kept["desired_torque_nm"] = spring.torque(angle, nothing, nothing)
    if ideal:
        before = angle - exo.period / FRAME_SKIP * velocity  # where the spring acted
        kept["joint_torque_nm"] = spring.torque(before, nothing, nothing)
    else:
        # What a cable cannot give, as a push, is no part of the virtual spring.
        kept["desired_torque_nm"] = np.clip(kept["desired_torque_nm"], *drive.reach)
    found = evaluate_ports(kept, exo.period)
    return WearerEnergy(*(np.where(fleet.going, values, np.inf) for values in found))


MAX_ACTIVE_SHARE = 0.1
"""Energy that a controller may put into a wearer who holds still, over what the virtual
spring of `task_of` holds at the end of his move [-]."""


class Activity(NamedTuple):
    """Energy that a controller puts into the worst of a few wearers who hold still."""

    energy: float
    """[J]."""
    allowed: float
    """[J]; see `MAX_ACTIVE_SHARE`."""
    limb: Limb


def activity(scene: str, law: str, variant: mujoco.MjModel | None = None) -> Activity:
    """Return the energy that a controller puts into a passive wearer, by simulation.

    The wearers are those that the search of `check_passivity.py` begins with, in the
    hands of a spring; it finds more than that, and no search proves anything.

    Args:
        scene: Name of the device's scene.
        law: Name of a controller, which knows the cables.
        variant: Of the scene, to be played in its place.
    """
    setup = find_device(scene)
    inertia = inertia_of(scene)
    limbs = [limb_of(place, inertia) for place in first_wearers(scene)]
    found = play(scene, law, "spring", limbs, variant=variant)
    worst = int(np.argmax(found.held))
    stiffness = setup.torque_scale / setup.reach
    held = 0.5 * stiffness * (0.5 * setup.reach) ** 2
    return Activity(float(found.held[worst]), MAX_ACTIVE_SHARE * held, limbs[worst])
