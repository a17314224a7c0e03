"""Learned curves: a torque over one quantity, as a table that a user may edit.

    class LearnedJointAngle(LearnedCurve):
        '''Learned torque over the joint angle.'''

        id = "learned_joint_angle"
        over = "joint angle"
        at = (-0.4, 0.0, 0.4)
        joint_torque = (0.0, 0.12, 0.0)

Such a class is an effect like any other, of one size: the factor of its table.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Literal, NamedTuple, get_args

import numpy as np

from cc_mujoco.diagnosis._scene.realisation import add_wave
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis.effects._effect import Signals, Size, dry_friction
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray

if TYPE_CHECKING:
    from mujoco import MjSpec

    from cc_mujoco.datasets import Bench

Side = Literal["motor", "joint"]
SIDES: tuple[Side, ...] = get_args(Side)


class Quantity(NamedTuple):
    unit: str
    values: Callable[[Signals, Side], FloatArray]  # (samples,) of the torque of a side


def _travel(signals: Signals, _: Side) -> FloatArray:
    """Return the motor's travel since it turned (samples,), up to a bound [rad]."""
    return Limit.learned_travel * dry_friction(
        signals.motor_angle, Limit.learned_travel
    )


def _position(signals: Signals, _: Side) -> FloatArray:
    """Return the displacement of the middle of the cable (samples,) [m]."""
    motor = signals.motor_radius * signals.motor_angle
    return 0.5 * (motor + signals.joint_radius * signals.joint_angle)


def _tension(signals: Signals, _: Side) -> FloatArray:
    """Return the mean tension of all ends of the cables (samples,) [N]."""
    return np.asarray(0.5 * (signals.tension_proximal + signals.tension_distal).mean(0))


def _rising(signals: Signals, side: Side) -> FloatArray:
    """Return 1 where a torque rises, -1 where it falls, between at turns (samples,)."""
    torque = getattr(signals, side)
    turn = Limit.learned_turn * float(np.max(np.abs(torque)))
    return dry_friction(torque, max(turn, 1e-9))


def _friction(signals: Signals, _: Side) -> FloatArray:
    """Return the part of the motor's torque that friction takes (samples,) [N m]."""
    return signals.motor - signals.motor_radius / signals.joint_radius * signals.joint


QUANTITIES: Mapping[str, Quantity] = {
    "joint angle": Quantity("rad", lambda s, _: s.joint_angle),
    "motor angle": Quantity("rad", lambda s, _: s.motor_angle),
    "cable position": Quantity("m", _position),
    "joint speed": Quantity("rad/s", lambda s, _: s.joint_speed),
    "cable speed": Quantity("m/s", lambda s, _: s.cable_speed[0]),
    "joint acceleration": Quantity(
        "rad/s^2", lambda s, _: np.gradient(s.joint_speed, s.dt)
    ),
    "tension": Quantity("N", _tension),
    "torque": Quantity("N m", lambda s, side: getattr(s, side)),
    "torque rate": Quantity(
        "N m/s", lambda s, side: np.gradient(getattr(s, side), s.dt)
    ),
    "travel since the motor turned": Quantity("rad", _travel),
    "time": Quantity("s", lambda s, _: s.time),
}
"""Quantities that a learned torque may be a curve over, by name."""

FACTORS: Mapping[str, Quantity] = {
    "": Quantity("1", lambda s, _: np.ones(s.time.size)),
    "direction": Quantity("1", lambda s, _: dry_friction(s.motor_angle, Limit.wind_up)),
    "torque": Quantity("N m", lambda s, side: getattr(s, side)),
    "torque direction": Quantity("1", _rising),
    "friction": Quantity("N m", _friction),
}
"""Factors of a learned curve by name, 1 without one."""


class LearnedCurve:
    """Torque over one quantity, linear between the points of a table."""

    id = "learned"
    needs = "the motions that it was learned on"
    where = "conduit"
    scene_note = "no element of MuJoCo has a torque over such a quantity"
    over = ""  # of `QUANTITIES`
    times = ""  # of `FACTORS`
    period = 0.0  # after which the table repeats, 0 if it does not; then the ends hold
    at: tuple[float, ...] = ()  # points of the table, rising
    # What is added to the torques there, per unit of `times` [N m]; () for nothing
    motor_torque: tuple[float, ...] = ()
    joint_torque: tuple[float, ...] = ()

    def tables(self) -> dict[Side, FloatArray]:
        """Return the checked table (points,) of each side that has one [N m]."""
        for names, known in ((self.over, QUANTITIES), (self.times, FACTORS)):
            if names not in known:
                raise CableError.unknown("quantity", names, [*known])
        found: dict[Side, FloatArray] = {}
        points = np.asarray(self.at, dtype=np.float64)
        for side in SIDES:
            table = np.asarray(getattr(self, f"{side}_torque"), dtype=np.float64)
            if table.size and not (table.shape == points.shape and points.size > 1):
                raise CableError(
                    f"`{side}_torque` has {table.size} values; it takes one for each "
                    f"of the {points.size} points in `at`, two at least"
                )
            if table.size:
                found[side] = table
        if not (np.isfinite(points).all() and np.all(np.diff(points) > 0.0)):
            raise CableError("the points in `at` must be finite and rise")
        if not found or not all(np.isfinite(table).all() for table in found.values()):
            raise CableError(
                "the curve must have `motor_torque` or `joint_torque`, of finite values"
            )
        return found

    def parameters(self) -> list[Size]:
        self.tables()
        meaning = "factor of the learned table"
        return [Size(f"{self.id}_share", "1", 1.0, meaning, 0.0, 10.0)]

    def signals(self, signals: Signals, values: Mapping[str, float]) -> Signals:
        size = values[f"{self.id}_share"]
        added = {}
        for side, table in self.tables().items():
            along = QUANTITIES[self.over].values(signals, side)
            factor = size * FACTORS[self.times].values(signals, side)
            shown = np.interp(along, self.at, table, period=self.period or None)
            added[f"{side}"] = factor * shown
        return signals.added(**added)


class LearnedAngleCurve(LearnedCurve):
    """Torque over the angle of its own side, which a scene can have."""

    scene_note = (
        "learned, from the error that no effect explains: waves of the torque of "
        "MuJoCo's DC motor, actuators without input; beyond the angles that it was "
        "learned on it repeats, turned round"
    )

    def edit_spec(
        self, spec: MjSpec, bench: Bench, values: Mapping[str, float]
    ) -> None:
        """Add the curve as a Fourier series, of cosines where it does not repeat."""
        size, at = values[f"{self.id}_share"], np.asarray(self.at)
        for side, table in self.tables().items():
            shift = values.get("joint_angle_offset", 0.0) if side == "joint" else 0.0
            waves = self._repeating(table) if self.period else self._even(table)
            for k, (order, cosine, sine) in enumerate(waves):
                turned = order * (at[0] + shift)
                along, across = math.cos(turned), math.sin(turned)
                wave = cosine * across + sine * along, cosine * along - sine * across
                name = f"{self.id}_{side}_{k}"
                add_wave(spec, bench, side, name, order, *(size * w for w in wave))

    def _even(self, table: FloatArray) -> list[tuple[float, float, float]]:
        """Return (order [1/rad], cosine, 0) of an even Fourier series about `at[0]`."""
        length = self.at[-1] - self.at[0]
        count = len(self.at) - 1
        even = self.at[0] + length * np.arange(count + 1) / count
        values = np.interp(even, self.at, table)
        mirrored = np.concatenate([values, values[-2:0:-1]])
        whole = np.fft.rfft(mirrored).real / mirrored.size
        whole[1:-1] *= 2.0
        orders = math.pi / length * np.arange(count + 1)
        return [
            (o, c, 0.0) for o, c in zip(orders.tolist(), whole.tolist(), strict=True)
        ]

    def _repeating(self, table: FloatArray) -> list[tuple[float, float, float]]:
        count = 2 * len(self.at)
        even = self.at[0] + self.period * np.arange(count) / count
        values = np.interp(even, self.at, table, period=self.period)
        whole = np.fft.rfft(values) / count
        whole[1:-1] *= 2.0
        orders = math.tau / self.period * np.arange(whole.size)
        parts = orders, whole.real, -whole.imag
        return list(zip(*(part.tolist() for part in parts), strict=True))
