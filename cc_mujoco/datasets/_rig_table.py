"""Table `[rig]` of a `dataset.toml`: known constants of the rig and yes/no facts."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial

from cc_mujoco._utils.toml_table import Table
from cc_mujoco.datasets import _channels as channels
from cc_mujoco.datasets._moment_arm import Lever
from cc_mujoco.datasets._trials import Constant
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray

_LENGTH_UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
_DIMENSIONLESS = {"1": 1.0}
_INERTIA_UNITS = {"kg m^2": 1.0, "kg cm^2": 1e-4, "g cm^2": 1e-7}
RIG_CONSTANTS: dict[str, dict[str, float]] = {
    "motor_radius": _LENGTH_UNITS,
    "joint_radius": _LENGTH_UNITS,
    "pretension": channels.FORCE.factors,
    "axial_stiffness": channels.FORCE.factors,
    "friction": _DIMENSIONLESS,
    "exit_angle": channels.ANGLE.factors,
    "torque_constant": {"Nm/A": 1.0, "mNm/A": 1e-3},
    "gear_ratio": _DIMENSIONLESS,
    "gear_efficiency": _DIMENSIONLESS,
    "rotor_inertia": _INERTIA_UNITS,
    "load_stiffness": {"Nm/rad": 1.0, "Nm/deg": 180.0 / math.pi},
    "load_rest_angle": channels.ANGLE.factors,
    "load_inertia": _INERTIA_UNITS,
    "load_damping": {"Nm s/rad": 1.0},
    "load_weight": channels.TORQUE.factors,
    "load_hanging_angle": channels.ANGLE.factors,
    "gain_uncertainty": _DIMENSIONLESS,
}
"""Constants that `[rig]` may give, with units, SI first; `dataset.toml` beside this
module says what they mean.

The first five stand in place of the scene's; everything else about the rig (conduits,
lengths, wrap) is in the scene, but for `exit_angle` (pi unless given: conduits side by
side, one on either side). The load is what the joint turns, itself included. None but
the angles is negative."""
LOAD_CONSTANTS = ("load_stiffness", "load_inertia", "load_damping", "load_weight")
"""Those that, with their angles, give a joint's torque by motion."""


def read_rig(table: Table) -> dict[str, Constant]:
    """Return the constants of `[rig]` by name; a fact is 1 (true) or 0 (false)."""
    # Facts and their only value: the other one says nothing.
    statements = {"zeroed": True, "balanced": True, "joint_spring": False}
    angles = "exit_angle", "load_rest_angle", "load_hanging_angle"
    constants = {}
    for name, given in table.content.items():
        if name in statements:
            only = statements[name]
            if table.flag(name) is not only:
                right = f"{str(only).lower()}; leave it out where that is not known"
                raise table.wrong(name, right)
            constants[name] = Constant(float(only))
            continue
        if name == "angle_pairs":
            right = "a list of [motor, joint] angles in radians"
            pairs = table.pairs("angle_pairs", right)
            if not pairs:
                raise table.wrong("angle_pairs", right)
            if "joint_radius" in table.content:
                raise CableError(
                    f"{table.where}: `angle_pairs` give the radius at the joint; leave "
                    "`joint_radius` out."
                )
            constants |= fit_angle_pairs(pairs, f"{table.where}, angle_pairs")
            continue
        if name not in RIG_CONSTANTS:
            known = [*RIG_CONSTANTS, *statements, "angle_pairs"]
            raise CableError.unknown(f"constant in {table.where}", name, known)
        units = RIG_CONSTANTS[name]
        is_table = isinstance(given, dict)
        inner = Table(f"{table.where}, {name}", given if is_table else {"value": given})
        inner.only("value", "uncertainty", "unit")
        value = inner.number("value", -math.inf if name in angles else 0.0)
        if value is None:
            raise CableError(f"{inner.where} needs a `value`.")
        if value == 0.0 and name not in ("friction", *angles, "load_damping"):
            raise inner.wrong("value", "more than 0")
        factor = units[inner.choice("unit", units) or next(iter(units))]
        doubt = inner.number("uncertainty", 0.0) or 0.0
        if doubt > value > 0.0 and name not in angles:
            right = "one standard deviation in the unit of the value, and no larger"
            raise inner.wrong("uncertainty", right)
        if value == 0.0 and doubt > 0.0 and name in LOAD_CONSTANTS:
            raise inner.wrong("value", "more than 0 where it has an uncertainty")
        untuned = ["exit_angle", "gear_ratio", "gear_efficiency", "rotor_inertia"]
        untuned += ["load_hanging_angle", "gain_uncertainty"]
        if doubt > 0.0 and name in untuned:
            raise CableError(
                f"{inner.where}: `uncertainty` cannot be used; a diagnosis takes this "
                "constant for exact."
            )
        constants[name] = Constant(value * factor, doubt * factor)
    for name, most in (("gear_efficiency", 1.0), ("gain_uncertainty", 0.3)):
        if constants.get(name, Constant(0.0)).value > most:
            raise table.wrong(name, f"more than 0 and no more than {most:g}")
    return constants


RATIO_KEY, SLOPE_KEY, CURVE_KEY = "lever_ratio", "lever_slope", "lever_curve"
"""Constants that stand for the pairs: R/r, a [1/rad] and b [1/rad^2]."""


def fit_angle_pairs(
    pairs: Sequence[Sequence[float]], where: str
) -> dict[str, Constant]:
    """Return R/r, a and b of a moment arm, fitted to (motor, joint) angle pairs [rad].

    The pairs are taken slowly with a taut cable, so the cable keeps its length: the
    motor angle is m = c + R/r (q + a q^2/2 + b q^3/3) at joint angle q, for a moment
    arm R (1 + a q + b q^2) and a motor pulley of radius r. A least-squares polynomial
    through the pairs gives R/r, a and b.
    """
    motor, joint = np.array(pairs, dtype=np.float64).T
    count = len(set(joint.tolist()))
    if len(pairs) < 5 or count < 5:  # fewer tell of no error
        raise CableError(
            f"{where} has {count} different joint angles; give 5 pairs [motor, joint] "
            "or more, over the whole range."
        )
    degree = 3 if len(pairs) >= 7 else 2  # fewer tell of no curve
    design = np.vander(joint, degree + 1, increasing=True)
    size = np.linalg.lstsq(design, motor)[0]
    left = motor - design @ size
    freedom = max(len(pairs) - degree - 1, 1)
    spread = np.linalg.inv(design.T @ design) * float(left @ left) / freedom
    ratio = float(size[1])
    arm = Polynomial(size).deriv()(np.linspace(joint.min(), joint.max(), 101)) / ratio
    if ratio <= 0.0 or float(arm.min()) < 0.2:  # a lever beyond is as good as dead
        raise CableError(
            f"{where}: the joint does not follow the motor over the whole range (arm "
            f"{float(arm.min()):.2g} of that at 0 at least); give pairs that increase "
            "together, with the cable taut."
        )
    slope, curve = (k * float(size[k]) / ratio if k <= degree else 0.0 for k in (2, 3))
    return {
        RATIO_KEY: Constant(ratio, float(np.sqrt(spread[1, 1]))),
        SLOPE_KEY: Constant(slope),
        CURVE_KEY: Constant(curve),
    }


@dataclass(frozen=True)
class MomentArm:
    """Moment arm at joint angle q [rad] over that at 0: 1 + a q + b q^2 + ...

    With a lever, this factor multiplies the lever's own arm.
    """

    coefficients: tuple[float, ...]  # a, b, ... [1/rad, 1/rad^2, ...]
    lever: Lever | None = None

    @property
    def joint(self) -> FloatArray:
        """Joint angles (angles,) within +-2 rad, rising, where the arm is above 0."""
        angles = np.linspace(-2.0, 2.0, 401)
        return angles[self.share(angles) > 0.0]

    def turned(self, joint: FloatArray) -> FloatArray:
        """Return the equivalent pulley's angle (samples,) [rad]: the arm's integral."""
        if self.lever is None:
            return np.asarray(Polynomial((1.0, *self.coefficients)).integ()(joint))
        angles = self.lever.joint
        arm = self.share(angles)
        middle = 0.5 * (arm[1:] + arm[:-1]) * np.diff(angles)
        taken = np.concatenate([[0.0], np.cumsum(middle)])
        rest = np.interp(0.0, angles, taken)
        return np.asarray(np.interp(joint, angles, taken - rest))

    def share(self, joint: FloatArray) -> FloatArray:
        """Return the arm at joint angles (samples,) [rad] over that at 0."""
        lever = 1.0 if self.lever is None else self.lever.share(joint)
        return np.asarray(lever * Polynomial((1.0, *self.coefficients))(joint))


def known_arm(constants: Mapping[str, Constant]) -> tuple[float, ...]:
    """Return a and b of a `MomentArm`; () if `[rig]` has no `angle_pairs`."""
    if RATIO_KEY not in constants:
        return ()
    return constants[SLOPE_KEY].value, constants[CURVE_KEY].value
