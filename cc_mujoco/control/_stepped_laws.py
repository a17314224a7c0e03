"""Laws whose step is one compiled function, and the numbers that each is given.

    law = LAWS[type(made)]
    numbers = law.tables(made)
    law.step(memory, numbers.shape, numbers.numbers, readings)

Compiled episodes and exported C run them; see `_law_steps` for memory, parameters and
shape. What rests on rotor, cables and delay stands in tables; no parameter changes it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from cc_mujoco.cable._parameter import Parameter
from cc_mujoco.control import _backlash_inverse as backlash_inverse
from cc_mujoco.control import _compiled_laws as compiled_laws
from cc_mujoco.control import _disturbance as disturbance
from cc_mujoco.control import _gaussian as gaussian
from cc_mujoco.control import _guard as guard
from cc_mujoco.control import _law_steps as law_steps
from cc_mujoco.control import _planner_steps as planner_steps
from cc_mujoco.control import _tuned_feedback as tuned_feedback
from cc_mujoco.control._backlash_inverse import BacklashInverse
from cc_mujoco.control._compiled_laws import GAINS, LAW_INPUTS
from cc_mujoco.control._controller import Controller
from cc_mujoco.control._disturbance import DisturbanceObserver
from cc_mujoco.control._feed_forward import FeedForward
from cc_mujoco.control._gaussian import LinearQuadraticGaussian
from cc_mujoco.control._law_steps import (
    CABLES,
    FIRST_STEP,
    LAST_COMMAND,
    OWN_MEMORY,
    admitted,
    part,
    rows_of,
    wrong_motor,
)
from cc_mujoco.control._model_based import ModelBased
from cc_mujoco.control._planner_parameters import TUNING
from cc_mujoco.control._predictive import PLANNER_INPUTS, PredictiveCompensation
from cc_mujoco.control._proportional_integral import Feedback, ProportionalIntegral
from cc_mujoco.control._stiction import StictionCompensation
from cc_mujoco.control._tension_feedback import AdaptiveModel
from cc_mujoco.control._tuned_feedback import FrictionFeedForward, TunedFeedback
from cc_mujoco.device._sensors import WINDING_COLUMNS
from cc_mujoco.native import FloatArray, IntArray, compiled, internal

_WOUND = dict(zip(LAW_INPUTS[2:4], WINDING_COLUMNS, strict=False))
"""Motion of the joint as it winds the cables."""


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


def _forward_tables(law: FeedForward) -> LawTables:
    return LawTables((), (), (OWN_MEMORY + guard.LIMITS,))


def _feedback_tables(law: ProportionalIntegral) -> LawTables:
    return LawTables((), (), (CABLES,), (LAST_COMMAND,))


def _tuned_tables(law: TunedFeedback) -> LawTables:
    return LawTables(
        law.cables.shape,
        (*law.settings, *law.cables.ravel().tolist()),
        (CABLES + tuned_feedback.SIGNAL_SIZE,),
        (LAST_COMMAND,),
    )


def _inverse_tables(law: BacklashInverse) -> LawTables:
    numbers = law.gains[guard.LIMITS :], law.spring, law.cables.ravel()
    first = OWN_MEMORY + backlash_inverse.GAINS
    return LawTables(
        law.cables.shape,
        tuple(np.concatenate(numbers).tolist()),
        (first + backlash_inverse.MEMORY_SIZE,),
        (first + backlash_inverse.LAST_COMMAND,),
    )


def _gaussian_tables(law: LinearQuadraticGaussian) -> LawTables:
    numbers = law.gains[guard.LIMITS :], law.spring, *map(np.ravel, law.design)
    first, size = OWN_MEMORY + gaussian.GAINS, law.memory_size
    return LawTables(
        (size,),
        tuple(map(float, chain(*numbers))),
        (first + size + 2 * gaussian.STATES,),
        (first + size - 1, first + gaussian.LAST_COMMAND),
    )


def _cable_shape(law: Controller) -> tuple[int, list[int], list[int]]:
    """Return number, segments and sections of the cables of a law with a model."""
    cables = [one.cable for one in law.drive.cables]
    segments = [cable.segments for cable in cables]
    return len(cables), segments, [len(cable.conduit) for cable in cables]


def _model_tables(
    law: ModelBased, numbers: tuple[float, ...] = (), size: int = 0
) -> LawTables:
    count, segments, sections = _cable_shape(law)
    *places, end = law_steps.places(count, max(segments))
    shape = count, *segments, *sections
    return LawTables(shape, numbers, (*places, end + size), (LAST_COMMAND,))


def _disturbance_tables(law: DisturbanceObserver) -> LawTables:
    return _model_tables(law, (law.share,), disturbance.LACK_SIZE)


def _planner_tables(law: PredictiveCompensation) -> LawTables:
    count, segments, sections = _cable_shape(law)
    *tables, _ = law.tables
    delays, knots = tables[0].shape[:2]
    shape = count, *segments, *sections, delays, knots
    places = planner_steps.places(count, max(segments), sum(sections), delays, knots)
    numbers = tuple(map(float, chain(*map(np.ravel, tables))))
    # The last command stands before the scratch, see `_planner_steps.places`.
    return LawTables(shape, numbers, places, (places[0] - 1,))


def _adaptive_tables(law: AdaptiveModel) -> LawTables:
    own, nodes = _planner_tables(law), law.taps.nodes
    *places, end = own.places
    count, sensors = nodes.shape
    longest = max(own.shape[1 : 1 + count])
    return own._replace(
        shape=(*own.shape, sensors, *nodes.ravel().tolist()),
        numbers=(*own.numbers, law.taps.fading),
        places=(*places, end + planner_steps.memory_size(count, longest, sensors)),
    )


def wrong_limits(
    shape: IntArray, parameters: FloatArray, least: FloatArray, most: FloatArray
) -> int:
    """Return 1 + the index of an impossible limit, 0 if there is none."""
    return wrong_motor(
        parameters, least, most, guard.LIMITS, guard.RATIO, guard.LOW, guard.HIGH
    )


@compiled
def store_limits(memory: FloatArray, shape: IntArray, parameters: FloatArray) -> None:
    for i in range(guard.LIMITS):
        memory[OWN_MEMORY + i] = parameters[i]


@internal
def step_forward(
    memory: FloatArray, shape: IntArray, tables: FloatArray, readings: FloatArray
) -> float:
    memory[FIRST_STEP] = 0.0
    gains = part(memory, OWN_MEMORY, guard.LIMITS)
    return compiled_laws.feed_forward(gains, readings[0])


@internal
def step_tuned(
    memory: FloatArray, shape: IntArray, tables: FloatArray, readings: FloatArray
) -> float:
    seen = admitted(memory, readings)
    signals = part(memory, CABLES, tuned_feedback.SIGNAL_SIZE)
    if memory[FIRST_STEP] != 0.0:
        signals[:] = 0.0
        memory[FIRST_STEP] = 0.0
    return tuned_feedback.tuned_torque(
        part(memory, law_steps.GAINS, law_steps.GAIN_COUNT),
        part(memory, law_steps.SPRING, guard.SPRING_SIZE),
        rows_of(tables, 4, shape[0], shape[1]),
        part(tables, 0, 4),
        part(memory, OWN_MEMORY, compiled_laws.MEMORY_SIZE),
        signals,
        seen,
    )


@internal
def begun(
    memory: FloatArray,
    tables: FloatArray,
    gains: int,
    size: int,
    first: int,
    readings: FloatArray,
) -> FloatArray:
    """Complete the gains, begin where that is due; return a copy of what is measured.

    `tables` begin with the `gains` behind `DriveLimits`. In the memory the `size`
    numbers of the law are behind the gains, `first` of them the guard.
    """
    for i in range(guard.LIMITS, gains):
        memory[OWN_MEMORY + i] = tables[i - guard.LIMITS]
    law = part(memory, OWN_MEMORY + gains, size)
    if memory[FIRST_STEP] != 0.0:
        law[:] = 0.0
        memory[FIRST_STEP] = 0.0
    seen = law[first + guard.SEEN : first + guard.SEEN + guard.READINGS]
    for i in range(guard.READINGS):
        seen[i] = readings[i]
    return seen


@internal
def step_inverse(
    memory: FloatArray, shape: IntArray, tables: FloatArray, readings: FloatArray
) -> float:
    gains, size = backlash_inverse.GAINS, backlash_inverse.MEMORY_SIZE
    seen = begun(memory, tables, gains, size, backlash_inverse.GUARD, readings)
    spring = gains - guard.LIMITS
    return backlash_inverse.motor_torque(
        part(memory, OWN_MEMORY, gains),
        part(tables, spring, guard.SPRING_SIZE),
        rows_of(tables, spring + guard.SPRING_SIZE, shape[0], shape[1]),
        part(memory, OWN_MEMORY + gains, size),
        seen,
    )


@internal
def step_gaussian(
    memory: FloatArray, shape: IntArray, tables: FloatArray, readings: FloatArray
) -> float:
    gains, size, states = gaussian.GAINS, shape[0], gaussian.STATES
    seen = begun(memory, tables, gains, size, gaussian.GUARD, readings)
    spring = gains - guard.LIMITS
    model = spring + guard.SPRING_SIZE
    read = model + states * (states + 1)
    return gaussian.motor_torque(
        part(memory, OWN_MEMORY, gains),
        part(tables, spring, guard.SPRING_SIZE),
        gaussian.Design(
            rows_of(tables, model, states, states + 1),
            rows_of(tables, read, 2, states),
            rows_of(tables, read + 2 * states, states, 2),
            part(tables, read + 4 * states, 2),
        ),
        part(memory, OWN_MEMORY + gains, size),
        seen,
        rows_of(memory, OWN_MEMORY + gains + size, 2, states),
    )


@dataclass(frozen=True)
class SteppedLaw:
    """The compiled functions of a controller."""

    wrong_parameters: Callable[..., Any]
    store_parameters: Callable[..., Any]
    step: Callable[..., Any]
    tables: Callable[[Any], LawTables]
    """Function of the controller."""
    has_model: bool = False
    unread: frozenset[str] = frozenset()
    """Gains that it does not read."""
    fixed: frozenset[str] = frozenset()
    """Gains that what it was made with depends on."""
    gains: tuple[Parameter, ...] = GAINS
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
    numbers: str = "gains"
    """Attribute of the controller with its gains."""

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

    def parameters(self, made: Any) -> list[float]:
        """Return the parameters of a controller, in order; see `_law_steps`."""
        own = getattr(made, self.numbers)
        found = [float(getattr(own, gain.name)) for gain in self.gains]
        for one in made.drive.cables if self.has_model else ():
            found += one.proximal, one.distal, *one.cable.scalars
            found += chain(*one.cable.conduit)
        if isinstance(made, AdaptiveModel):
            found += made.taps.noise.ravel().tolist()
        return found


_FIXED_TUNING = frozenset(
    "period span rotor_0 rotor_1 motion_0 motion_1 motion_2 forgetting leak "
    "late lag creep".split()
)
_PREVIEW_GAINS = frozenset({"preview", "tolerance"})
_FEED_FORWARD_GAINS = frozenset(
    {"feed_forward", "stiffness", "rest_torque", "wrap_friction"}
)
"""Not read by a law with a model."""
_BY_NAME = {gain.name: gain for gain in GAINS}
_FEEDBACK = SteppedLaw(
    law_steps.wrong_gains,
    law_steps.store_gains,
    law_steps.step_proportional_integral,
    _feedback_tables,
    unread=_PREVIEW_GAINS,
    is_round=False,
)
_TUNED = dataclasses.replace(
    _FEEDBACK, step=step_tuned, tables=_tuned_tables, is_round=True
)
LIMITED = SteppedLaw(
    wrong_limits,
    store_limits,
    step_inverse,
    _inverse_tables,
    fixed=frozenset({"ratio", "period", "one_way", "inertia"}),
    gains=tuple(_BY_NAME[name] for name in guard.DriveLimits._fields),
    numbers="limits",
)
_MODEL = SteppedLaw(
    law_steps.wrong_model,
    law_steps.store_model,
    law_steps.step_model_based,
    _model_tables,
    has_model=True,
    unread=_PREVIEW_GAINS | _FEED_FORWARD_GAINS,
)
_PREDICTIVE = SteppedLaw(
    planner_steps.wrong_plan,
    planner_steps.store_plan,
    planner_steps.step_plan,
    _planner_tables,
    has_model=True,
    fixed=_FIXED_TUNING,
    gains=TUNING,
    seen=PLANNER_INPUTS,
    numbers="tuning",
)
LAWS: dict[type[Controller], SteppedLaw] = {
    FeedForward: dataclasses.replace(
        LIMITED,
        step=step_forward,
        tables=_forward_tables,
        unread=frozenset(guard.DriveLimits._fields) - {"ratio", "low", "high"},
        numbers="gains",
        fixed=frozenset({"period"}),
        seen=("desired_torque_nm",),
        is_round=False,
        unguarded=frozenset({"desired_torque_nm"}),
    ),
    ProportionalIntegral: _FEEDBACK,
    Feedback: _FEEDBACK,
    TunedFeedback: _TUNED,
    FrictionFeedForward: _TUNED,
    BacklashInverse: LIMITED,
    LinearQuadraticGaussian: dataclasses.replace(
        LIMITED, step=step_gaussian, tables=_gaussian_tables
    ),
    ModelBased: _MODEL,
    StictionCompensation: dataclasses.replace(
        _MODEL, step=law_steps.step_stiction, unread=_FEED_FORWARD_GAINS
    ),
    DisturbanceObserver: dataclasses.replace(
        _MODEL, step=law_steps.step_disturbance, tables=_disturbance_tables
    ),
    PredictiveCompensation: _PREDICTIVE,
    AdaptiveModel: dataclasses.replace(
        _PREDICTIVE,
        wrong_parameters=planner_steps.wrong_sensed,
        store_parameters=planner_steps.store_sensed,
        step=planner_steps.step_sensed,
        tables=_adaptive_tables,
        unread=frozenset({"learning"}),
        fixed=_FIXED_TUNING | {"learning"},
        needs_slope=True,
    ),
}
"""Controllers whose step is a compiled function; not their subclasses."""

STEPS = (
    step_forward, law_steps.step_proportional_integral, step_tuned, step_inverse,
    step_gaussian, law_steps.step_model_based, law_steps.step_stiction,
    law_steps.step_disturbance, planner_steps.step_plan, planner_steps.step_sensed,
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
        return step_forward(memory, shape, tables, readings)
    if place == 1:
        return law_steps.step_proportional_integral(memory, shape, tables, readings)
    if place == 2:
        return step_tuned(memory, shape, tables, readings)
    if place == 3:
        return step_inverse(memory, shape, tables, readings)
    if place == 4:
        return step_gaussian(memory, shape, tables, readings)
    if place == 5:
        return law_steps.step_model_based(memory, shape, tables, readings)
    if place == 6:
        return law_steps.step_stiction(memory, shape, tables, readings)
    if place == 7:
        return law_steps.step_disturbance(memory, shape, tables, readings)
    if place == 8:
        return planner_steps.step_plan(memory, shape, tables, readings)
    return planner_steps.step_sensed(memory, shape, tables, readings)
