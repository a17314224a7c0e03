"""Simulations 1 and 2 (4.3): control of cables without any inertia.

`tracking`: one cable, its output moving, six schemes of control. Friction, path and
motion are not printed. What is printed fixes the one number that matters: with
feed-forward and K_p = 1 the first error is 10 %. An output that gets 1/C of the input
x + K_p (x - T) is at T = x (1 + K_p)/(C + K_p), so C = 11/9. Gains, segments and both
model errors are those of the thesis.

`spring`: two such cables render a spring of 1 N m/rad. Pulleys, motion, stiffness and
gains are those printed. The model-free controller of the figures, with its constant
offset in motion, is feedback alone; feed-forward with feedback is shown in addition.
The last of the controllers compensates stiction, which the thesis proposes
(Listing 4.1) and does not show.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cc_mujoco import control
from cc_mujoco.cable import Cable, Section
from cc_mujoco.cable import _stepper as stepper
from cc_mujoco.cable._layout import tensions
from cc_mujoco.device._drive import CableDrive, Drive
from cc_mujoco.metrics._formulas import signal_lag
from cc_mujoco.native import FloatArray
from cc_mujoco.simulation._loop import Columns, Trace, run
from thesis._outcome import Finding, Verdict, rms
from thesis._rig import PRINTED_CABLE

PERIOD, DURATION = 1e-3, 30.0  # control period and duration of a run [s]
TENSION_RATIO = 2.0 / 0.9 - 1.0
"""C: input per output tension that the printed first error of 10 % implies."""
FRICTION_ERROR = 0.03  # error of the model's friction, constant or cosine
SETTLING_TIME = 5.0  # time after which transients of the integrator are over [s]
SLIP_CROSSING_TIME = 0.05
"""Time in which the slip has crossed the cable in every scheme [s]."""


class InertiaFree:
    """A device without any inertia (4.3), a `DrivenDevice`.

    The motor is an ideal source of torque, the wearer an ideal source of position; the
    cables stand between them. One step passes between a measurement and its effect.
    """

    prefixes: tuple[str, ...] = ("",)

    def __init__(self, drive: Drive) -> None:
        """Prepare a device with the cables of a drive."""
        cables = [(s.cable, s.proximal, s.distal) for s in drive.cables]
        self.cables = stepper.make_cables(*zip(*cables, strict=True))
        self._work, self._period = stepper.scratch(self.cables), drive.period

    def run(
        self, controller: control.Controller, angle: FloatArray, desired: FloatArray
    ) -> dict[str, FloatArray]:
        """Simulate a controller that drives the device through a joint motion.

        The controller is made for the drive, or for one with other cables; angle [rad]
        and desired torque [N m] are the joint's, (samples,). Returns columns,
        (samples,) each; the motor torque of a sample is computed from that sample.
        """
        self._angle, self._desired, self.steps = angle, desired, angle.size - 1
        trace = Trace(
            ("motor_angle_rad", "motor_torque_nm", "joint_torque_nm"), self.steps
        )

        def observe(step: int, columns: Columns, torque: FloatArray) -> None:
            trace.keep(step, {**columns, "motor_torque_nm": torque}, torque)

        run(self, controller, observe)
        return trace.columns

    def start(self) -> Columns:
        """Start at rest in the pretension, with the joint at its first angle."""
        self._at, self.motor_angle = 0, 0.0
        self._state = stepper.rest_states(self.cables, 0.0, float(self._angle[0]))
        self._new = np.zeros_like(self._state)
        return self._columns(0.0)

    def advance(self, torque: FloatArray) -> Columns:
        """Advance a period with a motor torque [N m]."""
        before = self.motor_angle
        self._at += 1
        self.motor_angle = stepper.balance(
            self.cables, self._state, False, float(self._angle[self._at]), before,
            stepper.NO_LOAD._replace(torque=float(torque)), self._period, self._new,
            self._work,
        )  # fmt: skip
        self._state[:] = self._new
        return self._columns(before)

    def tension(self, cable: int) -> FloatArray:
        node = tensions(self._state[cable], int(self.cables.n[cable]))
        return np.maximum(node, 0.0)

    def _columns(self, motor_before: float) -> Columns:
        at, period = self._at, self._period
        now, before = float(self._angle[at]), float(self._angle[max(at - 1, 0)])
        torque = stepper.torque(self.cables, self._state, True, 0.0)[0]
        return {
            "motor_angle_rad": self.motor_angle,
            "motor_velocity_rad_s": (self.motor_angle - motor_before) / period,
            "joint_angle_rad": now,
            "joint_velocity_rad_s": (now - before) / period,
            "joint_torque_nm": float(torque),
            "desired_torque_nm": float(self._desired[at]),
        }


def cable(growth: float) -> Cable:
    """Return the cable of Table 2.2 with the wrap that gives tension ratio `growth`."""
    length = PRINTED_CABLE.length
    radius = length * PRINTED_CABLE.friction / math.log(growth)
    return PRINTED_CABLE.replace(
        segments=10, static_friction=0.0, conduit=(Section(length, radius),)
    )


def one_cable(growth: float) -> Drive:
    """Return a drive of one cable with arms of 1 m, so that torques are tensions."""
    drive = CableDrive(cable(growth), -1.0, -1.0)
    return Drive(1.0, 0.0, 1000.0, PERIOD, one_way=True, cables=(drive,))


def schemes(device: Drive) -> list[control.Controller]:
    """Return feed-forward, feedback, both; the model, exact, 3 % off, 3 % cosine."""

    def cosine(time: FloatArray) -> FloatArray:
        return FRICTION_ERROR * np.cos(2.0 * math.pi * time / (3.0 * math.pi))

    return [
        control.FeedForward(device),
        control.Feedback(device),
        control.ProportionalIntegral(device),
        control.ModelBased(device, settling=0.0),
        control.ModelBased(device, mismatch=FRICTION_ERROR, settling=0.0),
        control.ModelBased(device, mismatch=cosine, settling=0.0),
    ]


def desired_tension() -> tuple[FloatArray, FloatArray]:
    """Return time [s] and desired tension [N] with a sinusoidal slope."""
    time = np.arange(0.0, DURATION, PERIOD)
    return time, 10.0 + time + 2.0 * np.sin(2.0 * time)


class _Tracked(NamedTuple):
    """Tracking by a scheme; errors are shares of the desired tension."""

    error: float  # RMS since the slip has crossed the cable
    first: float  # largest error since then
    settled: float  # RMS once transients are over
    delay: float  # of the fluctuation, once transients are over [s]


def track(device: Drive, law: control.Controller) -> _Tracked:
    """Simulate one control scheme while the output is drawn in at 10 mm/s."""
    time, wanted = desired_tension()
    tension = InertiaFree(device).run(law, 0.01 * time, wanted)["joint_torque_nm"]
    share = tension / wanted - 1.0
    begun, late = time >= SLIP_CROSSING_TIME, time >= SETTLING_TIME

    def swing(signal: FloatArray) -> FloatArray:
        line = np.polynomial.Polynomial.fit(time[late], signal[late], 1)
        return signal[late] - line(time[late])

    return _Tracked(
        rms(share[begun]), float(np.max(np.abs(share[begun]))),
        rms(share[late]), signal_lag(time[late], swing(wanted), swing(tension)),
    )  # fmt: skip


def tracking() -> tuple[Finding, ...]:
    device = one_cable(TENSION_RATIO)
    none, alone, both, model, off, cosine = (
        track(device, law) for law in schemes(device)
    )
    ratio = both.error / off.error
    device = one_cable(math.exp(PRINTED_CABLE.friction * PRINTED_CABLE.wrap))
    _, _, law, _, wrong, _ = schemes(device)
    hard_ratio = track(device, law).settled / track(device, wrong).settled
    in_phase = max(model.delay, off.delay) < 1e-3 < min(alone.delay, both.delay)
    free = ", ".join(f"{row.error:.1%}" for row in (none, alone, both))
    lags = ", ".join(f"{1e3 * r.delay:.0f}" for r in (alone, both, model, off, cosine))
    return (
        Finding(
            f"RMS error of the tension {free} (feed-forward, feedback, both)",
            "agrees" if none.error > alone.error > both.error else "disagrees",
            f"friction takes {1 - 1 / TENSION_RATIO:.0%}; the integrator takes it over",
        ),
        Finding(
            f"RMS {alone.error:.1%} and {both.error:.1%}, "
            f"lag {1e3 * alone.delay:.0f} and {1e3 * both.delay:.0f} ms",
            _factor_verdict(alone.error / both.error, 10.0, 2.0),
            f"factor {alone.error / both.error:.1f}, "
            f"and {alone.delay / both.delay:.0f} in lag",
        ),
        Finding(f"{both.first:.1%}, with C = {TENSION_RATIO:.2f}", "cannot"),
        Finding(
            f"RMS {model.error:.4%}, at most {model.first:.3%}",
            "agrees" if model.error < 1e-3 else "disagrees",
            f"a step of the desired tension is {PERIOD * 3.0 / 20.0:.3%} of it; slip "
            f"crosses the cable in the first {1e3 * SLIP_CROSSING_TIME:.0f} ms, which "
            "are not counted",
        ),
        Finding(
            f"RMS {off.error:.3%} against {both.error:.2%}: factor {ratio:.0f}",
            _factor_verdict(ratio, 5.0, 2.0),
            "3 % of friction are little of tension; with the friction of Table 2.2 "
            f"(C = 4.5) and after {SETTLING_TIME:.0f} s the factor is {hard_ratio:.0f}",
        ),
        Finding(
            f"RMS {cosine.error:.2%}, at most {cosine.first:.2%}, against "
            f"{both.error:.2%} and {both.first:.1%} without a model",
            "agrees" if cosine.error < 0.2 * both.error else "in part",
        ),
        Finding(
            f"lag {lags} ms (feedback, both, model, 3 % off, 3 % cosine)",
            "agrees" if in_phase else "disagrees",
        ),
    )


def _factor_verdict(ratio: float, agrees: float, partly: float) -> Verdict:
    if ratio >= agrees:
        return "agrees"
    return "in part" if ratio >= partly else "disagrees"


STIFFNESS = 1.0  # stiffness of the virtual spring [N m/rad]
DEFLECTION, DEFLECTION_TIME = 1.5, 15.0
"""Deflection of the joint, and time to get there [rad, s]."""
REVERSAL_TOLERANCE = 0.01  # error at which a reversal is over [N m]


def pull_pull() -> Drive:
    """Return the pull-pull transmission, ratio 1, pulleys of 0.1 m."""
    pair = (CableDrive(cable(TENSION_RATIO), way, way) for way in (-0.1, 0.1))
    return Drive(1.0, -20.0, 20.0, PERIOD, cables=tuple(pair))


def motion() -> tuple[FloatArray, FloatArray]:
    time = np.arange(0.0, 2.0 * DEFLECTION_TIME, PERIOD)
    knots = [0.0, DEFLECTION_TIME, 2.0 * DEFLECTION_TIME]
    return time, np.interp(time, knots, [0.0, DEFLECTION, 0.0])


class _Rendered(NamedTuple):
    """Spring as rendered by a controller."""

    moving: float  # RMS error later than 2 s after a change of direction [N m]
    peak: float  # largest error after the reversal [N m]
    # angle from the reversal until the error stays below `REVERSAL_TOLERANCE` [rad];
    # the rest of the motion where it never does
    lost: float
    delay: float  # mean error in motion, over the rate of the spring's torque [s]


def render(device: Drive, law: control.Controller) -> _Rendered:
    time, angle = motion()
    wanted = -STIFFNESS * angle
    torque = InertiaFree(device).run(law, angle, wanted)["joint_torque_nm"]
    error = torque - wanted
    back = error[time >= DEFLECTION_TIME]
    open_ = np.flatnonzero(np.abs(back) > REVERSAL_TOLERANCE)
    lasting = PERIOD * (open_[-1] + 1) if open_.size else 0.0
    moving = (time % DEFLECTION_TIME) >= 2.0
    rate = STIFFNESS * DEFLECTION / DEFLECTION_TIME * PERIOD
    return _Rendered(
        rms(error[moving]), float(np.max(np.abs(back))),
        lasting * DEFLECTION / DEFLECTION_TIME,
        float(np.mean((error * -np.gradient(wanted))[moving])) * PERIOD / rate**2,
    )  # fmt: skip


def spring() -> tuple[Finding, ...]:
    device = pull_pull()
    free, both, model, stiction = (
        render(device, law)
        for law in (
            control.Feedback(device),
            control.ProportionalIntegral(device),
            control.ModelBased(device, settling=0.0),
            control.StictionCompensation(device, settling=0.0),
        )
    )
    lost, by_model, by_stiction, by_both = (
        float(np.degrees(row.lost)) for row in (free, model, stiction, both)
    )
    below = f"error below {1e3 * REVERSAL_TOLERANCE:.0f} mN m after"
    return (
        Finding(
            f"RMS error in motion {1e3 * free.moving:.1f} mN m without, "
            f"{1e3 * model.moving:.1f} mN m with the model; "
            f"that is {1e3 * free.delay:.0f} and {1e3 * model.delay:.0f} ms behind",
            "agrees" if model.moving < 0.3 * free.moving else "disagrees",
            "feedback alone, later than 2 s after a change of direction; with "
            f"feed-forward it is {1e3 * both.moving:.1f} mN m",
        ),
        Finding(
            f"largest error {free.peak:.2f} and {model.peak:.2f} N m",
            "agrees" if 0.5 < model.peak / free.peak < 2.0 else "disagrees",
        ),
        Finding(
            f"{below} {by_model:.2f} deg with, {lost:.1f} deg without",
            "agrees" if by_model < 5.0 < lost else "disagrees",
            f"of {np.degrees(DEFLECTION):.0f} deg; the offset of feedback alone "
            f"stays, with feed-forward it is gone after {by_both:.1f} deg",
        ),
        Finding(
            f"{below} {by_stiction:.2f} deg, at most {stiction.peak:.2f} N m",
            "agrees" if by_stiction < 0.5 * by_model else "disagrees",
        ),
    )
