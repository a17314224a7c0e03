"""Controllers that can be exported, and the numbers that they are given.

plan = ExportPlan.of("stiction", [drive], [("flexor", "extensor")])
plan.fields[0].name, plan.values()[0]      # "ratio", 5.2
"""

import itertools
import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cc_mujoco._utils.provenance import POLICY_ENDING, is_user_controller
from cc_mujoco.cable import PARAMETERS
from cc_mujoco.cable._cable import TERMS
from cc_mujoco.control import CONTROLLERS, Policy, PredictiveCompensation
from cc_mujoco.control import _guard as guard
from cc_mujoco.control import _law_steps as law_steps
from cc_mujoco.control import _planner_steps as planner_steps
from cc_mujoco.control import _policy as policies
from cc_mujoco.control import _registry as registry
from cc_mujoco.control._controller import LawTables, SteppedLaw, stepped_law
from cc_mujoco.control._decoupling import Coupling
from cc_mujoco.control._network import WIDTHS, PackedNetwork, shares_of
from cc_mujoco.device import _observation as observation
from cc_mujoco.device._drive import CableDrive, Drive
from cc_mujoco.device._sensors import RATIO_COLUMN, WINDING_COLUMNS
from cc_mujoco.errors import CableError, look_up
from cc_mujoco.estimation._tension_slope import has_slope
from cc_mujoco.export._joint_torques import JointTorques
from cc_mujoco.native import FloatArray, internal

EXPORTED = tuple(name for name, kind in CONTROLLERS.items() if stepped_law(kind))
"""Names of the controllers that can be exported."""


_COLUMNS, _HOLD, _HISTORY, _PLAYS, _IS_WOUND, _NETWORK = range(6)
"""Places in a policy's `LawTables.shape`: counts of columns, samples of an action,
earlier frames and plays; 1 where the joint winds; then `PackedNetwork.sizes`."""
_BEGUN, _SAMPLE, _SHARE, _POLICY_SIZE = range(guard.MEMORY_SIZE, guard.MEMORY_SIZE + 4)
"""Places in the memory behind the guard: 1 once the policy has begun; samples since the
last action; that action. Then measurements, plays, earlier frames and scratch."""


@internal
def step_policy(data: law_steps.LawData) -> float:
    memory, shape, tables, readings = data
    columns, history, plays = shape[_COLUMNS], shape[_HISTORY], shape[_PLAYS]
    gains, spring, law, _ = law_steps.begun(data, policies.GAINS, _POLICY_SIZE, 0)
    first = law_steps.OWN_MEMORY + policies.GAINS + _POLICY_SIZE
    place = policies.GAINS - guard.LIMITS + guard.SPRING_SIZE  # of `Past.ratio`
    measured = law_steps.part(memory, first, columns)
    measured[:] = readings[:columns]
    wound = len(WINDING_COLUMNS) if shape[_IS_WOUND] != 0 else 0
    guarded = guard.Guarded(gains, spring, law)
    policies.admit_measured(guarded, measured, law_steps.part(readings, columns, wound))
    past = observation.Past(
        tables[place],
        law_steps.part(tables, place + 1, columns),
        law_steps.part(tables, place + 1 + columns, plays),
        law_steps.rows_of(memory, first, 1, columns),
        law_steps.rows_of(memory, first + columns, 1, plays),
        law_steps.tables_of(memory, first + columns + plays, 1, history, columns + 1),
    )
    if law[guard.STARTED] != 0.0:
        if law[_BEGUN] == 0.0:
            observation.begin_past(past, 0)
            law[_BEGUN], law[_SAMPLE] = 1.0, 0.0
        else:
            observation.follow_past(past, 0)
        if law[_SAMPLE] == 0.0:
            scratch = first + columns + plays + history * (columns + 1)
            place, widest = place + 1 + columns + plays, 0
            net = PackedNetwork(
                law_steps.whole_part(shape, _NETWORK, shape.size - _NETWORK),
                law_steps.part(tables, place, tables.size - place),
            )
            for i in range(WIDTHS, net.sizes.size):
                widest = max(widest, net.sizes[i])
            work = law_steps.rows_of(memory, scratch, 2, widest)
            observation.write_observation(
                past, law_steps.rows_of(memory, scratch, 1, widest), 0
            )
            law[_SHARE] = np.float32(work[shares_of(net, work), 0])
            observation.act_past(past, 0, law[_SHARE])
        law[_SAMPLE] += 1.0
        if law[_SAMPLE] >= shape[_HOLD]:
            law[_SAMPLE] = 0.0
    torque = law[_SHARE] * gains[policies.WHOLE]
    return guard.passed(guarded, gains[policies.RELEASE], torque)


class SteppedPolicy(Policy):
    """A policy of one axis as a controller with a compiled step."""

    @property
    def stepped(self) -> SteppedLaw:
        (axis,), (observed,) = self.axes, self.observed
        return SteppedLaw(
            step_policy,
            fixed=frozenset({"ratio", "period", "one_way", "inertia"}),
            seen=(*observed.columns, *(WINDING_COLUMNS if axis.is_wound else ())),
            unguarded=frozenset(axis.unguarded),
            is_round=False,
            is_policy=True,
        )

    def parameters(self) -> list[float]:
        return [float(limit) for limit in self.limits]

    def law_tables(self) -> LawTables:
        (axis,), (own,), net = self.axes, self.observed, self.network.packed
        past = observation.ObservationHistory(own, 1).past
        observed = [past.ratio], past.units, past.reach
        numbers = axis.gains[guard.LIMITS :], axis.spring, *observed, net.numbers
        counts = own.frame, own.hold, own.history, past.reach.size, int(axis.is_wound)
        first = law_steps.OWN_MEMORY + policies.GAINS
        size = past.measured.size + past.plays.size + past.frames.size
        size += first + _POLICY_SIZE + 2 * int(net.sizes[WIDTHS:].max())
        shape, given = (*counts, *net.sizes.tolist()), (first + guard.COMMAND,)
        return LawTables(shape, tuple(np.concatenate(numbers).tolist()), size, given)


@dataclass(frozen=True)
class Field:
    """Parameter of an exported controller: name in C, bounds and value."""

    name: str
    unit: str
    low: float
    high: float
    value: float
    meaning: str


@dataclass(frozen=True)
class AxisPlan:
    """Plan of an exported controller of one axis: its law, numbers and readings."""

    law: SteppedLaw
    tables: LawTables
    fields: tuple[Field, ...]  # parameters in the order in which C has them
    columns: tuple[str, ...]  # columns that the law reads, but for tensions
    other_columns: tuple[str, ...]  # columns that convert the torques which it reads
    cables: tuple[str, ...]  # names in C of the cables that its model has
    taps: planner_steps.Taps | None = None  # tension sensors, if it reads them
    prefix: str = ""  # of the names of readings and gains, with several axes

    @classmethod
    def of(
        cls,
        name: str,
        drive: Drive,
        cables: tuple[str, ...],
        prefix: str = "",
        decoupled: bool = False,
        iterations: float = math.inf,
    ) -> "AxisPlan":
        """Plan a controller with its default gains.

        Names of readings and gains begin with `prefix`. If `decoupled`, it reads the
        torques of its own cables. `iterations` is as in `PredictiveCompensation`,
        infinite for others.
        """
        made, law = _law_of(name, drive, iterations)
        known = made.drive.cables if law.has_model else ()
        names = tuple(map(_identifier, cables))[: len(known)]
        values = iter(made.parameters())
        fields: list[Field] = []
        for gain in law.gains:
            value, meaning, (low, high) = next(values), gain.meaning, _bounds(gain)
            if gain.name in law.unread:
                meaning += "; this controller does not read it"
            # The decoupling of axes rests on these.
            rests = decoupled and gain.name in ("ratio", "high", "safe_torque")
            if rests or gain.name in law.fixed:
                low, high, meaning = value, value, f"{meaning}; fixed by the export"
            name = prefix + gain.name
            fields.append(Field(name, gain.unit, low, high, value, meaning))
        for cable, own in zip(names, known, strict=True):
            fields += _cable_parameters(cable, own, values, law)
        if (taps := getattr(made, "taps", None)) is not None:
            fields += _sensor_parameters(names, taps, values)
        is_wound = drive.lever or drive.crossed
        others: list[str] = []
        if is_wound and (law.is_round or decoupled):
            others.append(WINDING_COLUMNS[2])
        if decoupled:
            others += [RATIO_COLUMN.format(joint=one) for one in drive.shared_ratios]
        columns = law.wound if is_wound else law.seen, tuple(others)
        return cls(law, made.law_tables(), tuple(fields), *columns, names, taps, prefix)

    @property
    def guarded(self) -> tuple[bool, ...]:
        """True for each reading that the guard checks; a leverage counts as checked."""
        own = [name not in self.law.unguarded for name in self.columns]
        tensions = [False for _ in self.tension_readings]
        return (*own, *tensions, *[True for _ in self.other_columns])

    @property
    def seen(self) -> tuple[str, ...]:
        """Names in C of all readings of the axis."""
        own, other = (
            [self.prefix + _identifier(name) for name in names]
            for names in (self.columns, self.other_columns)
        )
        return (*own, *(name for name, _, _ in self.tension_readings), *other)

    @property
    def tension_readings(self) -> tuple[tuple[str, str, int], ...]:
        """Name of the reading, cable and node of every tension sensor."""
        if self.taps is None:
            return ()
        return tuple(
            (f"tension_{cable}_{place}_n", cable, node)
            for cable, nodes in zip(self.cables, self.taps.nodes.tolist(), strict=True)
            for place, node in enumerate(nodes)
        )


@dataclass(frozen=True)
class ExportPlan:
    """Plan of the exported controller of a device."""

    axes: tuple[AxisPlan, ...]
    names: tuple[str, ...]  # of the axes in C; an empty one of a device with one axis
    torques: JointTorques

    @classmethod
    def of(
        cls,
        given: str,
        drives: Sequence[Drive],
        cables: Sequence[tuple[str, ...]],
        prefixes: Sequence[str] = ("",),
        iterations: float = math.inf,
    ) -> "ExportPlan":
        """Plan a controller of `control.axes_controller` with its default gains.

        Drives, names of cables and beginnings of columns have an entry for every axis;
        for `iterations` see `PredictiveCompensation`.

        Raises:
            CableError: There is no such controller, it cannot be exported, it needs
                cables and there are none, or iterations are limited where none plans.
        """
        if len(drives) > 1 and registry.is_policy(given):
            raise CableError(
                f"policy {given!r} drives several axes at once, and C has policies of "
                "one axis; --target onnx writes its network."
            )
        is_decoupled, coupling = registry.is_decoupled(given), None
        laws = [given]
        if len(drives) > 1 or is_decoupled:
            laws = list(map(str, registry.by_axis(given, prefixes)))
        if is_decoupled:
            drives, coupling = registry.decoupled_drives(drives, prefixes)
        # A name in C does not begin with a digit.
        plain = [_identifier(prefix.rstrip(".")) for prefix in prefixes]
        names = tuple(re.sub(r"^(?=\d)", "_", name) for name in plain)
        axes = []
        for law, drive, own, name in zip(laws, drives, cables, names, strict=True):
            start = f"{name}_" if name else ""
            axes.append(AxisPlan.of(law, drive, own, start, is_decoupled, iterations))
        if iterations < math.inf and not any(axis.law.plans for axis in axes):
            raise CableError(f"controller {given!r} plans nothing: no iterations.")
        for what, found in (
            ("parameters", [field.name for axis in axes for field in axis.fields]),
            ("readings", [name for axis in axes for name in axis.seen]),
            ("axes", names),
        ):
            (name, count), *_ = Counter(map(str.upper, found)).most_common(1)
            if count > 1:
                raise CableError(
                    f"several {what} have the name {name} in C; rename a cable or axis."
                )
        return cls(tuple(axes), names, _joint_torques(axes, drives, coupling))

    @property
    def fields(self) -> tuple[Field, ...]:
        """Parameters in the order in which C has them."""
        return tuple(field for axis in self.axes for field in axis.fields)

    def values(self) -> FloatArray:
        """Return the parameters, in order."""
        return np.array([field.value for field in self.fields])

    @property
    def period(self) -> float:
        """Time between two steps [s]."""
        return next(f.value for f in self.fields if f.name.endswith("period"))

    @property
    def seen(self) -> tuple[str, ...]:
        """Names of all readings in C, in order."""
        return tuple(name for axis in self.axes for name in axis.seen)

    @property
    def guarded(self) -> tuple[int, ...]:
        """Flag of every reading: 1 if the guard of its axis checks it."""
        checks = self.torques.coupling is None
        return tuple(int(checks and own) for axis in self.axes for own in axis.guarded)

    @property
    def starts(self) -> tuple[int, ...]:
        """Index of every axis' first number in the memory, and the end of all."""
        sizes = (axis.tables.size for axis in self.axes)
        return tuple(itertools.accumulate(sizes, initial=0))

    @property
    def memory_size(self) -> int:
        """Number of floats in the memory of a controller."""
        return self.starts[-1] + self.torques.memory_size


def _law_of(name: str, drive: Drive, iterations: float) -> tuple[Any, SteppedLaw]:
    """Return a controller, default but for `iterations`, and its functions."""
    if name.endswith(POLICY_ENDING):
        policy = SteppedPolicy(drive, name)
        return policy, policy.stepped
    if is_user_controller(name):
        raise CableError(
            f"controller {name!r} cannot be exported, for code from outside is not "
            f"compiled; policies and {', '.join(EXPORTED)} can be."
        )
    kind = look_up("controller", name, CONTROLLERS)
    if (law := stepped_law(kind)) is None:
        raise CableError(
            f"controller {name!r} cannot be exported, for its step is not one "
            f"compiled function; {', '.join(EXPORTED)} can be."
        )
    if issubclass(kind, PredictiveCompensation):
        return kind(drive, iterations=iterations), law
    return kind(drive), law


def _joint_torques(
    axes: Sequence[AxisPlan], drives: Sequence[Drive], coupling: Coupling | None
) -> JointTorques:
    """Return the `JointTorques` of a device, with indices among all axes' readings."""
    rows, shared, start = [], [], 0
    for place, (axis, drive) in enumerate(zip(axes, drives, strict=True)):
        end = start + len(axis.seen)
        columns = {name: start + k for k, name in enumerate(axis.columns)}
        first = end - len(axis.other_columns)
        others = {name: first + k for k, name in enumerate(axis.other_columns)}
        start, leverage = end, others.get(WINDING_COLUMNS[2], -1)
        torque, desired = (columns.get(name, -1) for name in registry.OWN_COLUMNS)
        divided, own = int(axis.law.is_round and leverage >= 0), 0
        if coupling is not None:
            if min(torque, desired) < 0:
                raise CableError(
                    "axes whose controllers do not read the torque of their joint "
                    "cannot be decoupled."
                )
            own = int(coupling.tables.own[place])
            for joint in drive.shared_ratios:
                column = others[RATIO_COLUMN.format(joint=joint)]
                shared.append((coupling.joints.index(joint), place, column))
        rows.append((own, torque, desired, leverage, divided))
    if coupling is None:
        return JointTorques(start, tuple(rows))
    ratios = tuple(drive.ratio for drive in drives)
    return JointTorques(start, tuple(rows), tuple(shared), ratios, coupling.tables)


def _identifier(name: str) -> str:
    return re.sub(r"\W", "_", name, flags=re.ASCII)


def _bounds(parameter: Any) -> tuple[float, float]:
    low = parameter.low
    return math.nextafter(low, math.inf) if parameter.low_open else low, parameter.high


def _sensor_parameters(
    cables: Sequence[str], taps: planner_steps.Taps, values: Iterator[float]
) -> Iterator[Field]:
    least = math.nextafter(0.0, 1.0)
    for cable, nodes in zip(cables, taps.nodes.tolist(), strict=True):
        for place, node in enumerate(nodes):
            yield Field(
                f"{cable}_sensor_{place}_deviation", "N", least, 1e9, next(values),
                f"standard deviation of the tension sensor at node {node}",
            )  # fmt: skip


def _cable_parameters(
    name: str, own: CableDrive, values: Iterator[float], law: SteppedLaw
) -> Iterator[Field]:
    still: set[str] = set()  # what must stay to keep the slope of the tension
    if law.needs_slope:
        still = {name for name, term in TERMS.items() if not has_slope(term)}
        terms = still & set(own.cable.terms)
        still |= {TERMS[term].constant_without for term in terms} - {""}
    most, least = 1e6, math.nextafter(0.0, 1.0)
    for side, end in (("proximal", "motor"), ("distal", "joint")):
        yield Field(
            f"{name}_{side}", "m/rad", -most, most, next(values),
            f"displacement of the {side} end per angle of the {end}, signed, not 0",
        )  # fmt: skip
    for parameter, value in zip(PARAMETERS, values, strict=False):
        low, high = _bounds(parameter)
        if own.cable.path == "open" and parameter.name.startswith("seal_"):
            high = 0.0
        if law.needs_slope and parameter.name == "friction":
            low = planner_steps.MIN_BELIEVED_FRICTION
        meaning = parameter.meaning
        if parameter.name in still:
            low, high, meaning = value, value, meaning + "; fixed by the export"
        field = f"{name}_{parameter.name}"
        yield Field(field, parameter.unit, low, high, value, meaning)
    for i in range(len(own.cable.conduit)):
        yield Field(
            f"{name}_length_{i}", "m", least, most, next(values),
            f"length of section {i} of the conduit, from the motor",
        )  # fmt: skip
        yield Field(
            f"{name}_radius_{i}", "m", least, math.inf, next(values),
            "its bend radius; infinite where it is straight",
        )  # fmt: skip
        for factor, low in (("clearance", 0.0), ("seating_tension", least)):
            yield Field(
                f"{name}_{factor}_{i}", "1", low, most, next(values),
                f"factor on {factor} in it",
            )  # fmt: skip
