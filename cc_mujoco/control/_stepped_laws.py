"""Laws whose step is one compiled function, and the numbers that each is given.

    law, numbers = stepped_law(type(made)), made.law_tables()
    law.step(memory, numbers.shape, numbers.numbers, readings)

Python, compiled episodes and exported C run them; see `_law_steps` for memory,
parameters and shape. What rests on rotor, cables and delay stands in tables; no
parameter changes it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import chain
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.cable._parameter import Parameter
from cc_mujoco.control import _guard as guard
from cc_mujoco.control import _law_steps as law_steps
from cc_mujoco.control import _planner_steps as planner_steps
from cc_mujoco.control._compiled_laws import GAINS, LAW_INPUTS
from cc_mujoco.control._controller import Controller, as_round_pulley, readings
from cc_mujoco.control._law_steps import FIRST_STEP
from cc_mujoco.control._planner_parameters import TUNING
from cc_mujoco.device._drive import Drive
from cc_mujoco.device._sensors import WINDING_COLUMNS
from cc_mujoco.native import FloatArray, FloatMatrix, IntArray, compiled, internal

_WOUND = dict(zip(LAW_INPUTS[2:4], WINDING_COLUMNS, strict=False))
"""Motion of the joint as it winds the cables."""
_BY_NAME = {gain.name: gain for gain in GAINS}
LIMITS: tuple[Parameter, ...] = tuple(
    _BY_NAME[name] for name in guard.DriveLimits._fields
)
"""Gains of a law that has none but those of `DriveLimits`."""

STEPS = (
    law_steps.step_forward, law_steps.step_proportional_integral, law_steps.step_tuned,
    law_steps.step_inverse, law_steps.step_gaussian, law_steps.step_model_based,
    law_steps.step_stiction, law_steps.step_disturbance, planner_steps.step_plan,
    planner_steps.step_sensed,
)  # fmt: skip
"""Every step, at the place by which `step` finds it."""


@internal
def step(
    place: int,
    memory: FloatArray,
    shape: IntArray,
    tables: FloatArray,
    readings: FloatArray,
) -> float:
    """Return the motor torque of the next step of a law [N m]."""
    if place == 0:
        return law_steps.step_forward(memory, shape, tables, readings)
    if place == 1:
        return law_steps.step_proportional_integral(memory, shape, tables, readings)
    if place == 2:
        return law_steps.step_tuned(memory, shape, tables, readings)
    if place == 3:
        return law_steps.step_inverse(memory, shape, tables, readings)
    if place == 4:
        return law_steps.step_gaussian(memory, shape, tables, readings)
    if place == 5:
        return law_steps.step_model_based(memory, shape, tables, readings)
    if place == 6:
        return law_steps.step_stiction(memory, shape, tables, readings)
    if place == 7:
        return law_steps.step_disturbance(memory, shape, tables, readings)
    if place == 8:
        return planner_steps.step_plan(memory, shape, tables, readings)
    return planner_steps.step_sensed(memory, shape, tables, readings)


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
    """Write the motor torques of every environment (rows,) [N m].

    A reading that no sensor can mean, at which no guard looks, gives none.
    """
    for row in range(found.size):
        found[row] = 0.0
        if law_steps.impossible(seen[row], guarded.size, guarded) == 0:
            found[row] = step(place, memory[row], shape, tables, seen[row])


class LawTables(NamedTuple):
    """Numbers of a law besides its parameters.

    Attributes:
        shape: whole numbers, see `_law_steps`.
        numbers: those that no parameter changes.
        places: of numbers in the memory; the last is how many there are.
        given: places of the last torque in the memory.
    """

    shape: tuple[int, ...]
    numbers: tuple[float, ...]
    places: tuple[int, ...]
    given: tuple[int, ...] = ()


@dataclass(frozen=True)
class SteppedLaw:
    """The compiled functions of a controller."""

    step: Callable[..., Any]
    wrong_parameters: Callable[..., Any] = law_steps.wrong_limits
    store_parameters: Callable[..., Any] = law_steps.store_limits
    has_model: bool = False
    unread: frozenset[str] = frozenset()
    """Gains that it does not read."""
    fixed: frozenset[str] = frozenset()
    """Gains that what it was made with depends on."""
    gains: tuple[Parameter, ...] = LIMITS
    seen: tuple[str, ...] = LAW_INPUTS
    """Readings that it uses."""
    needs_slope: bool = False
    """True if cables may only have friction terms that `_tension_slope` supports."""
    is_round: bool = True
    """True if it reads torques as of a round pulley."""
    unguarded: frozenset[str] = frozenset()
    """Readings at which its guard does not look."""
    is_policy: bool = False
    """True if it reads the columns of an observation, as they are."""

    @property
    def plans(self) -> bool:
        """True if its step rolls the cables' model out many times."""
        return self.gains is TUNING

    @property
    def wound(self) -> tuple[str, ...]:
        """Those readings where the arm of the cables changes."""
        if self.is_policy:
            return self.seen
        return tuple(_WOUND.get(name, name) for name in self.seen)


def stepped_law(kind: type[Controller]) -> SteppedLaw | None:
    """Return the compiled functions of a class; its subclasses may do otherwise."""
    found: SteppedLaw | None = vars(kind).get("stepped")
    return found


class SteppedController(Controller):
    """Controller whose step is compiled, on a row of numbers for each environment."""

    stepped: ClassVar[SteppedLaw]
    limits: guard.DriveLimits
    """Motor and joint as the law knows them."""

    def __init__(self, drive: Drive) -> None:
        super().__init__(drive)
        self.limits = guard.motor_limits(drive)
        self._memory: FloatArray = np.zeros((0, 0))

    @property
    def gains(self) -> Any:
        """Present gains, with an attribute for each of `SteppedLaw.gains`."""
        return self.limits

    def law_tables(self) -> LawTables:
        """Return the numbers of the law besides its parameters."""
        raise NotImplementedError

    def parameters(self) -> list[float]:
        """Return the parameters, in order; see `_law_steps`."""
        gains = self.gains
        found = [float(getattr(gains, gain.name)) for gain in self.stepped.gains]
        for one in self.drive.cables if self.stepped.has_model else ():
            found += one.proximal, one.distal, *one.cable.scalars
            found += chain(*one.cable.conduit)
        return found

    def fresh_memory(self) -> FloatArray:
        """Return the memory of one environment before its first step."""
        tables = self.law_tables()
        memory = np.zeros(tables.places[-1])
        shape = np.array(tables.shape, np.int64)
        self.stepped.store_parameters(memory, shape, np.array(self.parameters()))
        memory[FIRST_STEP] = 1.0
        return memory

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Reset the state; see `Controller.reset`."""
        if where is None:
            self._memory = np.zeros((0, 0))
        elif len(self._memory):
            self._memory[where, FIRST_STEP] = 1.0

    def given(self, torque: Any) -> None:
        """Accept the torque that the motor got; see `Controller.given`."""
        if len(self._memory):
            for place in self._tables.given:
                kept = self._memory[:, place]
                np.copyto(kept, torque, where=guard.is_heard(torque))

    def memory(self, rows: int) -> FloatArray:
        """Return the numbers of every environment (rows, numbers)."""
        if len(self._memory) != rows:
            self._tables, law = self.law_tables(), self.stepped
            self._numbers = np.array(self._tables.numbers)
            self._shape = np.array(self._tables.shape, np.int64)
            self._guarded = np.array([name not in law.unguarded for name in law.seen])
            self._guarded = self._guarded.astype(np.int64)
            self._place = STEPS.index(law.step)
            self._memory = np.tile(self.fresh_memory(), (rows, 1))
        return self._memory

    def torque(self, observation: Mapping[str, Any]) -> Any:
        """Return the torque of the motor [N m]; see `Controller.torque`."""
        found = self.answer(self.measured(observation))
        return found if np.ndim(observation["desired_torque_nm"]) else float(found[0])

    def measured(self, observation: Mapping[str, Any]) -> FloatArray:
        """Return the measurements that the law reads (rows, readings)."""
        return readings(as_round_pulley(observation, self.drive), self.stepped.seen)

    def answer(self, seen: FloatArray) -> FloatArray:
        """Return the torque of the motor after measurements (rows,) [N m]."""
        memory, found = self.memory(len(seen)), np.empty(len(seen))
        _step_all(
            self._place, memory, self._shape, self._numbers, seen, self._guarded, found
        )
        return found
