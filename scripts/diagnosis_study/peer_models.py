"""Peers of learned curves: usual models of the error that a tuned scene leaves.

Each predicts the error of one torque in records, from those that it has learned from.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from io import StringIO
from typing import Any

import mujoco
import numpy as np
from scipy.optimize import least_squares

from cc_mujoco.diagnosis._learn.curves import FACTORS, QUANTITIES, SIDES
from cc_mujoco.diagnosis._learn.learning import ErrorRecord
from cc_mujoco.diagnosis._rig.records import low_pass
from cc_mujoco.native import FloatArray

Records = Sequence[ErrorRecord]
Peer = Callable[[Records, Records, int], list[FloatArray]]
"""Returns the error (samples,) that it expects in records, of one torque [N m].

It is given the records to learn from, those to predict and the row of the torque.
"""
INPUTS = (
    "joint angle", "motor angle", "time", "joint speed", "tension", "torque",
    "direction", "friction", "travel since the motor turned",
)  # fmt: skip
"""Inputs of the Gaussian process; sparse regression has seven, its waves three."""
TYPICAL = np.array([1.0, 1.0, 8.0 / math.tau, 3.0, 50.0, 5.0, 1.0])
LAWS = {
    "M1": (0, 3, 4), "M2": (0, 1, 2, 3, 4, 5), "M3": (0, 3, 4, 6),
    "M4": (0, 1, 2, 3, 4, 5, 6, 8), "M5": tuple(range(10)), "M6": tuple(range(12)),
}  # fmt: skip
"""Constants of `friction` that each model has."""
HINGE = {
    "stiffness": (-20.0, 20.0, 3), "damping": (-5.0, 5.0, 3), "armature": (0.0, 0.1, 1),
    "frictionloss": (0.0, 3.0, 1), "ipos": (-0.5, 0.5, 3), "gain": (-0.3, 0.3, 1),
    "zero": (-1.0, 1.0, 1),
}  # fmt: skip
"""Limits and number of constants of a hinge and its sensor [SI]."""
LIBRARY: dict[tuple[int, int], FloatArray] = {}
"""Functions (terms, samples) of sparse regression, by record and torque of one rig."""


def filtered(own: ErrorRecord, values: FloatArray) -> FloatArray:
    """Return values (..., samples) with the low-pass of the torques."""
    return low_pass(np.ascontiguousarray(values), own.band, 1.0 / own.signals.dt)


def quantities(own: ErrorRecord, row: int, count: int = len(INPUTS)) -> FloatArray:
    """Return the first quantities of `INPUTS` (count, samples)."""
    known = {**QUANTITIES, **FACTORS}
    return np.array([known[n].values(own.signals, SIDES[row]) for n in INPUTS[:count]])


def joined(
    seen: Records, row: int, of: Callable[[ErrorRecord], FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Return columns (samples, n) `of` records, and errors, both weighted."""
    every = [(own, own.weight[row], own.steps[1]) for own in seen]
    columns = [(of(own) * weight)[:, ::step] for own, weight, step in every]
    errors = [(own.error[row] * weight)[::step] for own, weight, step in every]
    return np.concatenate(columns, axis=1).T, np.concatenate(errors)


def process(
    seen: Records, every: Records, row: int, count: int = 400
) -> list[FloatArray]:
    """Fit a Gaussian process, with a length for each input, to `count` samples."""
    gaussian: Any = importlib.import_module("sklearn.gaussian_process")
    pairs = [(own, own.weight[row] > 0.0) for own in seen]
    inputs = np.concatenate([quantities(own, row)[:, kept] for own, kept in pairs], 1).T
    errors = np.concatenate([own.error[row, kept] for own, kept in pairs])
    chosen = np.random.default_rng(0).permutation(errors.size)[:count]
    middle, size, scale = inputs.mean(0), inputs.std(0) + 1e-9, float(errors.std())
    lengths = gaussian.kernels.RBF(np.ones(len(INPUTS)), (0.02, 1e3))
    kernel = 1.0 * lengths + gaussian.kernels.WhiteKernel(0.1)
    found = gaussian.GaussianProcessRegressor(kernel)
    found.fit((inputs[chosen] - middle) / size, errors[chosen] / scale)
    shown = [(own, (quantities(own, row).T - middle) / size) for own in every]
    return [scale * filtered(own, found.predict(values)) for own, values in shown]


def friction(
    constants: FloatArray, speed: FloatArray, m: FloatArray, e: FloatArray
) -> FloatArray:
    """Return the friction (samples,) at torques `m` of the motor and `e` of the load.

    The first three constants are logarithms, r and rs are ratios of loads.
    """
    onset, stribeck, fade, kv, kc, kcs, kl, r, kls, rs, keq, kmq = constants
    square = np.where(np.abs(m) > np.abs(e), keq * e**2, kmq * m**2)
    slow = np.exp(-((np.abs(speed) / math.exp(stribeck)) ** math.exp(fade)))
    still = slow * (kcs + kls * np.abs(m - rs * e) + square)
    size = kv * np.abs(speed) + kc + kl * np.abs(m - r * e) + still
    return np.asarray(np.tanh(speed / math.exp(onset)) * size)


def bam(seen: Records, every: Records, row: int, law: str) -> list[FloatArray]:
    """Fit friction of one of `LAWS`, by either side's own speed and both torques."""
    free, start = list(LAWS[law]), np.zeros(12)
    start[[0, 1, 7, 9]] = math.log(0.05), math.log(0.3), 1.0, 1.0

    def shown(own: ErrorRecord, found: FloatArray) -> FloatArray:
        signals, constants = own.signals, start.copy()
        constants[free] = found
        arms = np.array([signals.motor_radius, signals.joint_radius])
        motor, joint = arms[row] / arms
        speed = (signals.motor_speed, signals.joint_speed)[row]
        torques = motor * signals.motor, joint * signals.joint
        return filtered(own, friction(constants, speed, *torques))

    def residual(found: FloatArray) -> FloatArray:
        column, errors = joined(seen, row, lambda own: shown(own, found)[None])
        return column[:, 0] - errors

    low, high = np.full(12, -np.inf), np.full(12, np.inf)
    low[:3], high[:3] = np.log([1e-3, 1e-2, 0.2]), np.log([1.0, 10.0, 5.0])
    limits: Any = {"bounds": (low[free], high[free]), "x_scale": "jac"}
    found = least_squares(residual, start[free], max_nfev=30, **limits).x
    return [shown(own, found) for own in every]


def sindy(
    seen: Records, every: Records, row: int, name: str, **settings: float
) -> list[FloatArray]:
    """Fit a sparse sum of polynomials and Fourier series by an optimiser of PySINDy."""
    pysindy: Any = importlib.import_module("pysindy")

    def columns(own: ErrorRecord) -> FloatArray:
        if (key := (id(own.signals), row)) not in LIBRARY:
            values = quantities(own, row, 7).T / TYPICAL
            waves = pysindy.FourierLibrary(n_frequencies=45)
            both = np.asarray(waves.fit_transform(values[:, :3])).T
            powers = np.asarray(pysindy.PolynomialLibrary(3).fit_transform(values)).T
            parts = [powers, both, values[:, 6] * both]  # also times the direction
            LIBRARY[key] = filtered(own, np.concatenate(parts))
        return LIBRARY[key]

    values, errors = joined(seen, row, columns)
    size, scale = np.linalg.norm(values, axis=0) + 1e-9, float(np.linalg.norm(errors))
    optimizer = getattr(pysindy, name)(**settings)
    found = optimizer.fit(values / size, errors[:, None] / scale)
    return [(found.coef_[0] * scale / size) @ columns(own) for own in every]


def sysid(seen: Records, every: Records, row: int, sign: float) -> list[FloatArray]:
    """Fit a hinge of MuJoCo and its sensor by `mujoco.sysid` and inverse dynamics."""
    toolbox: Any = importlib.import_module("mujoco.sysid")
    if not hasattr(toolbox, "optimize"):  # the module is empty without its extras
        raise ModuleNotFoundError("install `mujoco[sysid]`")
    spec, params = mujoco.MjSpec(), toolbox.ParameterDict()
    body = spec.worldbody.add_body(mass=1.0, inertia=[1e-3] * 3, explicitinertial=True)
    hinge = body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 1, 0])

    def write(_: Any, one: Any) -> None:
        if one.name not in ("gain", "zero"):
            value = one.value if one.size > 1 else float(one.value[0])
            setattr(body if one.name == "ipos" else hinge, one.name, value)

    for name, (low, high, size) in HINGE.items():
        start, *ends = (np.full(size, at) for at in (0.02 * (low + high), low, high))
        params.add(toolbox.Parameter(name, start, *ends, modifier=write))

    def shown(own: ErrorRecord, step: int) -> FloatArray:
        model, signals = toolbox.apply_param_modifiers(params, spec), own.signals
        tilt, data = signals.tilt, mujoco.MjData(model)
        model.opt.gravity[:] = 9.81 * math.sin(tilt), 0.0, -9.81 * math.cos(tilt)
        moves = [getattr(signals, f"{SIDES[row]}_angle")]
        moves += [np.gradient(moves[0], signals.dt)]
        moves += [np.gradient(moves[1], signals.dt)]
        torque = signals.time[::step] * 0.0
        for k, state in enumerate(np.array(moves)[:, ::step].T):
            data.qpos[:], data.qvel[:], data.qacc[:] = state
            mujoco.mj_inverse(model, data)
            torque[k] = sign * data.qfrc_inverse[0]
        read = params["gain"].value * getattr(signals, SIDES[row])[::step]
        return np.asarray(torque + read + params["zero"].value)

    def residual(x: FloatArray, _: Any) -> tuple[list[FloatArray], None, None]:
        params.update_from_vector(x)
        left = [(own, shown(own, 16) - own.error[row, ::16]) for own in seen]
        return [error * own.weight[row, ::16] for own, error in left], None, None

    settings: Any = {"verbose": False, "x_scale": "jac", "max_iters": 8}
    with redirect_stdout(StringIO()):
        found, _ = toolbox.optimize(params, residual, "scipy", **settings)
    params.update_from_vector(found.as_vector())
    return [filtered(own, shown(own, 1)) for own in every]
