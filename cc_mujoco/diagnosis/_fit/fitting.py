"""Parameters of the simulated rig from records, by least squares in the loop.

Residuals are divided by the noise floor of their channel and weighted by how many of
them are independent, so that priors and intervals count for what they are worth.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.diagnosis._fit.jacobian import HUBER_DELTA, TorqueDerivatives, jacobian
from cc_mujoco.diagnosis._rig.bench_simulation import SimulatedRig, plausible_range
from cc_mujoco.diagnosis.effects import EffectParameter, form_key
from cc_mujoco.estimation import _least_squares as least_squares
from cc_mujoco.estimation._least_squares import Fit, Tuned, autocorrelation
from cc_mujoco.native import FloatArray

Masks = Sequence[NDArray[np.bool_]]
"""For every record the samples that take part."""

_MAX_EVALUATIONS = 30
"""Most of a fit: where the baseline ran away to make up for what is missing, the way
back along a flat valley takes twenty."""
_RELATIVE_TOLERANCE = 1e-3
"""Share of the cost by which a fit goes on."""
_MAX_CORRECTIONS = 4
"""Most fits of a corrected coarse simulation in place of one of a fine one."""
_COST_TOLERANCE = 5e-3
"""Tolerance of the cost of a reported fit: a tenth of a standard deviation."""


def tuned_effect_parameter(
    parameter: EffectParameter, start: float, plant: SimulatedRig
) -> Tuned:
    """Return a parameter of an effect as a tuned parameter of the fit.

    Half of the largest plausible size is its prior's deviation: where the data leave a
    direction open, say an offset of both torques against that of an angle, it stays
    small.
    """
    described = parameter.parameter
    low, high = described.low, described.high
    size = parameter.typical
    if parameter.shape:
        bounds = (low - start) / size, (high - start) / size
        return _inset_bounds(Tuned(described, start, size, *bounds))
    if not parameter.linear:
        bounds = math.log(low / start), math.log(high / start)
        return _inset_bounds(Tuned(described, start, 1.0, *bounds))
    prior = 0.5 * plausible_range(parameter, plant)[1] / size
    return _inset_bounds(Tuned(described, 0.0, size, low / size, high / size, prior))


def _inset_bounds(tuned: Tuned) -> Tuned:
    """Return the same with bounds at which no rounding takes the value beyond its own.

    What a parameter of a cable may be ends there, and a fit ends at its bounds.
    """
    low, high = tuned.parameter.low, tuned.parameter.high
    while tuned.value(tuned.low) < low:
        tuned = tuned._replace(low=math.nextafter(tuned.low, math.inf))
    while tuned.value(tuned.high) > high:
        tuned = tuned._replace(high=math.nextafter(tuned.high, -math.inf))
    return tuned


@dataclass(frozen=True)
class Problem:
    """Parameters of a fit and the records they are fitted to.

    Attributes:
        plant: simulates.
        tuned: every free parameter, baseline first.
        effects: ids that are present.
        noise: (2, samples) of every record, what no model explains [N m].
        floor: the same, by which errors are divided, see `noise_floor.NoiseFloor` [N
            m].
        weight: of a residual over its floor; below 1 where neighbours are not
            independent or where the model is known not to reach the floor.
        inflation: factor of the floor where the baseline is far off, see
            `with_inflated_noise`.
        scatter: the part of `noise` by which repetitions differ beyond that of
            sensors; a wrong model makes some of it.
        forms: values that select the forms of effects, see `form_key`.
        defect: (2, samples) of every record that is added to the simulated torques,
            see `corrected` [N m]; none where it is empty.
        slopes: derivatives of the plant's torques, shared with other noise.
    """

    plant: SimulatedRig
    tuned: tuple[Tuned, ...]
    effects: tuple[str, ...]
    noise: tuple[FloatArray, ...]
    floor: tuple[FloatArray, ...]
    weight: float = 1.0
    inflation: float = 1.0
    scatter: FloatArray | float = 0.0
    forms: Mapping[str, float] = field(default_factory=dict)
    defect: tuple[FloatArray, ...] = ()
    slopes: TorqueDerivatives = field(
        default_factory=TorqueDerivatives, compare=False, repr=False
    )

    def with_inflated_noise(self, x: FloatArray, masks: Masks) -> Problem:
        """Return the same with its floor raised to where usual errors are not wild.

        Where the sensors are much better than the model, nearly every error would be
        Huber residuals, and fits follow the many small ones only.
        """
        kept = [
            np.abs(error[:, mask]).ravel()
            for error, mask in zip(self.plainly(x), masks, strict=True)
        ]
        usual = self.inflation * float(np.median(np.concatenate(kept))) / 0.6745
        factor = max(1.0, usual / HUBER_DELTA)
        change = factor / self.inflation
        return replace(
            self, floor=tuple(change * floor for floor in self.floor), inflation=factor
        )

    def with_updated_floor(self, x: FloatArray, masks: Masks) -> Problem:
        """Return the same with floor and weight by the errors of this model.

        Those of the baseline are large where an effect is missing: by its floor
        numerical errors look harmless, and by its weight the data say next to nothing.
        """
        problem = self.with_inflated_noise(x, masks)
        return replace(problem, weight=independence_weight(problem.errors(x), masks))

    def simulated_by(self, plant: SimulatedRig) -> Problem:
        """Return the same problem with another plant of the same records.

        It begins with the derivatives of this one, which hardly depend on how finely
        the rig is simulated.
        """
        return replace(self, plant=plant, slopes=TorqueDerivatives(self.slopes))

    def sharing(self, known: Sequence[Problem]) -> Problem:
        """Return the same, beginning with derivatives of a model of its parameters.

        Args:
            known: models with derivatives; the last with the same parameters counts.
        """
        for other in reversed(known):
            if other.tuned == self.tuned and other.effects == self.effects:
                return replace(self, slopes=TorqueDerivatives(other.slopes))
        return self

    @property
    def coarse(self) -> Problem:
        """Same problem with the plant that suffices for differences."""
        plant = self.plant.coarse
        return self if plant is self.plant else replace(self, plant=plant)

    def corrected(self, x: FloatArray, seen: Sequence[int]) -> Problem:
        """Return `coarse` with torques that are those of this model at a place.

        Nearby they differ by how far the numerical error changes (defect correction:
        Stetter, Numerische Mathematik 29, 1978).

        Args:
            x: the place.
            seen: indices of the records for which that is wanted.
        """
        rough = self.coarse
        defect = [np.zeros(record.measured.shape) for record in self.plant.records]
        fine = self.torques(x, seen)
        for k, a, b in zip(seen, fine, rough.torques(x, seen), strict=True):
            defect[k] = a - b
        return replace(rough, defect=tuple(defect))

    def form(self, name: str) -> str:
        """Return the form in which an effect is in the model, "" of only one."""
        return self.plant.library.effects[name].form(self.forms)

    @property
    def sensed(self) -> tuple[FloatArray, ...]:
        """Return the effect of sensor noise on every record, as `noise` [N m]."""
        part = np.square(self.scatter)
        return tuple(np.sqrt(np.maximum(n**2 - part, 0.0)) for n in self.noise)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(parameter.name for parameter in self.tuned)

    def values(self, x: FloatArray) -> dict[str, float]:
        """Return the parameters at a place of the fit, even just beyond a bound."""
        fitted = {
            parameter.name: parameter.value(
                min(max(float(place), parameter.low), parameter.high)
            )
            for parameter, place in zip(self.tuned, x, strict=True)
        }
        return {**self.forms, **fitted}

    def place(self, values: Mapping[str, float]) -> FloatArray:
        """Return the place of the fit of these values, and of the start elsewhere."""
        return np.array(
            [
                parameter.place(values.get(parameter.name, parameter.start))
                for parameter in self.tuned
            ]
        )

    def with_effect(self, name: str, start: dict[str, float]) -> Problem:
        """Return the same with an effect more, its shape and form from `start`."""
        key = form_key(name)
        more = tuple(
            tuned_effect_parameter(
                parameter, start.get(parameter.name, parameter.typical), self.plant
            )
            for parameter in self.plant.library.effects[name].parameters
        )
        return replace(
            self,
            tuned=(*self.tuned, *more),
            effects=(*self.effects, name),
            forms={**self.forms, **{k: v for k, v in start.items() if k == key}},
            slopes=TorqueDerivatives(self.slopes),
        )

    def placed(self, x: FloatArray, start: Mapping[str, float]) -> FloatArray:
        """Return the start of a fit that adds an effect's `start` to another."""
        new = [
            (start[parameter.name] - parameter.start) / parameter.scale
            if not parameter.factor
            else 0.0
            for parameter in self.tuned[x.size :]
        ]
        return np.concatenate([x, new])

    def without(self, name: str) -> Problem:
        """Return the same without an effect."""
        effect = self.plant.library.effects[name]
        gone = {parameter.name for parameter in effect.parameters}
        return replace(
            self,
            tuned=tuple(p for p in self.tuned if p.name not in gone),
            effects=tuple(e for e in self.effects if e != name),
            forms={k: v for k, v in self.forms.items() if k != form_key(name)},
            slopes=TorqueDerivatives(),
        )

    def errors(self, x: FloatArray, masks: Masks | None = None) -> list[FloatArray]:
        """Return Huber's errors relative to the floor, (2, samples) per record.

        They are NaN in records of which no sample is set, where masks are given.
        """
        if masks is None:
            return [huber_residual(error) for error in self.plainly(x)]
        found = [np.full(floor.shape, np.nan) for floor in self.floor]
        seen = [k for k, mask in enumerate(masks) if mask.any()]
        for k, error in zip(seen, self.plainly(x, seen), strict=True):
            found[k] = huber_residual(error)
        return found

    def plainly(
        self, x: FloatArray, only: Sequence[int] | None = None
    ) -> list[FloatArray]:
        """Return measured minus simulated over the floor, (2, samples) per record.

        Args:
            x: place of the parameters.
            only: indices of the records that are wanted; default all.
        """
        chosen = range(len(self.floor)) if only is None else only
        return [
            (self.plant.records[k].measured - torque) / self.floor[k]
            for k, torque in zip(chosen, self.torques(x, chosen), strict=True)
        ]

    def torques(
        self, x: FloatArray, only: Sequence[int] | None = None
    ) -> list[FloatArray]:
        """Return the simulated torques of each record (2, samples) [N m]."""
        played = self.plant.simulate(self.values(x), self.effects, only)
        if not self.defect:
            return played
        chosen = range(len(self.defect)) if only is None else only
        return [
            torque + self.defect[k] for k, torque in zip(chosen, played, strict=True)
        ]

    def residual(self, x: FloatArray, masks: Masks) -> FloatArray:
        """Return the weighted errors within the masks, then those of the priors."""
        parts = [
            self.weight * error[:, mask].ravel()
            for error, mask in zip(self.errors(x, masks), masks, strict=True)
        ]
        known = [
            -place / parameter.prior
            for parameter, place in zip(self.tuned, x, strict=True)
            if math.isfinite(parameter.prior)
        ]
        return np.concatenate([*parts, np.array(known)])


def huber_residual(error: FloatArray) -> FloatArray:
    """Return the errors whose squares grow linearly beyond `HUBER_DELTA` (Huber).

    A few large ones must not rule the fit.
    """
    size = np.abs(error)
    root = np.sqrt(np.maximum(2.0 * HUBER_DELTA * size - HUBER_DELTA**2, 0.0))
    found: FloatArray = np.where(size <= HUBER_DELTA, error, np.sign(error) * root)
    return found


def plain_error(residual: FloatArray) -> FloatArray:
    """Return the errors of which `huber_residual` makes these residuals."""
    size = np.abs(residual)
    large = (size**2 + HUBER_DELTA**2) / (2.0 * HUBER_DELTA)
    found: FloatArray = np.where(
        size <= HUBER_DELTA, residual, np.sign(residual) * large
    )
    return found


def independence_weight(errors: Sequence[FloatArray], masks: Masks) -> float:
    """Return the weight that makes squared errors count as independent.

    The root of the share of samples that are independent (the sum of autocorrelations,
    up to their first zero), over the RMS error where that exceeds 1.
    """
    lags = 200
    total = np.zeros(lags)
    count, square = 0, 0.0
    for error, mask in zip(errors, masks, strict=True):
        kept = np.where(mask, error, 0.0)
        for row in kept:
            correlation = autocorrelation(row)[:lags]
            total[: correlation.size] += correlation
        count += len(error) * int(np.sum(mask))
        square += float(np.sum(kept**2))
    shape = total / max(total[0], 1e-300)
    end = int(np.argmax(shape < 0.02)) or lags
    independent = 1.0 / max(1.0 + 2.0 * float(np.sum(shape[1:end])), 1.0)
    return math.sqrt(independent) / max(math.sqrt(square / max(count, 1)), 1.0)


def fit(
    problem: Problem,
    start: FloatArray,
    masks: Masks,
    evaluations: int = _MAX_EVALUATIONS,
) -> Fit:
    """Fit least squares within bounds from a start.

    Where the rig is simulated finely, corrected coarse simulations are fitted.

    Args:
        problem: what is fitted to what.
        start: place of the parameters.
        masks: samples that take part.
        evaluations: most of them.
    """
    if problem.coarse is problem:
        return _descend(problem, start, masks, evaluations)
    return _descend_coarsely(problem, start, masks, evaluations)


def _descend(
    problem: Problem,
    start: FloatArray,
    masks: Masks,
    evaluations: int,
    tolerance: float = _RELATIVE_TOLERANCE,
) -> Fit:
    return least_squares.fit(
        lambda x: problem.residual(x, masks),
        lambda x: jacobian(problem, x, masks),
        problem.tuned,
        start,
        tolerance=tolerance,
        evaluations=evaluations,
    )


def _descend_coarsely(
    problem: Problem,
    start: FloatArray,
    masks: Masks,
    evaluations: int,
    tolerance: float = _RELATIVE_TOLERANCE,
) -> Fit:
    """Fit `Problem.corrected` until its end is none for the fine simulation."""
    low, high = (
        np.array([getattr(p, side) for p in problem.tuned]) for side in ("low", "high")
    )
    x: FloatArray = np.clip(start, low, high)
    seen = [k for k, mask in enumerate(masks) if mask.any()]
    cost = _cost(problem, x, masks)
    for _ in range(_MAX_CORRECTIONS):
        rough = problem.corrected(x, seen)
        there = _descend(rough, x, masks, evaluations, tolerance).x
        gain = cost - _cost(problem, there, masks)
        if gain > 0.0:
            x, cost = there, cost - gain
        if gain <= tolerance * cost:
            break
    return Fit(x, cost)


def _cost(problem: Problem, x: FloatArray, masks: Masks) -> float:
    error = problem.residual(x, masks)
    return 0.5 * float(error @ error)


def fit_until_settled(problem: Problem, start: FloatArray, masks: Masks) -> Fit:
    """Fit the same, to an end that errors decide and not where the fit gave up.

    Along a flat valley (friction against pretension, where no trial goes slack) a
    thousandth of the cost is standard deviations away from the least.
    """
    found = fit(problem, start, masks)
    tolerance = min(
        _RELATIVE_TOLERANCE, _COST_TOLERANCE / max(found.cost, _COST_TOLERANCE)
    )
    coarsely = problem.coarse is not problem
    descend = _descend_coarsely if coarsely else _descend
    return descend(problem, found.x, masks, _MAX_EVALUATIONS, tolerance)
