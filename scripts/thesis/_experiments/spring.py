"""Simulation 2 (4.3.2): two cables render a spring of 1 N m/rad.

Pulleys, motion, stiffness and gains are those printed. Friction is not; the cables are
those of Simulation 1 (`tracking`). The model-free controller of the figures, with its
constant offset in motion, is feedback alone; feed-forward with feedback is shown in
addition. The last of the controllers compensates stiction,
which the thesis proposes (Listing 4.1) and does not show.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cc_mujoco.control import (
    Controller,
    Feedback,
    ModelBased,
    ProportionalIntegral,
    StictionCompensation,
)
from cc_mujoco.device._drive import CableDrive, Drive
from cc_mujoco.native import FloatArray
from thesis._experiments.tracking import PERIOD, TENSION_RATIO, cable
from thesis._inertia_free import InertiaFree
from thesis._outcome import Claim, Curve, ExperimentOutcome, Panel, Progress, rms

RADIUS = 0.1  # radius of both pulleys [m]
STIFFNESS = 1.0  # stiffness of the virtual spring [N m/rad]
DEFLECTION, DEFLECTION_TIME = 1.5, 15.0
"""Deflection of the joint, and time to get there [rad, s]."""
REVERSAL_TOLERANCE = 0.01  # error at which a reversal is over [N m]


def drive() -> Drive:
    """Return the pull-pull transmission, ratio 1."""
    own = cable(TENSION_RATIO)
    pair = (CableDrive(own, -RADIUS, -RADIUS), CableDrive(own, RADIUS, RADIUS))
    return Drive(1.0, -20.0, 20.0, PERIOD, cables=pair)


def motion() -> tuple[FloatArray, FloatArray]:
    time = np.arange(0.0, 2.0 * DEFLECTION_TIME, PERIOD)
    return time, np.interp(
        time, [0.0, DEFLECTION_TIME, 2.0 * DEFLECTION_TIME], [0.0, DEFLECTION, 0.0]
    )


class _Rendered(NamedTuple):
    """Spring as rendered by a controller."""

    torque: FloatArray  # of the cables on the joint (samples,) [N m]
    moving: float  # RMS error later than 2 s after a change of direction [N m]
    peak: float  # largest error after the reversal [N m]
    # angle from the reversal until the error stays below `REVERSAL_TOLERANCE` [rad];
    # the rest of the motion where it never does
    lost: float
    delay: float  # mean error in motion, over the rate of the spring's torque [s]


def render(device: Drive, law: Controller) -> _Rendered:
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
        torque,
        rms(error[moving]),
        float(np.max(np.abs(back))),
        lasting * DEFLECTION / DEFLECTION_TIME,
        float(np.mean((error * -np.gradient(wanted))[moving])) * PERIOD / rate**2,
    )


def run(progress: Progress) -> ExperimentOutcome:
    device = drive()
    laws: dict[str, Controller] = {
        "feedback": Feedback(device),
        "feed-forward and feedback": ProportionalIntegral(device),
        "with the model": ModelBased(device, settling=0.0),
        "with the model and stiction compensation": StictionCompensation(
            device, settling=0.0
        ),
    }
    found: dict[str, _Rendered] = {}
    for place, (name, law) in enumerate(laws.items()):
        found[name] = render(device, law)
        progress((place + 1) / len(laws))
    time, angle = motion()
    wanted = -STIFFNESS * angle
    around = np.abs(time - DEFLECTION_TIME - 0.3) < 0.5
    torque = "torque [N m]"

    def panel(title: str, x: FloatArray, label: str, shown: FloatArray) -> Panel:
        curves: dict[str, Curve] = {"spring": (x[shown], wanted[shown], "--")}
        for name, row in found.items():
            curves[name] = (x[shown], row.torque[shown])
        return Panel(title, label, torque, curves)

    always = np.ones(time.size, dtype=bool)
    errors = {name: (time, row.torque - wanted) for name, row in found.items()}
    panels = [
        panel("Torque at the joint", time, "time [s]", always),
        panel("Torque against angle", angle, "angle [rad]", always),
        panel("The reversal", time, "time [s]", around),
        Panel("Error", "time [s]", torque, errors, limits=(-0.2, 0.2)),
    ]
    return ExperimentOutcome(_claims(*found.values()), {"spring": panels})


def _claims(
    free: _Rendered, both: _Rendered, model: _Rendered, stiction: _Rendered
) -> tuple[Claim, ...]:
    degrees = [float(np.degrees(row.lost)) for row in (free, model, stiction, both)]
    return (
        Claim(
            "4.3.2, Fig. 4.7",
            "model-free lags during the entire motion; with the model no lag, no "
            "steady state error",
            f"RMS error in motion {1e3 * free.moving:.1f} mN m without, "
            f"{1e3 * model.moving:.1f} mN m with the model; "
            f"that is {1e3 * free.delay:.0f} and {1e3 * model.delay:.0f} ms behind",
            "agrees" if model.moving < 0.3 * free.moving else "disagrees",
            "feedback alone, later than 2 s after a change of direction; with "
            f"feed-forward it is {1e3 * both.moving:.1f} mN m",
        ),
        Claim(
            "4.3.2, Fig. 4.7",
            "comparable at the change of direction, without stiction compensation",
            f"largest error {free.peak:.2f} and {model.peak:.2f} N m",
            "agrees" if 0.5 < model.peak / free.peak < 2.0 else "disagrees",
            "until all of a cable has turned the model has no more to say",
        ),
        Claim(
            "4.3.2, Fig. 4.8",
            "with the model: spring almost perfect in motion, small backlash at "
            "reversal; without: backlash through the entire motion",
            f"error below {1e3 * REVERSAL_TOLERANCE:.0f} mN m after {degrees[1]:.2f} "
            f"deg with, {degrees[0]:.1f} deg without",
            "agrees" if degrees[1] < 5.0 < degrees[0] else "disagrees",
            f"of {np.degrees(DEFLECTION):.0f} deg; the offset of feedback alone "
            f"stays, with feed-forward it is gone after {degrees[3]:.1f} deg",
        ),
        Claim(
            "4.1, Listing 4.1",
            "stiction compensation: partial motion is crossed at once (not shown)",
            f"error below {1e3 * REVERSAL_TOLERANCE:.0f} mN m after {degrees[2]:.2f} "
            f"deg, at most {stiction.peak:.2f} N m",
            "agrees" if degrees[2] < 0.5 * degrees[1] else "disagrees",
            "one sample passes before the reversal is noticed",
        ),
    )
