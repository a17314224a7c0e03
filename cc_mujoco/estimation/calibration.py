"""Parameters of a transmission from recorded trials, with intervals (thesis 2.4.2).

    trial = Trial(
        dt=0.005,
        inputs={"motor_torque": torque, "joint_angle": angle},
        outputs={"joint_torque": measured},
        noise={"joint_torque": 5e-4},
    )
    found = calibrate([trial], transmission, ("friction", "axial_stiffness"))
    print(found)            # values, intervals, and what the data cannot tell

Trials are played through the transmission from rest, so each begins at rest in its
pretension. Parameters are fitted as logarithms by least squares on the simulated
outputs; friction makes these piecewise smooth in the parameters, so derivatives are
central differences over 0.1 % and the fit starts from several places.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from cc_mujoco.compiled import FloatArray
from cc_mujoco.errors import CableError
from cc_mujoco.transmission import PARAMETERS, Driven, Section, Transmission

SIDES = ("motor_angle", "motor_torque", "joint_angle", "joint_torque")
RADII = ("motor_radius", "joint_radius")
WRAP = "wrap"
"""Scale of all wrap angles of the conduits; 1 as they are given."""

_STEP = 1e-3
_SPREAD = math.log(3.0)
_UNTOLD = 0.5
"""A combination of logarithms less certain than this (one sigma) is not determined."""


@dataclass(frozen=True)
class Trial:
    """One recorded motion, from rest.

    Attributes:
        dt: time between samples [s].
        inputs: one quantity of `SIDES` for the motor and one for the joint, (samples,).
        outputs: measured quantities of `SIDES` that are no inputs, (samples,).
        noise: standard deviation of every output.
    """

    dt: float
    inputs: Mapping[str, FloatArray]
    outputs: Mapping[str, FloatArray]
    noise: Mapping[str, float]

    def __post_init__(self) -> None:
        for name in (*self.inputs, *self.outputs):
            if name not in SIDES:
                raise CableError.unknown("quantity of a trial", name, SIDES)
        if not self.outputs or set(self.outputs) & set(self.inputs):
            raise CableError(
                f"a trial with inputs {sorted(self.inputs)} needs outputs other than "
                f"these, not {sorted(self.outputs)}"
            )
        lengths = {len(v) for v in (*self.inputs.values(), *self.outputs.values())}
        if len(lengths) != 1:
            raise CableError(
                f"the columns of a trial have {sorted(lengths)} samples; "
                "all must have the same number"
            )
        for name, values in self.outputs.items():
            if not np.all(np.isfinite(values)):
                raise CableError(f"output `{name}` of a trial has values not finite")
            if not self.noise.get(name, 0.0) > 0.0:
                raise CableError(
                    f"noise of output `{name}` is {self.noise.get(name)!r}; "
                    "give its standard deviation, greater than 0"
                )


@dataclass(frozen=True)
class Estimate:
    """One fitted parameter: its value and the 95 % confidence interval."""

    name: str
    unit: str
    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Calibration:
    """What a fit found.

    Attributes:
        estimates: one per free parameter.
        transmission: with the values found.
        correlation: of the logarithms of the parameters (free, free).
        undetermined: one sentence for every combination that the data do not tell.
        misfit: RMS residual over the noise, per output; near 1 where the model is
            right.
        evaluations: simulations made.
    """

    estimates: tuple[Estimate, ...]
    transmission: Transmission
    correlation: FloatArray
    undetermined: tuple[str, ...]
    misfit: Mapping[str, float]
    evaluations: int

    def __getitem__(self, name: str) -> Estimate:
        """Return the estimate of one parameter."""
        for estimate in self.estimates:
            if estimate.name == name:
                return estimate
        raise CableError.unknown("estimate", name, [e.name for e in self.estimates])

    def __str__(self) -> str:
        lines = [
            f"{e.name:26} {e.value:10.4g}  [{e.low:.4g}, {e.high:.4g}] {e.unit}"
            for e in self.estimates
        ]
        lines += [f"{name}: misfit {value:.2f}" for name, value in self.misfit.items()]
        return "\n".join((*lines, *self.undetermined))


def calibrate(
    trials: Sequence[Trial],
    transmission: Transmission,
    free: Sequence[str],
    *,
    starts: int = 12,
    seed: int = 0,
) -> Calibration:
    """Fit parameters to trials.

    Args:
        trials: recorded motions, each from rest.
        transmission: pulleys and cables; its values are the first start. Cables share
            the fitted values.
        free: names of cable parameters (`PARAMETERS`), of `RADII`, or `WRAP`.
        starts: places tried, spread by a factor of 3 around the given values; the two
            best and the given one are fitted.
        seed: of the places.

    Returns:
        The best fit. Its intervals come from the sandwich covariance with Bartlett
        weights (Newey and West 1987), which holds for residuals that are correlated in
        time.

    Raises:
        CableError: an unknown name, no trial, or a start value of 0, which has no
            logarithm.
    """
    if not trials:
        raise CableError("calibrate needs at least one trial, got none")
    model = _Model(trials, transmission, tuple(free))
    rng = np.random.default_rng(seed)
    size = len(model.free)
    places = rng.uniform(-_SPREAD, _SPREAD, (starts, size))
    places = np.clip(places, model.low, model.high)
    costs = [float(np.sum(model.residual(place) ** 2)) for place in places]
    chosen = [np.zeros(size), *places[np.argsort(costs)[:2]]]
    fits = [
        least_squares(
            model.residual,
            place,
            jac=model.jacobian,
            bounds=(model.low - 1e-9, model.high + 1e-9),
            x_scale="jac",
            xtol=1e-7,
            ftol=1e-9,
            max_nfev=60,
        )
        for place in chosen
    ]
    best = min(fits, key=lambda fit: float(fit.cost))
    return model.report(best.x)


class _Model:
    """Simulated outputs as a function of the logarithms of the free parameters."""

    def __init__(
        self, trials: Sequence[Trial], transmission: Transmission, free: tuple[str, ...]
    ) -> None:
        self.trials, self.transmission, self.free = trials, transmission, free
        self.evaluations = 0
        known = {p.name: p for p in PARAMETERS}
        low, high, self.start = [], [], []
        for name in free:
            if name in known:
                value = float(getattr(transmission.cables[0], name))
                span = (max(known[name].low, 1e-12), known[name].high)
            elif name in RADII:
                value, span = float(getattr(transmission, name)), (1e-6, 1e3)
            elif name == WRAP:
                value, span = 1.0, (1e-3, 1e3)
            else:
                raise CableError.unknown("parameter", name, (*known, *RADII, WRAP))
            if not value > 0.0:
                raise CableError(
                    f"parameter `{name}` starts at {value:g}; a fit needs a start "
                    "greater than 0"
                )
            self.start.append(value)
            low.append(math.log(span[0] / value))
            high.append(math.log(span[1] / value))
        self.low, self.high = np.array(low), np.array(high)

    def changed(self, logs: FloatArray) -> Transmission:
        """The transmission with its parameters multiplied by e^logs."""
        values = dict(zip(self.free, np.array(self.start) * np.exp(logs), strict=True))
        scale = values.pop(WRAP, 1.0)
        radii = {name: values.pop(name) for name in RADII if name in values}
        if "static_friction" in values:  # never below kinetic friction
            least = values.get("friction", self.transmission.cables[0].friction)
            values["static_friction"] = max(values["static_friction"], least)
        cables = tuple(
            cable.replace(
                conduit=tuple(
                    Section(s.length, s.radius / scale) for s in cable.conduit
                ),
                **values,
            )
            for cable in self.transmission.cables
        )
        return replace(self.transmission, cables=cables, **radii)

    def parts(self, logs: FloatArray) -> list[tuple[str, FloatArray]]:
        """Name and residual over noise (samples,) of every output of every trial."""
        self.evaluations += 1
        transmission = self.changed(logs)
        found = []
        for trial in self.trials:
            played: Driven = transmission.replay(trial.dt, **trial.inputs)
            for name, measured in trial.outputs.items():
                error = (getattr(played, name) - measured) / trial.noise[name]
                found.append((name, error))
        return found

    def residual(self, logs: FloatArray) -> FloatArray:
        """All residuals over noise, one after another."""
        return np.concatenate([error for _, error in self.parts(logs)])

    def jacobian(self, logs: FloatArray) -> FloatArray:
        """Derivative of `residual` (residuals, free), central differences."""
        columns = []
        for step in _STEP * np.eye(logs.size):
            difference = self.residual(logs + step) - self.residual(logs - step)
            columns.append(difference / (2.0 * _STEP))
        return np.column_stack(columns)

    def report(self, logs: FloatArray) -> Calibration:
        """Everything that the fit at `logs` says."""
        parts = self.parts(logs)
        sensitivity = self.jacobian(logs)
        covariance = _sandwich(sensitivity, [error for _, error in parts])
        sigma = np.sqrt(np.diag(covariance))
        values = np.array(self.start) * np.exp(logs)
        with np.errstate(over="ignore"):
            factor = np.exp(1.96 * sigma)
        units = {p.name: p.unit for p in PARAMETERS} | dict.fromkeys(RADII, "m")
        estimates = tuple(
            Estimate(name, units.get(name, "1"), value, value / wide, value * wide)
            for name, value, wide in zip(
                self.free, values.tolist(), factor.tolist(), strict=True
            )
        )
        misfit: dict[str, list[FloatArray]] = {}
        for name, error in parts:
            misfit.setdefault(name, []).append(error)
        return Calibration(
            estimates,
            self.changed(logs),
            covariance / np.outer(sigma, sigma),
            _untold(self.free, covariance),
            {
                k: float(np.sqrt(np.mean(np.concatenate(v) ** 2)))
                for k, v in misfit.items()
            },
            self.evaluations,
        )


def _sandwich(sensitivity: FloatArray, errors: Sequence[FloatArray]) -> FloatArray:
    """Covariance of the logarithms for residuals correlated in time (free, free).

    Directions without any effect get a variance that is large but finite.
    """
    values, vectors = np.linalg.eigh(sensitivity.T @ sensitivity)
    values = np.maximum(values, 1e-12 * max(values[-1], 1e-300))
    bread = (vectors / values) @ vectors.T
    floor = (vectors * values) @ vectors.T
    meat = np.zeros_like(bread)
    first = 0
    for error in errors:
        score = sensitivity[first : first + error.size] * error[:, None]
        meat += _long_run(score, _memory(error))
        first += error.size
    # White noise of the stated size is the least that there can be.
    excess, axes = np.linalg.eigh(meat - floor)
    meat = floor + (axes * np.maximum(excess, 0.0)) @ axes.T
    covariance: FloatArray = bread @ meat @ bread
    return covariance


def _long_run(score: FloatArray, lags: int) -> FloatArray:
    """Covariance of the sum of the rows, Bartlett weights up to `lags`."""
    total: FloatArray = score.T @ score
    for lag in range(1, lags + 1):
        cross = score[lag:].T @ score[:-lag]
        total += (1.0 - lag / (lags + 1.0)) * (cross + cross.T)
    return total


def _memory(error: FloatArray) -> int:
    """Lags over which residuals are correlated: twice the first zero crossing."""
    centred = error - np.mean(error)
    size = 1 << (2 * error.size - 1).bit_length()
    spectrum = np.abs(np.fft.rfft(centred, size)) ** 2
    correlation = np.fft.irfft(spectrum)[: error.size]
    crossing = int(np.argmax(correlation <= 0.1 * max(correlation[0], 1e-300)))
    return min(2 * crossing, error.size // 4)


def _untold(free: tuple[str, ...], covariance: FloatArray) -> tuple[str, ...]:
    """A sentence for every combination of parameters that is not determined."""
    values, vectors = np.linalg.eigh(covariance)
    said = []
    for value, vector in zip(values, vectors.T, strict=True):
        if math.sqrt(max(value, 0.0)) < _UNTOLD:
            continue
        vector = vector / vector[np.argmax(np.abs(vector))]
        parts = [(n, w) for n, w in zip(free, vector, strict=True) if abs(w) > 0.1]
        if len(parts) == 1:
            said.append(f"not determined: {parts[0][0]} hardly changes the outputs")
            continue
        scaled = " and ".join(f"{n} by k^{w:.2g}" for n, w in parts)
        said.append(
            f"not determined: multiplying {scaled} changes the outputs by less than "
            "the noise"
        )
    return tuple(said)
