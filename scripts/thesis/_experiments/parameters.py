"""Parameter estimation of 2.4.2 as a workflow: stiffness, friction, what stays unknown.

A simulated rig stands for the real one: `RECONCILED_CABLE`, motor encoder of 2000
counts, load cell with noise of its resolution of 0.5 mN m, sampled at 200 Hz. The fit
starts from wrong values and sees nothing but the trials.
"""

from __future__ import annotations

import math

import numpy as np

from cc_mujoco.cable import Cable
from cc_mujoco.estimation._calibration import Calibration, Measurement, calibrate
from thesis._outcome import Finding
from thesis._rig import LENGTH, MOTOR_RADIUS, RECONCILED_CABLE, STIFFNESS, drive

DT = 0.005
DURATION = 6.0
ENCODER_COUNT = 2.0 * math.pi / 2000.0  # count of the motor's encoder [rad]
LOAD_CELL_NOISE = 5e-4  # noise of the load cell, its resolution [N m]
CABLE = RECONCILED_CABLE.replace(segments=25)
INITIAL_GUESS = CABLE.replace(friction=0.05, axial_stiffness=2500.0)
REPEATS = 40


def blocked_trial(cable: Cable, seed: int, peak: float = 0.125) -> Measurement:
    """Simulate a trial with blocked output and a slow wave of growing motor torque."""
    time = np.arange(0.0, DURATION, DT)
    torque = peak * np.sin(2.0 * np.pi * 0.4 * time) * np.minimum(1.0, time / 5.0)
    still = np.zeros_like(time)
    found = drive(cable).replay(DT, motor_torque=torque, joint_angle=still)
    rng = np.random.default_rng(seed)
    # Dither of one count makes the error of rounding uniform and white.
    dither = ENCODER_COUNT * rng.uniform(-0.5, 0.5, time.size)
    angle = ENCODER_COUNT * np.round((found.motor_angle + dither) / ENCODER_COUNT)
    cell = found.joint_torque + LOAD_CELL_NOISE * rng.standard_normal(time.size)
    return Measurement(
        dt=DT,
        inputs={"motor_torque": torque, "joint_angle": still},
        outputs={"motor_angle": angle, "joint_torque": cell},
        noise={
            "motor_angle": ENCODER_COUNT / math.sqrt(6.0),
            "joint_torque": LOAD_CELL_NOISE,
        },
    )


def by_slope(trial: Measurement) -> float:
    """Return the stiffness of a cable from the slope of torque over angle [N/m].

    Two cables pull against each other, so the slope is 2 K r^2 without friction.
    """
    angle, torque = trial.outputs["motor_angle"], trial.inputs["motor_torque"]
    slope = float(np.polyfit(angle, torque, 1)[0])
    return slope / (2.0 * MOTOR_RADIUS**2)


def coverage() -> list[float]:
    """Return the coverage of 95 % intervals of friction and stiffness."""
    hits, names = np.zeros(2), ("friction", "axial_stiffness")
    for seed in range(REPEATS):
        trial = blocked_trial(CABLE, 1000 + seed)
        found = calibrate([trial], drive(CABLE), names, starts=0)
        hits += [found[name].holds(getattr(CABLE, name)) for name in names]
    return (hits / REPEATS).tolist()


def run() -> tuple[Finding, ...]:
    """Fit, find unidentifiable parameters, and count how often intervals hold."""
    trial = blocked_trial(CABLE, 1)
    naive = by_slope(trial)
    fit = calibrate([trial], drive(INITIAL_GUESS), ("friction", "axial_stiffness"))
    both = calibrate(
        [trial], drive(INITIAL_GUESS), ("friction", "axial_stiffness", "wrap")
    )
    names = ("friction", "axial_stiffness", "pretension")
    taut = calibrate([trial], drive(INITIAL_GUESS), names)
    slack_trial = blocked_trial(CABLE, 2, peak=0.6)
    slack = calibrate([trial, slack_trial], drive(INITIAL_GUESS), names)
    friction_held, stiffness_held = coverage()
    static = [_static_fit(n) for n in (10, 40)]
    unknown = both.undetermined[0] if both.undetermined else "all determined"
    stiffness, friction = fit["axial_stiffness"], fit["friction"]
    low, high = stiffness.ci95
    traded = taut.correlation[0, 2]
    return (
        Finding(
            f"slope of the loop {naive:.0f} N/m; fit {stiffness.value / LENGTH:.0f} "
            f"[{low / LENGTH:.0f}, {high / LENGTH:.0f}], true "
            f"{STIFFNESS:.0f}",
            "better" if stiffness.holds(STIFFNESS * LENGTH) else "disagrees",
        ),
        Finding(
            f"mu_d {friction.value:.5f} +- {_width(fit, 'friction') - 1.0:.2%} from a "
            f"start of {INITIAL_GUESS.friction:g}, true {CABLE.friction:g}",
            "better" if friction.holds(CABLE.friction) else "disagrees",
            f"95 % intervals held the truth in {friction_held:.0%} (mu_d) and "
            f"{stiffness_held:.0%} (K) of {REPEATS} repeats",
        ),
        Finding(
            f"curvature free as well: {unknown}; product "
            f"{both['friction'].value * both['wrap'].value:.4f}, true "
            f"{CABLE.friction:g}",
            "in part" if both.undetermined else "agrees",
        ),
        Finding(
            f"fitted beside mu_d: correlation {traded:.4f}, T0 +- "
            f"{_width(taut, 'pretension') - 1.0:.1%}; with a trial that goes slack +- "
            f"{_width(slack, 'pretension') - 1.0:.2%}",
            "agrees" if traded < -0.9 else "disagrees",
        ),
        Finding(
            f"the same data ask for mu_s {static[0]:.3f} with 10 segments and "
            f"{static[1]:.3f} with 40",
            "disagrees" if static[1] > 1.2 * static[0] else "agrees",
        ),
    )


def _static_fit(segments: int) -> float:
    """Return the static friction of a mesh that fits a finer truth's break-away."""
    truth = CABLE.replace(segments=20, static_friction=3.0 * CABLE.friction)
    trial = blocked_trial(truth, 3)
    start = truth.replace(segments=segments, static_friction=2.0 * CABLE.friction)
    found = calibrate([trial], drive(start), ("static_friction",))
    return found["static_friction"].value


def _width(found: Calibration, name: str) -> float:
    """Return the factor by which the interval of a parameter spreads either way."""
    return found[name].ci95[1] / found[name].value
