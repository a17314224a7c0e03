"""Parameters of a transmission from recorded trials, with intervals (thesis 2.4.2).

    trial = Measurement(
        dt=0.005,
        inputs={"motor_torque": torque, "joint_angle": angle},
        outputs={"joint_torque": measured},
        noise={"joint_torque": 5e-4},
    )
    found = calibrate([trial], transmission, ("friction", "axial_stiffness"))
    print(found)            # values, intervals, undetermined combinations

The transmission simulates each trial from rest at pretension, so a trial must start so.
The logarithms of the parameters are fitted by least squares on the simulated outputs
(`_least_squares`), from several start values.
"""

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cc_mujoco._utils.arguments import numbers, require_kind
from cc_mujoco._validation import require_dictionary, require_list
from cc_mujoco.cable import PARAMETERS, Parameter, Transmission
from cc_mujoco.cable._pulleys import PULLEYS
from cc_mujoco.errors import CableError, CableWarning, look_up, shown
from cc_mujoco.estimation._least_squares import (
    FACTOR_STEP,
    Estimate,
    Tuned,
    covariance,
    differences,
    estimate,
    fit,
    undetermined_directions,
)
from cc_mujoco.native import FloatArray

SIDE_QUANTITIES = ("motor_angle", "motor_torque", "joint_angle", "joint_torque")
RADII = tuple(parameter.name for parameter in PULLEYS[:2])
WRAP_SCALE = "wrap"
"""Parameter that scales all wrap angles of the conduits; 1 keeps the given angles."""
_POOR_MISFIT = 3.0
"""Misfit above which the model or its start is wrong, so that no interval holds."""


@dataclass(frozen=True)
class Measurement:
    """A recorded motion, starting at rest: columns of `SIDE_QUANTITIES` (samples,)."""

    dt: float  # time between samples [s]
    inputs: Mapping[str, FloatArray]  # one of the motor and one of the joint
    outputs: Mapping[str, FloatArray]  # others, as measured
    noise: Mapping[str, float]  # standard deviation of every output

    def __post_init__(self) -> None:
        for label in ("inputs", "outputs", "noise"):
            given = getattr(self, label)
            require_dictionary(f"`{label}` of a trial", [] if given is None else given)
        for name in (*self.inputs, *self.outputs):
            if name not in SIDE_QUANTITIES:
                raise CableError.unknown("quantity of a trial", name, SIDE_QUANTITIES)
        if not self.outputs or set(self.outputs) & set(self.inputs):
            raise CableError(
                f"a trial with inputs {sorted(self.inputs)} needs outputs other than "
                f"these, not {sorted(self.outputs)}"
            )
        columns = {**self.inputs, **self.outputs}
        shapes = {numbers(f"`{k}` of a trial", v).shape for k, v in columns.items()}
        if len(shapes) != 1 or len(min(shapes)) != 1:
            raise CableError(
                f"the columns of a trial have the shapes {sorted(shapes)}; all must "
                "be (samples,) of the same number"
            )
        for name in self.outputs:
            noise = numbers(f"noise of output `{name}`", self.noise.get(name, 0.0), ())
            if not noise > 0.0:
                raise CableError(
                    f"noise of output `{name}` is {noise:g}; give its standard "
                    "deviation, greater than 0"
                )

    def residual(self, transmission: Transmission) -> dict[str, FloatArray]:
        """Return (measured - simulated) / noise of every output (samples,), by name."""
        played = transmission.replay(self.dt, **self.inputs)
        return {
            name: (measured - getattr(played, name)) / self.noise[name]
            for name, measured in self.outputs.items()
        }


@dataclass(frozen=True)
class Calibration:
    """Result of a fit: estimates with intervals, correlation, misfit."""

    estimates: Mapping[str, Estimate]  # of every free parameter, by name
    transmission: Transmission  # with the estimated values
    correlation: FloatArray  # of the logarithms of the parameters (free, free)
    undetermined: tuple[str, ...]  # a sentence for every undetermined combination
    misfit: Mapping[str, float]
    """RMS residual over the noise, per output; near 1 where the model is right. Above 3
    no interval holds, and `calibrate` warns."""

    def __getitem__(self, name: str) -> Estimate:
        return look_up("estimate", name, self.estimates)

    def __str__(self) -> str:
        lines = [
            f"{name:26} {e.value:10.4g}  [{e.ci95[0]:.4g}, {e.ci95[1]:.4g}] {e.unit}"
            for name, e in self.estimates.items()
        ]
        lines += [
            f"{name}: misfit {value:.2f}"
            + (", so no interval holds" if value > _POOR_MISFIT else "")
            for name, value in self.misfit.items()
        ]
        return "\n".join((*lines, *self.undetermined))


def calibrate(
    trials: Sequence[Measurement],
    transmission: Transmission,
    free: Sequence[str],
    *,
    starts: int = 12,
    seed: int = 0,
) -> Calibration:
    """Fit parameters of a transmission to recorded trials.

    Args:
        trials: recorded motions, each from rest.
        transmission: pulleys and cables; its values are the first start of the fit. All
            cables share the fitted values.
        free: names of cable parameters (`PARAMETERS`), of `RADII`, or `WRAP_SCALE`.
        starts: number of start values compared, spread by a factor of 3 around the
            given ones; fits run from the two best and from the given ones.
        seed: seed of the start values.

    Warns:
        CableWarning: the best fit leaves an error above 3 times the noise.

    Returns:
        The best fit. Its intervals come from the sandwich covariance with Bartlett
        weights (Newey and West 1987), which holds for residuals that are correlated in
        time.

    Raises:
        CableError: an unknown name, no trial, or a start value of 0, which has no
            logarithm.
    """
    if not isinstance(trials, Sequence) or not trials:
        raise CableError(
            f"calibrate needs a list of at least one trial, not {shown(trials)}"
        )
    for trial in trials:
        require_kind("each of `trials`", trial, Measurement)
    require_kind("transmission", transmission, Transmission)
    if not require_list("free", free):
        raise CableError("free is empty; it must name the parameters to fit")
    for name, count in (("starts", starts), ("seed", seed)):
        Parameter(name, "1", low=0.0, high=1e6, whole=True).check(count)
    model = _Model(
        trials, transmission, [_log_parameter(name, transmission) for name in free]
    )
    rng = np.random.default_rng(seed)
    places = rng.uniform(-math.log(3.0), math.log(3.0), (starts, len(free)))
    places = np.clip(places, [p.low for p in model.free], [p.high for p in model.free])
    costs = [float(np.sum(model.residual(place) ** 2)) for place in places]
    chosen = [np.zeros(len(free)), *places[np.argsort(costs)[:2]]]
    fits = [fit(model.residual, model.jacobian, model.free, place) for place in chosen]
    found = model.report(min(fits, key=lambda found: found.cost).x)
    poor = {k: value for k, value in found.misfit.items() if value > _POOR_MISFIT}
    if poor:
        errors = " and ".join(
            f"{value:.3g} times the noise of {k}" for k, value in poor.items()
        )
        warnings.warn(
            f"the best fit leaves {errors}, so its intervals do not hold: the model "
            "lacks an effect, or more `starts` are needed.",
            CableWarning,
            stacklevel=2,
        )
    return found


def _log_parameter(name: str, transmission: Transmission) -> Tuned:
    """Return a free parameter of the fit, with coordinate log(value / given value)."""
    wrap = Parameter(WRAP_SCALE, "1", "scale of all wrap angles", 1e-3, 1e3)
    known = {own.name: own for own in (*PARAMETERS, *PULLEYS[:2], wrap)}
    parameter = look_up("parameter", name, known)
    least = max(parameter.low, 1e-12)  # logarithms need positive bounds
    parameter = replace(parameter, low=least, scale="log")
    owner = transmission if name in RADII else transmission.cables[0]
    value = 1.0 if name == WRAP_SCALE else float(getattr(owner, name))
    if not value > 0.0:
        raise CableError(
            f"parameter `{name}` starts at {value:g}; a fit needs a start "
            "greater than 0"
        )
    low, high = (math.log(end / value) for end in (parameter.low, parameter.high))
    return Tuned(parameter, value, 1.0, low, high)


@dataclass(frozen=True)
class _Model:
    """Simulated outputs as a function of the logarithms of the free parameters."""

    trials: Sequence[Measurement]
    transmission: Transmission
    free: Sequence[Tuned]

    def changed(self, logs: FloatArray) -> Transmission:
        """Return the transmission with free parameters multiplied by exp(`logs`)."""
        each = zip(self.free, logs.tolist(), strict=True)
        values = {parameter.name: parameter.value(place) for parameter, place in each}
        scale = values.pop(WRAP_SCALE, 1.0)
        radii = {name: values.pop(name) for name in RADII if name in values}
        if "static_friction" in values:  # never below kinetic friction
            least = values.get("friction", self.transmission.cables[0].friction)
            values["static_friction"] = max(values["static_friction"], least)
        cables = []
        for cable in self.transmission.cables:
            bent = [s._replace(radius=s.radius / scale) for s in cable.conduit]
            cables.append(cable.replace(conduit=tuple(bent), **values))
        return replace(self.transmission, cables=tuple(cables), **radii)

    def parts(self, logs: FloatArray) -> list[tuple[str, FloatArray]]:
        """Return, for every output of every trial, its name and residual (samples,)."""
        changed = self.changed(logs)
        found: list[tuple[str, FloatArray]] = []
        for trial in self.trials:
            found += trial.residual(changed).items()
        return found

    def residual(self, logs: FloatArray) -> FloatArray:
        """Return the residuals of all outputs of all trials, joined (residuals,)."""
        return np.concatenate([error for _, error in self.parts(logs)])

    def jacobian(self, logs: FloatArray) -> FloatArray:
        """Return the derivative of `residual` by the logarithms (residuals, free)."""
        steps = dict.fromkeys(range(logs.size), FACTOR_STEP)
        columns = differences(lambda place: [self.residual(place)], logs, steps)
        return np.column_stack([column for (column,) in columns.values()])

    def report(self, logs: FloatArray) -> Calibration:
        """Return the `Calibration` by a fit that ended at logarithms `logs` (free,)."""
        parts = self.parts(logs)
        spread = covariance(self.jacobian(logs), [error for _, error in parts])
        sigma = np.sqrt(np.diag(spread))
        misfit: dict[str, list[FloatArray]] = {}
        for name, error in parts:
            misfit.setdefault(name, []).append(error)
        each = zip(self.free, logs.tolist(), sigma.tolist(), strict=True)
        # A combination of logarithms of this standard deviation is undetermined.
        undetermined = undetermined_directions(spread, 0.5)
        return Calibration(
            {p.name: estimate(p, place, deviation) for p, place, deviation in each},
            self.changed(logs),
            spread / np.outer(sigma, sigma),
            tuple(map(self.sentence, undetermined)),
            {k: math.sqrt(np.mean(np.concatenate(v) ** 2)) for k, v in misfit.items()},
        )

    def sentence(self, shares: FloatArray) -> str:
        """Return a sentence on parameters that the data do not determine together.

        `shares` (free,) is the direction of their logarithms that changes nothing.
        """
        sizes = np.abs(shares)
        powers = shares / shares[np.argmax(sizes > 0.99 * np.max(sizes))]
        parts = [
            (p.name, w) for p, w in zip(self.free, powers, strict=True) if abs(w) > 0.1
        ]
        if len(parts) == 1:
            return f"not determined: {parts[0][0]} hardly changes the outputs"
        scaled = " and ".join(f"{n} by k^{w:.2g}" for n, w in parts)
        return (
            f"not determined: multiplying {scaled} changes the outputs by less than "
            "the noise"
        )
