"""Does a controlled joint stay quiet in the hands of the worst passive wearer?

    python scripts/benchmarks/check_passivity.py --jobs 2 --out runs/passivity.csv

The wearer is a spring and a damper to a reference, with inertia added at the joint; he
moves to one side and then holds still. From then on nobody does work but the device.
What it puts into the joint, less what the virtual spring gives back, is energy that a
passive device does not have; a loop that is unstable with this wearer, or has a limit
cycle, moves the joint on and on. The sensors are those of the benchmark, noise and
delay included; the controller knows the cables, or, with `--believed`, takes their
friction for so many times what it is; with `--damping` a virtual damper is asked for.

The worst wearer is searched by differential evolution (R. Storn, K. Price,
"Differential evolution", J. Global Optimization 11, 1997) that begins with the corners
of a box and a Latin hypercube in it: 144 wearers a row by default, all rows in 11
minutes of one core. `LIMBS` says where the box comes from. Two rows are no controllers:
`ideal` is the unplugged device with a real spring at its joint, with which a wearer of
little damping swings on by himself; with `motor-off`, cables and motor are there and
nothing is asked for.
"""

from __future__ import annotations

import argparse
import copy
import csv
import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray
from scipy.optimize import differential_evolution
from scipy.stats import qmc

from cc_mujoco.benchmark.cell import FRAME_SKIP
from cc_mujoco.benchmark.references import UNPLUGGED
from cc_mujoco.control import CONTROLLERS, controller
from cc_mujoco.devices import DEVICES
from cc_mujoco.envs.device import Device
from cc_mujoco.envs.exo import Exo
from cc_mujoco.episode import Trace, run
from cc_mujoco.human import Spring, Task, Transparent, Wearer
from cc_mujoco.human.motion import Motion, Trajectory, ease
from cc_mujoco.identity import made_by
from cc_mujoco.markdown import table
from cc_mujoco.sensing import Measuring
from cc_mujoco.whatif.build import Builder
from cc_mujoco.whatif.laws import Unpowered
from cc_mujoco.whatif.simulate import Fleet
from cc_mujoco.workers import Tick, run_here

Array = NDArray[np.float64]

MOVE, SETTLE, HOLD = 0.4, 0.6, 1.0
"""Time of the move, for what it stirred up to die away, and of what is judged [s]."""

LIMBS = {
    "wrist": (0.2, 30.0, 0.04),
    "ankle": (5.0, 500.0, 0.06),
    "finger": (0.05, 5.0, 3e-4),
    "exosuit": (10.0, 500.0, 1.6),
}
"""Least and greatest stiffness of the limb at the joint [Nm/rad], and greatest inertia
that is added there [kg m^2], by device.

Stiffness: from a limb that hangs loose to one that is braced as hard as can be, meant
to be wider than what was measured. Wrist: at rest, D. Formica et al., J. Neurophysiol.
108, 2012, and while it grips, V. Falzarano et al., Front. Hum. Neurosci. 15, 2021.
Ankle: 1.1 to 5.4 Nm/rad and 0.016 to 0.080 Nm s/rad a kilogram of the body in stance,
E. Ficanha et al., J. Medical Devices 12, 2018, far less in swing, H. Lee, E. Rouse, H.
Krebs, IEEE J. Transl. Eng. Health Med. 4, 2016. Hip: 34 to 66 Nm/rad and 1.9 to 4.6
Nm s/rad in swing, H. van der Kooij et al., IEEE TNSRE 30, 2022, and more when told to
hold still, B. Koopman et al., IEEE Trans. Robotics 32, 2016. Finger: A. Hajian, R.
Howe, J. Biomech. Eng. 119, 1997.

Inertia: a hammer (1 kg at 0.2 m), a ski boot (2.5 kg at 0.15 m), 50 g at 80 mm of a
finger, 2 kg at a foot 0.9 m from the hip (assumed).
"""

RATIO = 0.1, 1.0
"""Damping, over what is critical for that stiffness with the limb's own inertia [-].
With it the stiffnesses of ankle and hip have about the dampings that were measured."""

LIGHT = 0.01
"""Least inertia that is added, over the greatest [-]."""

KEPT = (
    "joint_torque_nm",
    "desired_torque_nm",
    "joint_angle_rad",
    "joint_velocity_rad_s",
)
"""What `taken` needs of an episode, in its order."""
REFERENCES = "ideal", "motor-off"
TASKS = "spring", "transparent"


@dataclass(frozen=True)
class Limb:
    """A wearer at a joint."""

    stiffness: float
    """[Nm/rad]."""
    damping: float
    """[Nm s/rad]."""
    inertia: float
    """That is added [kg m^2]."""


@dataclass(frozen=True)
class Damped(Task):
    """A virtual environment with a virtual damper, which may be asked for besides."""

    task: Task
    damping: float
    """[Nm s/rad]."""

    def torque(self, angle: Any, velocity: Any, phase: Any) -> Any:
        """Torque of both [Nm]; see `Task.torque`."""
        return self.task.torque(angle, velocity, phase) - self.damping * velocity


@dataclass(frozen=True)
class Aside(Trajectory):
    """A minimum-jerk move from the middle to one side, and then rest."""

    angle: float
    """[rad]."""

    def _motion(self, time: Array, duration: float, rng: np.random.Generator) -> Motion:
        to, step = self.angle, ease(time / MOVE)
        return Motion(
            time,
            to * step.value,
            to * step.rate / MOVE,
            to * step.curvature / MOVE**2,
            0.0 * time,
        )


class Found(NamedTuple):
    """What became of wearers, each an array (wearers,)."""

    held: Array
    """Most energy put into the joint while he held still, beyond what the virtual
    spring gave back [J]."""
    begun: Array
    """The same from the beginning on, at rest, his own move included [J]: more than
    all that he put in and friction took."""
    velocity: Array
    """RMS velocity of the joint while he held still [rad/s]."""
    stroke: Array
    """From the least to the greatest angle meanwhile [rad]."""
    frequency: Array
    """Where the spectrum of that velocity has its peak [Hz]; in steps of 1 / `HOLD`."""


def taken(
    torque: Array, desired: Array, angle: Array, velocity: Array, step: float
) -> Array:
    """Most energy that a port gave at any time beyond what a virtual spring returns.

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
        torque: Of the device at the joint, (samples, ...) [Nm].
        desired: Of the virtual spring at these angles [Nm].
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


def judged(columns: dict[str, Array], step: float) -> Found:
    """What became of wearers, by the columns of their episodes (samples, wearers)."""
    series = [columns[name] for name in KEPT]
    first = round((MOVE + SETTLE) / step)
    still = [values[first:] for values in series]
    *_, angle, velocity = still
    spectrum = np.abs(np.fft.rfft(velocity - velocity.mean(axis=0), axis=0))
    peak = np.argmax(spectrum, axis=0)
    return Found(
        taken(*still, step),
        taken(*series, step),
        np.sqrt(np.mean(velocity**2, axis=0)),
        np.ptp(angle, axis=0),
        np.fft.rfftfreq(len(velocity), step)[peak],
    )


def box(scene: str) -> Array:
    """Logarithms of the least and the greatest of what a wearer is, (3, 2)."""
    soft, stiff, heavy = LIMBS[scene]
    return np.log([(soft, stiff), RATIO, (LIGHT * heavy, heavy)])


def limb_at(place: Array, inertia: float) -> Limb:
    """The wearer at a place in the box, of a joint with that inertia [kg m^2]."""
    stiffness, ratio, added = (float(x) for x in np.exp(place))
    return Limb(stiffness, 2.0 * ratio * math.sqrt(stiffness * inertia), added)


def inertia_of(scene: str) -> float:
    """Inertia of a device's joint with the limb in the neutral pose [kg m^2]."""
    model = Builder(scene).model({})
    return float(model.dof_M0[model.joint(DEVICES[scene].joint).dofadr[0]])


def task_of(scene: str, name: str, damping: float = 0.0) -> Task:
    """The virtual environment: a spring that suits the device, or nothing.

    Args:
        scene: Name of the device's scene.
        name: Of `TASKS`.
        damping: Of a virtual damper besides, over what is critical for a spring that
            suits and the inertia of the joint [-].
    """
    setup = DEVICES[scene]
    stiffness = setup.torque_scale / setup.reach
    task = Spring(stiffness) if name == "spring" else Transparent()
    damper = 2.0 * damping * math.sqrt(stiffness * inertia_of(scene)) if damping else 0
    return Damped(task, damper) if damper else task


def play(
    scene: str,
    law: str,
    task: str,
    limbs: Sequence[Limb],
    believed: float = 1.0,
    damping: float = 0.0,
    seed: int = 0,
) -> Found:
    """Wearers who move and then hold still, all at once.

    Args:
        scene: Name of the device's scene.
        law: Name of a controller, or of `REFERENCES`.
        task: Of `TASKS`.
        limbs: The wearers.
        believed: Friction that the controller believes, over that of the cables.
        damping: Of a virtual damper besides; see `task_of`.
        seed: Of the noise, the same for all.

    Returns:
        What became of them; infinite where the simulation diverged.
    """
    setup, builder = DEVICES[scene], Builder(scene)
    ideal = law == "ideal"
    spring = Transparent() if law == "motor-off" else task_of(scene, task)
    asked = spring if law in REFERENCES else task_of(scene, task, damping)
    changes = UNPLUGGED if ideal else {}
    model = builder.model(
        {f"{c}.{k}": v for c in builder.cables for k, v in changes.items()}
    )
    joint = model.joint(setup.joint)
    dof = int(joint.dofadr[0])
    if ideal and isinstance(spring, Spring):
        joint.stiffness[0] += spring.stiffness
    # He moves to where the virtual spring pulls back by the cable, if it is one.
    side = 1.0 if Device(setup, None, model).drive(1.0).reach[0] < 0.0 else -1.0
    aside = Aside(0.5 * side * setup.reach)
    exos = []
    for limb in limbs:
        own = copy.copy(model)
        own.dof_armature[dof] += limb.inertia
        wearer = Wearer(limb.stiffness, limb.damping)
        exos.append(
            Exo(setup, aside, asked, MOVE + SETTLE + HOLD, FRAME_SKIP, wearer, own)
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
    trace = Trace(KEPT, fleet.steps, fleet.going)
    control = Unpowered(drive) if law in REFERENCES else controller(law, drive)
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
    found = judged(kept, exo.period)
    return Found(*(np.where(fleet.going, values, np.inf) for values in found))


def search(
    evaluate: Callable[[Array], Found],
    bounds: Array,
    generations: int = 5,
    crowd: int = 24,
    seed: int = 0,
) -> tuple[Array, Found]:
    """Look for who gets the most energy while he holds still.

    Args:
        evaluate: Of wearers at places (wearers, k), all at once.
        bounds: Least and greatest of every coordinate (k, 2).
        generations: After the first.
        crowd: Wearers in a generation; the corners are in the first.
        seed: Of the search.

    Returns:
        All places that were tried (tried, k), and what became of the wearers there.
    """
    low, high = bounds.T
    width = len(bounds)
    corners = np.stack(np.meshgrid(*([0.0, 1.0],) * width), axis=-1).reshape(-1, width)
    cube = qmc.LatinHypercube(width, rng=seed).random(crowd - len(corners))
    first = low + np.vstack([corners, cube]) * (high - low)
    tried: list[Array] = []
    told: list[Found] = []

    def loss(places: Array) -> Array:
        tried.append(places.T.copy())
        told.append(evaluate(tried[-1]))
        return -told[-1].held

    differential_evolution(
        loss,
        list(zip(low, high, strict=True)),
        init=first,
        maxiter=generations,
        tol=0.0,
        polish=False,
        updating="deferred",
        vectorized=True,
        rng=seed,
    )
    return np.vstack(tried), Found(
        *(np.concatenate(parts) for parts in zip(*told, strict=True))
    )


@dataclass(frozen=True)
class Rows:
    """Rows of the table as a `workers.Job`; a piece is a device, a task and a law."""

    generations: int
    believed: float
    damping: float

    def rehearse(self) -> None:
        """See `Job.rehearse`; what is imported is all there is to make."""

    def made_by(self) -> dict[str, Any]:
        """See `Job.made_by`."""
        return made_by()

    def size(self, piece: tuple[str, str, str]) -> int:
        """One row."""
        return 1

    def do(self, piece: tuple[str, str, str], tick: Tick) -> list[dict[str, Any]]:
        """Search the worst wearer, and tell of all that were tried."""
        scene, task, law = piece
        inertia = inertia_of(scene)

        def limbs(places: Array) -> list[Limb]:
            return [limb_at(place, inertia) for place in places]

        tried, found = search(
            lambda places: play(
                scene, law, task, limbs(places), self.believed, self.damping
            ),
            box(scene),
            self.generations,
        )
        # A wearer of little damping swings on by himself.
        swings = play(scene, "ideal", task, limbs(tried)).velocity
        return [
            {
                "scene": scene,
                "task": task,
                "controller": law,
                "believed": self.believed,
                "damping": self.damping,
                "stiffness_nm_rad": limb.stiffness,
                "damping_nms_rad": limb.damping,
                "inertia_added_kg_m2": limb.inertia,
                "held_j": float(found.held[k]),
                "begun_j": float(found.begun[k]),
                "velocity_rad_s": float(found.velocity[k]),
                "velocity_ideal_rad_s": float(swings[k]),
                "stroke_rad": float(found.stroke[k]),
                "frequency_hz": float(found.frequency[k]),
            }
            for k, limb in enumerate(limbs(tried))
        ]


HEAD = (
    "device",
    "task",
    "controller",
    "energy, held still [mJ]",
    "into the wearer",
    "from the beginning [mJ]",
    "velocity left (by himself) [rad/s]",
    "of the wearer",
)
"""Of the table; energies are the largest of all wearers, the velocity is that which
exceeds most the one that the same wearer has with a real spring."""


LEAST = 0.01
"""Energy of which a table tells [mJ]."""


def row(tried: Sequence[dict[str, Any]]) -> tuple[str, ...]:
    """A row of the table, of all wearers that were tried."""
    worst = max(tried, key=lambda one: one["held_j"])
    fastest = max(
        tried, key=lambda one: one["velocity_rad_s"] - one["velocity_ideal_rad_s"]
    )
    begun = max(one["begun_j"] for one in tried)
    return (
        worst["scene"],
        worst["task"],
        f"`{worst['controller']}`",
        _figure(1e3 * worst["held_j"]),
        _limb(worst) if 1e3 * worst["held_j"] >= LEAST else "",
        _figure(1e3 * begun),
        f"{fastest['velocity_rad_s']:.2f} ({fastest['velocity_ideal_rad_s']:.2f})",
        _limb(fastest) if fastest["velocity_rad_s"] >= 0.005 else "",
    )


def _figure(energy: float) -> str:
    """Of an energy [mJ]."""
    return f"{float(f'{energy:.2g}'):g}" if energy >= LEAST else f"< {LEAST:g}"


def _limb(one: dict[str, Any]) -> str:
    names = "stiffness_nm_rad", "damping_nms_rad", "inertia_added_kg_m2"
    return ", ".join(f"{float(f'{one[name]:.2g}'):g}" for name in names)


def main() -> None:
    """Search for every row, and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenes", nargs="+", default=list(LIMBS), choices=list(LIMBS))
    parser.add_argument("--tasks", nargs="+", default=["spring"], choices=TASKS)
    laws = [*REFERENCES, *CONTROLLERS]
    parser.add_argument("--controllers", nargs="+", default=laws)
    parser.add_argument(
        "--believed", type=float, default=1.0, help="friction, of the true"
    )
    parser.add_argument(
        "--damping", type=float, default=0.0, help="virtual, of critical"
    )
    parser.add_argument("--generations", type=int, default=5, help="after the first")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument(
        "--out", type=Path, help="CSV file of all wearers that were tried"
    )
    given = parser.parse_args()
    pieces = {
        number: piece
        for number, piece in enumerate(
            (scene, task, law)
            for scene in given.scenes
            for task in given.tasks
            for law in given.controllers
        )
    }
    job = Rows(given.generations, given.believed, given.damping)
    done = {}
    for number, tried in run_here(job, pieces, count=given.jobs, processes=True):
        done[number] = tried
        print(*row(tried), sep=" | ", flush=True)
    print()
    print(table(HEAD, [row(done[number]) for number in pieces], (3, 5, 6)))
    print("\nWearers: stiffness [Nm/rad], damping [Nm s/rad], inertia added [kg m2].")
    if given.out:
        given.out.parent.mkdir(parents=True, exist_ok=True)
        tried = [one for number in pieces for one in done[number]]
        with given.out.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(tried[0]), lineterminator="\n")
            writer.writeheader()
            writer.writerows(tried)


if __name__ == "__main__":
    main()
