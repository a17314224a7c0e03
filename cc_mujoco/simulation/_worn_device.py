"""A device with its wearer, trajectory and task, the setting of an episode."""

import dataclasses
import inspect
import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from cc_mujoco import errors
from cc_mujoco._validation import MAX_DURATION, require_dictionary, require_number
from cc_mujoco.device import IN_EPISODES, Nominal, Plant
from cc_mujoco.device._axis_columns import axis_columns, split_by_axis
from cc_mujoco.device._description import Description
from cc_mujoco.device._drive import Drive
from cc_mujoco.device._model import DeviceModel
from cc_mujoco.device._observation import OBSERVATION_LIMIT
from cc_mujoco.device._sensors import AxesMeasuring, Measuring, Sensing
from cc_mujoco.device._variables import OF_CABLES, find
from cc_mujoco.errors import CableError
from cc_mujoco.human import Task, Trajectory, Walk, Wearer, scale_task, trajectory
from cc_mujoco.human import task as find_task
from cc_mujoco.human._perturbed import unperturbed
from cc_mujoco.human._recorded import Recorded
from cc_mujoco.human._tasks import peak_demand, task_torque
from cc_mujoco.simulation._reference_motion import MARKS, Author, Script

TaskChoice = str | Path | Task | Mapping[str, str | Path | Task] | None
"""Task of all axes, or by the name of an axis; None for that of the device."""


def refuse_unknown(unknown: Mapping[str, Any], env: type) -> None:
    parameters = inspect.signature(env).parameters.values()
    there = [p.name for p in parameters if p.kind is not p.VAR_KEYWORD]
    errors.refuse_unknown(unknown, there)


class WornDevice:
    """A device with a wearer, a trajectory and a task."""

    def __init__(
        self,
        description: Description,
        model: mujoco.MjModel,
        trajectory: str | Path | Trajectory | None = None,
        task: TaskChoice = None,
        duration: float = 10.0,
        frame_skip: int | None = None,
        wearer: Wearer | Mapping[str, Wearer] | None = None,
        hold: int = 1,
        history: int = 0,
        memory: bool = False,
        randomise: Mapping[str, Any] | None = None,
        smoothness: float = 0.0,
    ) -> None:
        """Derive drives, plants and spaces from the settings.

        Args:
            description: The device.
            model: Its scene, or a variant.
            trajectory: Trajectory that the wearer follows, see `human.trajectory`; that
                of the device by default.
            task: Task, see `human.task`, for all axes or by axis; that of the device by
                default. A task that follows the gait, given by name, is scaled to the
                pace of a `Walk`, not to the walker's body, which the walk does not
                know; see `human.scale_task`. A `Task` object is not scaled.
            duration: Length of an episode [s], rounded to whole control steps.
            frame_skip: Physics steps from one sample of the sensors to the next; those
                of the period of the device by default.
            wearer: Impedance of the wearer at the only axis, or by joint; that of the
                model by default.
            hold: Samples in a control step.
            history: Earlier frames in an observation; see `Observed`.
            memory: True to observe the friction memory too; see `Observed.memory`.
            randomise: Ranges from which plants are drawn; see `Ranges`.
            smoothness: Reward lost by a change of the action by 1.
        """
        if not (wearer is None or isinstance(wearer, (Wearer, Mapping))):
            raise CableError(f"wearer must be a Wearer or None, not {wearer!r}.")
        require_number("smoothness", smoothness, 0.0, 1e3, "")
        self.smoothness = float(smoothness)
        self.description = description
        self.device = DeviceModel(description, model, wearer)
        if frame_skip is None:
            frame_skip = self.device.frame_skip
        whole = isinstance(frame_skip, (int, np.integer)) and frame_skip is not True
        if not (whole and frame_skip >= 1):
            raise CableError(f"frame_skip must be an integer >= 1, not {frame_skip!r}.")
        self.frame_skip = int(frame_skip)
        self.sampling = self.frame_skip * float(self.device.model.opt.timestep)
        """Time between samples of the sensors [s]."""
        require_number("hold", hold, 1, 1000, "samples")
        self.hold = hold
        self.period = hold * self.sampling  # time between control steps [s]
        require_number("duration", duration, self.period, MAX_DURATION, "s")
        self.steps = round(duration / self.period)  # control steps in an episode
        self.samples = hold * self.steps
        sources = axis_trajectories(self.device, trajectory)
        self.tasks = _axis_tasks(description, task, sources)  # task of every axis
        drives = self.device.drives(self.period)
        self.description = _with_safe_torques(description, self.tasks, drives)
        own: dict[str, Any] = {"hold": hold, "history": history, "memory": memory}
        observed = []
        for axis, one in zip(self.device.axes, self.tasks, strict=True):
            frame = axis.observed(description.scene, self.sampling)
            frame = frame.with_reference() if one.commands_angle else frame
            observed.append(dataclasses.replace(frame, **own))
        self.observed = tuple(observed)  # observation of every axis
        self.author = Author(
            self.device, sources, self.tasks, self.samples, self.frame_skip
        )
        self.drives = self.drives_of(self.device)
        """Knowledge that a controller may have of each axis as its scene has it."""
        nominal = Nominal(description, self.device.cables, self.device.wearers)
        self.plants = Ranges(randomise, nominal)
        size = sum(observed.space.shape[0] for observed in self.observed)
        limit = OBSERVATION_LIMIT
        self.observation_space = Box(-limit, limit, (size,), dtype=np.float32)
        self.action_space = Box(-1.0, 1.0, (len(self.drives),), dtype=np.float32)

    def drives_of(
        self, device: DeviceModel, sensing: Sensing | None = None
    ) -> tuple[Drive, ...]:
        """Return the drive of each axis, by default with the sensors of the device."""
        own = [
            {"commands_angle": task.commands_angle, "safe_torque": axis.safe_torque}
            for task, axis in zip(self.tasks, self.description.axes, strict=True)
        ]
        return device.drives(self.period, sensing, own)

    @property
    def drive(self) -> Drive:
        """Drive of the only axis; raises `CableError` if there are several."""
        self.description.axis()
        return self.drives[0]

    @property
    def task(self) -> Task:
        """Task of the only axis; raises `CableError` if there are several."""
        self.description.axis()
        return self.tasks[0]

    def require_timestep(self) -> None:
        """Raise `CableError` if the model's time step differs from that at creation."""
        step = float(self.device.model.opt.timestep)
        if self.frame_skip * step != self.sampling:
            raise CableError(
                f"the time step of the model is {step:g} s now, but the period of "
                f"{self.period:g} s follows from the one it was made with; give the "
                "changed model as the argument `model`, and a `frame_skip` that fits."
            )

    def action(self, torque: Any) -> NDArray[np.float32]:
        """Return the action, (..., axes), that makes the motors give torques [N m].

        The torque is that of the only motor (...), or of each motor (..., axes).
        """
        given = np.asarray(torque)
        if len(self.drives) == 1:
            given = given[..., None]
        scaled = given / self.device.torque_limits
        clipped: NDArray[np.float32] = np.clip(scaled, -1.0, 1.0).astype(np.float32)
        return clipped

    def controller_sensors(
        self,
        sensing: Sensing,
        drives: Sequence[Drive],
        seeds: int | Sequence[int],
        biases: Sequence[ArrayLike] = (),
        **errors: Any,
    ) -> AxesMeasuring:
        """Return the sensors that controllers read, of one device or of several.

        Args:
            sensing: Quality of the sensors.
            drives: Drive of every axis, which tells the positions of tension sensors.
            seeds: One, or one for each of several devices.
            biases: Biases of every axis, as of `Measuring`; none by default.
            errors: `delay` and `noise` as of `Measuring`.
        """
        cables, biases = self.device.driven, biases or [0.0] * len(drives)
        axes = []
        for n, each in enumerate(zip(drives, cables, biases, strict=True)):
            drive, driven, errors["bias"] = each
            own = _axis_seeds(seeds, n)
            axes.append(Measuring(sensing, drive, driven, own, self.steps, **errors))
        return AxesMeasuring(self.device.prefixes, axes)

    def axis_columns(self, columns: Mapping[str, Any], axis: int) -> Mapping[str, Any]:
        """Return the columns of one axis, under names without prefix."""
        prefixes = self.device.prefixes
        return axis_columns(columns, prefixes[axis], prefixes)

    def beyond(self, script: Script) -> str:
        """Return a sentence on tasks beyond motor or safe torque in a script, or ""."""
        for n, (axis, task, drive) in enumerate(
            zip(self.description.axes, self.tasks, self.drives, strict=True)
        ):
            reference, phase = script.mark(MARKS * n), script.mark(MARKS * n + 1)
            velocity = np.gradient(reference, self.sampling)
            deviation = 0.0 * reference if task.about_reference else reference
            demand = task_torque(task, deviation, velocity, phase)
            least, most = drive.reach
            peak = float(np.abs(demand).max())
            # The demand may exceed what the motor gives by 2 % of the largest.
            slack = 0.02 * peak
            if least - slack <= demand.min() and demand.max() <= most + slack:
                if peak <= axis.safe_torque:
                    continue
                return (
                    f"the task asks for {peak:.4g} N m at joint {axis.joint!r}, more "
                    f"than its `safe_torque` of {axis.safe_torque:g} N m, at which "
                    "controllers let it go."
                )
            ends = (demand.min(), demand.max(), least, most)
            low, high, weakest, strongest = (f"{round(e, 3) + 0.0:.4g}" for e in ends)
            return (
                f"the task asks for {low} to {high} N m at joint {axis.joint!r}, "
                f"where the motor gives {weakest} to {strongest} N m even without "
                "friction."
            )
        return ""


class DrivenEnvironment:
    exo: WornDevice

    @property
    def drive(self) -> Drive:
        """Drive of the only axis; several have `drives`."""
        return self.exo.drive

    @property
    def drives(self) -> tuple[Drive, ...]:
        return self.exo.drives

    def action(self, torque: Any) -> NDArray[np.float32]:
        """Return the action for motor torques [N m]; see `WornDevice.action`."""
        return self.exo.action(torque)


def _with_safe_torques(
    description: Description, tasks: Sequence[Task], drives: Sequence[Drive]
) -> Description:
    """Return the description with assumed safe torques raised above the tasks' demands.

    Safe torques given by the description are kept. A demand counts at most as the
    motor's range without friction, since a limit that is never reached protects nobody.
    """
    axes = []
    for axis, task, drive in zip(description.axes, tasks, drives, strict=True):
        if axis.safe_is_assumed and not task.commands_angle:
            speed = axis.units["joint_velocity_rad_s"]
            demand = peak_demand(task, axis.centre, axis.reach, speed)
            demand = min(demand, max(map(abs, drive.reach)))
            safe = max(axis.safe_torque, axis.slip.safe_torque(demand))
            axis = dataclasses.replace(axis, safe_torque=safe)
        axes.append(axis)
    return dataclasses.replace(description, axes=tuple(axes))


def _axis_seeds(seeds: int | Sequence[int], axis: int) -> Any:
    """Return the seeds of an axis's sensors, for axis 0 the given ones."""
    if not axis:
        return seeds
    if isinstance(seeds, int):
        # As many bits as the seed of the first axis has.
        words = 1 if seeds < 2**32 else 4
        state = np.random.SeedSequence([seeds, axis]).generate_state(words)
        return int.from_bytes(state.astype("<u4").tobytes(), "little")
    return [_axis_seeds(seed, axis) for seed in seeds]


def axis_trajectories(
    device: DeviceModel, given: str | Path | Trajectory | None
) -> tuple[Trajectory, ...]:
    description = device.description
    chosen = description.trajectory if given is None else given
    found: list[Trajectory] = []
    for axis in description.axes:
        # The phase of a walk is that of the first axis.
        limbs = description.limbs(description.axes[0])
        source = trajectory(chosen, axis.reach, axis.centre, device.ranges, limbs)
        chosen = source if isinstance(source, Recorded) else chosen  # read once
        found.append(next((one for one in found if one == source), source))
    return tuple(found)


def _axis_tasks(
    description: Description, given: TaskChoice, sources: Sequence[Trajectory]
) -> tuple[Task, ...]:
    """Return the task of every axis; one given by name has the pace of its walk."""
    if isinstance(given, str):
        given = split_by_axis(given, [axis.name for axis in description.axes])
    own = given if isinstance(given, Mapping) else {}
    for name in own:
        description.axis(name)
    tasks = []
    for axis, source in zip(description.axes, map(unperturbed, sources), strict=True):
        task = own.get(axis.name) if isinstance(given, Mapping) else given
        task = axis.task if task is None else task
        found = find_task(task, description.limbs(axis))
        if isinstance(task, str) and isinstance(source, Walk):
            found = scale_task(found, source.pace)
        tasks.append(found)
    return tuple(tasks)


class Ranges:
    """Ranges from which the plants of episodes are drawn.

        ranges = Ranges({"friction": (0.05, 0.2), "delay": (0, 3)}, device)
        ranges.draw(rng, {"delay": 2})
        Ranges({"bristle_length": (1e-3, 1e-2, 0.3)}, device)   # in 30 % of them

    Controllers are not informed: their `drive` stays that of the scene. Every cable has
    draws of its own. Ranges above 0 are drawn log-uniformly, whole numbers and ranges
    that include 0 uniformly. With a probability, either all cables are drawn or all
    keep the value of the scene.
    """

    def __init__(self, given: Mapping[str, Any] | None, device: Nominal) -> None:
        """Check the ranges.

        `given` has (least, most), or (least, most, probability of being drawn), by name
        of `device.IN_EPISODES`, for all cables (`friction`) or one (`flexor.friction`).
        """
        self.nominal = Plant(device)  # the scene as it is
        self._ranges: dict[str, tuple[float, float, float]] = {}
        for name, ends in require_dictionary("randomise", given).items():
            try:
                if isinstance(ends, str):
                    raise TypeError
                low, high, *rest = ends
                (probability,) = rest or (1.0,)
            except (TypeError, ValueError):
                raise CableError(
                    f"randomise[{name!r}] must be (least, most), or (least, most, "
                    f"probability), not {ends!r}."
                ) from None
            require_number(f"randomise[{name!r}][2]", probability, 0.0, 1.0, "")
            for end in (low, high):
                self._check("randomise", name, end)
            if low > high:
                raise CableError(
                    f"randomise[{name!r}] must be (least, most), the lower number "
                    f"first, not {ends!r}."
                )
            chosen = low, high, probability
            self._ranges |= dict.fromkeys(self._each(name), chosen)
        # Parameters may exclude each other: all corners of each cable must be possible.
        for cable in device.cables:
            mine = [n for n in self._ranges if n.startswith(f"{cable}.")]
            for corner in itertools.product((0, 1), repeat=min(len(mine), 8)):
                ends = zip(mine, corner, strict=False)
                Plant(device, {name: self._ranges[name][end] for name, end in ends})

    @property
    def varied(self) -> tuple[str, ...]:
        """Names of the drawn variables, `CABLE.NAME` for one of a cable."""
        return tuple(self._ranges)

    def draw(self, rng: np.random.Generator, given: Mapping[str, Any] | None) -> Plant:
        values: dict[str, float] = {}
        tosses: dict[str, float] = {}
        for name, (low, high, probability) in self._ranges.items():
            if probability < 1.0:
                of_all = name.rpartition(".")[2]
                if of_all not in tosses:
                    tosses[of_all] = rng.uniform()
                if tosses[of_all] >= probability:
                    continue
            if name == "delay":
                values[name] = int(rng.integers(int(low), int(high), endpoint=True))
            elif low > 0.0:
                values[name] = float(np.exp(rng.uniform(math.log(low), math.log(high))))
                values[name] = min(max(values[name], low), high)
            else:
                values[name] = float(rng.uniform(low, high))
        # A value for one cable takes precedence over one for all.
        said = require_dictionary("options", given)
        for name in sorted(said, key=lambda name: "." in name):
            value = said[name]
            self._check("options", name, value)
            values |= dict.fromkeys(self._each(name), value)
        return Plant(self.nominal.device, values) if values else self.nominal

    def _each(self, name: str) -> tuple[str, ...]:
        """Return `CABLE.NAME` for every cable if `name` is of cables, else `name`."""
        if "." in name or name not in OF_CABLES:
            return (name,)
        return tuple(f"{cable}.{name}" for cable in self.nominal.cables)

    def _check(self, where: str, name: str, value: Any) -> None:
        variable = find(name, self.nominal.cables, among=IN_EPISODES, kind="variation")
        variable.check(value, f"{where}[{name!r}]")
