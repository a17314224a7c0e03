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
    values: Callable[[Signals, Side], FloatArray]  # (samples,), of a side if it differs


def _rising(signals: Signals, side: Side) -> FloatArray:
    """Return 1 where a torque rises, -1 where it falls, between at turns (samples,)."""
    torque = getattr(signals, side)
    turn = Limit.learned_turn * float(np.max(np.abs(torque)))
    return dry_friction(torque, max(turn, 1e-9))


QUANTITIES: Mapping[str, Quantity] = {
    "joint angle": Quantity("rad", lambda s, _: s.joint_angle),
    "motor angle": Quantity("rad", lambda s, _: s.motor_angle),
    "cable position": Quantity(  # of its middle
        "m",
        lambda s, _: (
            0.5 * (s.motor_radius * s.motor_angle + s.joint_radius * s.joint_angle)
        ),
    ),
    "joint speed": Quantity("rad/s", lambda s, _: s.joint_speed),
    "cable speed": Quantity("m/s", lambda s, _: s.cable_speed[0]),
    "joint acceleration": Quantity(
        "rad/s^2", lambda s, _: np.gradient(s.joint_speed, s.dt)
    ),
    "tension": Quantity(  # mean of the cables at that side
        "N",
        lambda s, side: (s.tension_proximal, s.tension_distal)[side == "joint"].mean(0),
    ),
    "torque": Quantity("N m", lambda s, side: getattr(s, side)),
    "torque rate": Quantity(
        "N m/s", lambda s, side: np.gradient(getattr(s, side), s.dt)
    ),
    "travel since the motor turned": Quantity(  # up to a bound
        "rad",
        lambda s, _: (
            Limit.learned_travel * dry_friction(s.motor_angle, Limit.learned_travel)
        ),
    ),
    "time": Quantity("s", lambda s, _: s.time),
}
"""Quantities that a learned torque may be a curve over, by name."""

FACTORS: Mapping[str, Quantity] = {
    "": Quantity("1", lambda s, _: np.ones(s.time.size)),
    "direction": Quantity("1", lambda s, _: dry_friction(s.motor_angle, Limit.wind_up)),
    "torque": Quantity("N m", lambda s, side: getattr(s, side)),
    "torque direction": Quantity("1", _rising),
    "friction": Quantity(  # part of the motor's torque that it takes
        "N m", lambda s, _: s.motor - s.motor_radius / s.joint_radius * s.joint
    ),
}
"""Factors of a learned curve by name, 1 without one."""


class LearnedCurve:
    """Torque over one quantity, linear between the points of a table."""

    id = "learned"
    needs = "the motions that it was learned on"
    where = "conduit"
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
        points = np.asarray(self.at, dtype=np.float64)
        found: dict[Side, FloatArray] = {}
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
        size, added = values[f"{self.id}_share"], {}
        for side, table in self.tables().items():
            along = QUANTITIES[self.over].values(signals, side)
            factor = size * FACTORS[self.times].values(signals, side)
            shown = np.interp(along, self.at, table, period=self.period or None)
            added[f"{side}"] = factor * shown
        return signals.added(**added)

    @property
    def _in_scene(self) -> bool:
        """True if the torques are over the angles of their own sides."""
        own = {f"{side} angle" for side in self.tables()}
        return own == {self.over} and not self.times

    @property
    def scene_note(self) -> str:
        """Form of the curve in a scene, or the reason that it has none."""
        if not self._in_scene:
            return "no element of MuJoCo has a torque over such a quantity"
        return (
            "learned, from the error that no effect explains: waves of the torque of "
            "MuJoCo's DC motor, actuators without input; beyond the angles that it was "
            "learned on it repeats, turned round"
        )

    @property
    def edit_spec(self) -> Callable[..., None] | None:
        """Function that adds the curve to a scene, None if a scene cannot have it."""
        return self._add_waves if self._in_scene else None

    def _add_waves(
        self, spec: MjSpec, bench: Bench, values: Mapping[str, float]
    ) -> None:
        """Add the curve as a Fourier series, an even one where it does not repeat."""
        size, at = values[f"{self.id}_share"], np.asarray(self.at)
        count = 2 * at.size if self.period else 2 * at.size - 2
        period = self.period or 2.0 * (at[-1] - at[0])
        passed = period * np.arange(count) / count
        orders = math.tau / period * np.arange(count // 2 + 1)
        for side, table in self.tables().items():
            places = at[0] + (
                passed if self.period else np.minimum(passed, period - passed)
            )
            shown = np.interp(places, at, table, period=self.period or None)
            waves = np.fft.rfft(shown) / count
            waves[1:-1] *= 2.0
            shift = values.get("joint_angle_offset", 0.0) if side == "joint" else 0.0
            waves = size * waves * np.exp(-1j * orders * (at[0] + shift))
            for k, (order, wave) in enumerate(zip(orders, waves, strict=True)):
                name = f"{self.id}_{side}_{k}"
                add_wave(spec, bench, side, name, order, -wave.imag, wave.real)
