"""Definition of a controller and of its measurements.

    controller = CONTROLLERS["pi"](env.unwrapped.drive)
    controller.reset()
    observation, info = env.reset(seed=0)
    torque = controller.torque(info)                       # N m at the motor pulley
    env.step(env.unwrapped.action(torque))

Controllers work on numbers and, for many environments at once, on arrays; both give the
same bits.

The step of most is one compiled function, a `SteppedLaw`, which Python, compiled
episodes and exported C run; see `_law_steps` for memory, parameters and shape. Numbers
computed from rotor, cables and delay are in tables, which no parameter changes.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._utils.arguments import require_kind
from cc_mujoco._utils.exclusive import exclusive
from cc_mujoco.cable._parameter import Parameter
from cc_mujoco.control import _guard as guard
from cc_mujoco.control import _law_steps as law_steps
from cc_mujoco.control import _planner_steps as planner_steps
from cc_mujoco.control._law_steps import FIRST_STEP, LAW_INPUTS, LIMITS, LawData
from cc_mujoco.control._planner_memory import TUNING
from cc_mujoco.device._drive import CableDrive, Drive
from cc_mujoco.device._sensors import WINDING_COLUMNS
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray, FloatMatrix, IntArray, compiled, internal

WOUND = dict(zip(LAW_INPUTS[2:4], WINDING_COLUMNS[:2], strict=True))
"""Columns of the motion of a round pulley on which the cables wind, each by the law
input that it replaces."""

STEPS = (
    law_steps.step_forward, law_steps.step_proportional_integral, law_steps.step_tuned,
    law_steps.step_inverse, law_steps.step_gaussian, law_steps.step_model_based,
    law_steps.step_stiction, law_steps.step_disturbance, planner_steps.step_plan,
    planner_steps.step_sensed,
)  # fmt: skip
"""Every compiled step; its index is the `place` of `step`."""
_NUMBERED_STEPS = tuple(enumerate(STEPS))


class Controller(ABC):
    """Law for the motor torque; subclasses are small and may keep a state.

    One thread at a time may use a controller; a second one gets a `CableError`.
    """

    name = ""  # name in error messages; if empty, that of its class

    def __init_subclass__(cls, **given: Any) -> None:
        """Make calls by several threads at once an error, see `exclusive`."""
        super().__init_subclass__(**given)
        for name in ("reset", "torque", "given"):
            if name in cls.__dict__:
                setattr(cls, name, exclusive(cls.__dict__[name]))

    def __init__(self, drive: Drive) -> None:
        """Prepare for the first episode with a drive."""
        require_kind("drive", drive, Drive)
        self.drive = drive

    @abstractmethod
    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Reset the state before an episode, of all environments or of a mask."""

    @abstractmethod
    def torque(self, observation: Mapping[str, Any]) -> Any:
        """Return the torque of the motor [N m], inside the limits of the drive.

        The observation has at least the keys `device.MEASURED_COLUMNS`, each a number
        or an array over environments, and so is the torque. Others are not read, except
        `device.WINDING_COLUMNS` and, where the drive has such sensors,
        `device.TENSION_COLUMN`.
        """

    def given(self, torque: Any) -> None:  # noqa: B027, most do not ask
        """Take note of the torque that the motor got instead of the command [N m].

        With several axes it is that of every motor, (axes,). A torque that is no number
        or beyond `guard.MAX_READING` is ignored.

        A host calls this if its limits (of rate, a soft start) are not those of the
        drive. Otherwise a model would continue from the wrong torque.
        """


def total_delay(drive: Drive) -> float:
    """Return the time from a torque at the joint to the motor's reaction to it [s]."""
    return (drive.delay + 1.5) * drive.period + drive.motor_lag


def motor_limits(drive: Drive) -> guard.DriveLimits:
    """Return the numbers of motor and joint that laws and their guard use."""
    return guard.DriveLimits(
        drive.ratio,
        drive.low,
        drive.high,
        drive.period,
        float(drive.one_way),
        drive.inertia,
        min(drive.safe_torque, guard.NO_TORQUE_LIMIT),
        min(drive.safe_speed, guard.NO_SPEED_LIMIT),
        min(drive.safe_power, guard.NO_POWER_LIMIT),
        min(total_delay(drive), guard.MAX_ANSWER_TIME),
        float(drive.shared_joint),
    )


def limit_torques(torque: Any, drives: Sequence[Drive]) -> Any:
    """Return the torques of all motors clipped to their limits [N m].

    `torque` is that of the only motor, or of each (..., axes). Any other shape is
    returned unchanged, for the caller to refuse.
    """
    if len(drives) == 1:
        return np.clip(torque, drives[0].low, drives[0].high)
    if np.shape(torque)[-1:] != (len(drives),):
        return torque
    low, high = zip(*((drive.low, drive.high) for drive in drives), strict=True)
    return np.clip(torque, low, high)


def needs_winding(observation: Mapping[str, Any], drive: Drive) -> bool:
    """Return whether to read `WINDING_COLUMNS`; refuse to do without needed ones."""
    if WINDING_COLUMNS[0] in observation:
        return True
    columns = ", ".join(WINDING_COLUMNS)
    if drive.crossed:
        raise CableError(
            f"joint {', '.join(drive.crossed)} winds the cables too; a controller "
            f"with a model of them needs to read {columns}."
        )
    if drive.lever:
        raise CableError(
            "the cables pull a lever, whose arm changes with its angle; a "
            f"controller with a model of them needs to read {columns}."
        )
    return False


def as_round_pulley(observation: Mapping[str, Any], drive: Drive) -> Mapping[str, Any]:
    """Convert measurements to a joint with a round pulley on which the cables wind.

    Models of cables have a constant arm. So angle and velocity of the joint become
    those of that pulley, and both torques those that the same tensions make at it. An
    observation without `device.WINDING_COLUMNS` is assumed to be of such a pulley.

    Raises:
        CableError: Other joints wind the cables too, or they pull a lever.
    """
    if not needs_winding(observation, drive):
        return observation
    changed = {name: observation[wound] for name, wound in WOUND.items()}
    leverage = observation[WINDING_COLUMNS[2]]
    with np.errstate(all="ignore"):  # a torque over an arm of 0 is no number
        for name in LAW_INPUTS[4:]:
            changed[name] = np.divide(observation[name], leverage)
    return {**observation, **changed}


def readings(observation: Mapping[str, Any], names: Sequence[str]) -> FloatArray:
    """Return the named measurements (rows, names); a scalar gives one row."""
    columns = [np.atleast_1d(np.asarray(observation[name], float)) for name in names]
    seen = np.empty((max(column.size for column in columns), len(names)))
    for place, column in enumerate(columns):
        seen[:, place] = column
    return seen


@internal
def step(place: int, data: LawData) -> float:
    """Return the motor torque of a law's next step [N m]; `place` indexes `STEPS`."""
    for index, law in _NUMBERED_STEPS:
        if place == index:
            return law(data)
    return 0.0


@compiled
def _step_all(
    place: int,
    memory: FloatMatrix,
    shape: IntArray,
    tables: FloatArray,
    seen: FloatMatrix,
    guarded: IntArray,
    found: FloatArray,
) -> None:
    """Write the motor torque of every environment to `found` (rows,) [N m].

    It is 0 if an unguarded reading is outside the range of any sensor.
    """
    for row in range(found.size):
        found[row] = 0.0
        if law_steps.impossible(seen[row], guarded.size, guarded) == 0:
            found[row] = step(place, LawData(memory[row], shape, tables, seen[row]))


class LawTables(NamedTuple):
    """Constants of a law besides its parameters, and the layout of its memory."""

    shape: tuple[int, ...]  # whole numbers, see `_law_steps`
    numbers: tuple[float, ...]  # real numbers that no parameter changes
    size: int  # how many numbers the memory has
    given: tuple[int, ...] = ()  # places of the last command; the last is the guard's
    states: int = 0  # place of the states of the cables, of a law with a model


def cable_shape(cables: Sequence[CableDrive]) -> tuple[int, ...]:
    """Return numbers of cables, segments and sections, the `shape` of `_law_steps`."""
    segments = [one.cable.segments for one in cables]
    return len(cables), *segments, *(len(one.cable.conduit) for one in cables)


@dataclass(frozen=True)
class SteppedLaw:
    """The compiled functions of a controller."""

    step: Callable[..., Any]
    store_parameters: Callable[..., Any] = law_steps.store_limits
    has_model: bool = False
    unread: frozenset[str] = frozenset()  # gains that it does not read
    fixed: frozenset[str] = frozenset()  # gains that its `LawTables` follow from
    gains: tuple[Parameter, ...] = LIMITS
    seen: tuple[str, ...] = LAW_INPUTS  # readings that it uses
    needs_slope: bool = False  # cables must have terms that `_tension_slope` supports
    is_round: bool = True  # True if `as_round_pulley` converts its readings
    unguarded: frozenset[str] = frozenset()  # readings that its guard does not check
    is_policy: bool = False  # True if it reads columns of an observation as they are

    @property
    def plans(self) -> bool:
        """True if its step simulates the cables' model many times."""
        return self.gains is TUNING

    @property
    def wound(self) -> tuple[str, ...]:
        """Columns to read for `seen` if the joint has no round pulley, see `WOUND`."""
        if self.is_policy:
            return self.seen
        return tuple(WOUND.get(name, name) for name in self.seen)


def stepped_law(kind: type[Controller]) -> SteppedLaw | None:
    """Return the compiled functions of a class itself; subclasses may differ."""
    return vars(kind).get("stepped")


class SteppedController(Controller):
    """Controller whose step is compiled, on a row of numbers for each environment."""

    stepped: ClassVar[SteppedLaw]
    limits: guard.DriveLimits  # motor and joint as the law knows them

    def __init__(self, drive: Drive) -> None:
        super().__init__(drive)
        self.limits = motor_limits(drive)
        self._memory: FloatArray = np.zeros((0, 0))

    @property
    def gains(self) -> dict[str, float]:
        """Present value of each of `SteppedLaw.gains`, by name."""
        return self.limits._asdict()

    @abstractmethod
    def law_tables(self) -> LawTables:
        """Return shape, tables and places in the memory of the law."""

    def parameters(self) -> list[float]:
        """Return the parameters, in order; see `_law_steps`."""
        present = self.gains
        found = [float(present[gain.name]) for gain in self.stepped.gains]
        for one in self.drive.cables if self.stepped.has_model else ():
            found += one.proximal, one.distal, *one.cable.scalars
            found += chain(*one.cable.conduit)
        return found

    def fresh_memory(self) -> FloatArray:
        """Return the memory of one environment before its first step."""
        tables = self.law_tables()
        memory = np.zeros(tables.size)
        shape = np.array(tables.shape, np.int64)
        self.stepped.store_parameters(memory, shape, np.array(self.parameters()))
        memory[FIRST_STEP] = 1.0
        return memory

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        if where is None:
            self._memory = np.zeros((0, 0))
        elif len(self._memory):
            self._memory[where, FIRST_STEP] = 1.0

    def given(self, torque: Any) -> None:
        if len(self._memory):
            for place in self._tables.given:
                np.copyto(self._memory[:, place], torque, where=guard.is_heard(torque))

    def guard_states(self) -> FloatArray:
        """Return the state of the guard of every environment, see `guard.FREE`."""
        if not (len(self._memory) and self._tables.given):
            return np.zeros(len(self._memory))
        place = self._tables.given[-1] - guard.COMMAND + guard.STATE
        return np.asarray(self._memory[:, place])

    def memory(self, rows: int) -> FloatArray:
        """Return the memory of every environment (rows, numbers), made if need be."""
        if len(self._memory) != rows:
            self._tables, law = self.law_tables(), self.stepped
            self._numbers = np.array(self._tables.numbers)
            self._shape = np.array(self._tables.shape, np.int64)
            guarded = [name not in law.unguarded for name in law.seen]
            self._guarded = np.array(guarded, np.int64)
            self._place = STEPS.index(law.step)
            self._memory = np.tile(self.fresh_memory(), (rows, 1))
        return self._memory

    def torque(self, observation: Mapping[str, Any]) -> Any:
        found = self.answer(self.measured(observation))
        return found if np.ndim(observation["desired_torque_nm"]) else float(found[0])

    def measured(self, observation: Mapping[str, Any]) -> FloatArray:
        """Return the measurements that the law reads (rows, readings)."""
        if self.stepped.is_round:
            observation = as_round_pulley(observation, self.drive)
        return readings(observation, self.stepped.seen)

    def answer(self, seen: FloatArray) -> FloatArray:
        """Return the motor torques (rows,) [N m] for measurements (rows, readings)."""
        memory, found = self.memory(len(seen)), np.empty(len(seen))
        _step_all(
            self._place, memory, self._shape, self._numbers, seen, self._guarded, found
        )
        return found
