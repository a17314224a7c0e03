"""Synthetic diagnoses for the tests of the report: one for each verdict."""

from __future__ import annotations

import numpy as np

from cc_mujoco.datasets._channels import TORQUES
from cc_mujoco.diagnosis import Diagnosis
from cc_mujoco.diagnosis._verdict import (
    Baseline,
    Evidence,
    FoundEffect,
    Gap,
    Isolability,
    Learned,
    LearnedTable,
    Map,
    NextExperiment,
    NotTestable,
    RunnerUp,
    TrialError,
    TrialTrace,
    Where,
)
from cc_mujoco.diagnosis.effects import EFFECTS
from cc_mujoco.estimation import Estimate

IDS = (
    "viscous_friction",
    "stribeck_friction",
    "presliding",
    "load_independent_friction",
    "asymmetric_friction",
    "tension_dependent_friction",
    "dwell_dependent_stiction",
    "configuration_dependent_wrap",
    "pretension_loss",
    "friction_drift",
    "backlash",
    "pulley_eccentricity",
    "motor_cogging",
    "cable_stiffening",
    "end_compliance",
    "joint_gravity",
    "joint_stiffness",
    "joint_inertia",
    "motor_inertia",
    "torque_sensor_gain",
    "torque_sensor_offset",
    "sensor_delay",
)
TITLES = {name: EFFECTS[name].title for name in ("stribeck_friction", "presliding")}

_BASELINE = Baseline(
    {
        "friction_times_wrap": Estimate(0.5123, "1", (0.4951, 0.5295)),
        "stiffness": Estimate(4123.4, "N/m", (3990.0, 4260.0)),
        "motor_torque_offset": Estimate(-3.24e-5, "N m", (-3.8e-5, -2.6e-5)),
        "time_offset": Estimate(0.0012, "s", (float("nan"), float("nan"))),
    },
    ("Friction and wrap enter only as their product.",),
)
_PROVENANCE = {
    "version": "0.1.0",
    "seed": 7,
    "command": "cc-mujoco diagnose bench.xml data --out out",
    "data": {"a.csv": "9f" * 32, "b & <c>.csv": "01" * 32},
    "packages": ["mujoco 4.0.0", "numpy 2.2.0"],
}
_WHERE = (
    Where(
        "joint_torque_nm",
        "joint speed",
        0.62,
        "62 % of the error of the joint torque follows the joint speed.",
    ),
    Where(
        "motor_torque_nm",
        "time",
        0.07,
        "7 % of the error of the motor torque drifts with time.",
    ),
)
_RUNNERS = (
    (
        RunnerUp(
            "viscous_friction",
            0.81,
            5.2,
            True,
            "second best: 0.81 of the error goes, the best takes 0.93",
            {"viscous_friction": 0.021},
        ),
        RunnerUp("stribeck_friction", 0.93, 6.0, True, "", {"static_excess": 0.31}),
        RunnerUp("backlash", 0.02, 0.4, False, "gap < noise", {"play": 1.2e-6}),
        RunnerUp("joint_inertia", -0.05, -0.9, False, "worse on held-out data", {}),
    ),
    (RunnerUp("presliding", 0.11, 1.6, False, "below the threshold of 0.15", {}),),
)
_UNTESTED = (
    NotTestable("friction_drift", "the trials last 20 s together"),
    NotTestable("dwell_dependent_stiction", "the joint never rests"),
)
_CLOSED = {
    "motor_torque_nm": Gap(0.0832, 0.0311, 0.0274, 0.965, (0.93, 0.99)),
    "joint_torque_nm": Gap(0.412, 0.0524, 0.0413, 0.993, (0.985, 0.997)),
}
_OPEN = {
    name: Gap(gap.rmse_before, gap.rmse_before, gap.noise_floor, 0.0, (0.0, 0.0))
    for name, gap in _CLOSED.items()
}
_TRIALS = tuple(
    TrialError(
        name,
        {"motor_torque_nm": 0.0832 * size, "joint_torque_nm": 0.412 * size},
        {"motor_torque_nm": 0.0311, "joint_torque_nm": 0.0524},
        {"motor_torque_nm": 0.0274, "joint_torque_nm": 0.0413},
        5.3 * size,
        1.2,
    )
    for name, size in (
        ("a", 0.7),
        ("b & <c>", 0.9),
        ("monday/slow_strokes_with_the_large_load_and_a_long_name", 4.0),
    )
)
_QUESTION = (
    "Trial a is off by 21 times the noise floor, the others by 1.1: was its pretension "
    "or its route changed?"
)
_EXPERIMENT = NextExperiment(
    "Move the joint slowly, at 0.05 rad/s, for one minute, with and without 2 kg.",
    ("stribeck_friction", "presliding"),
    "0.12 N m RMS of joint torque, four times the noise.",
    ("trial_09",),
)
_LEARNED = Learned(
    "Learned from the error: a curve of the joint torque over the joint angle.",
    (
        LearnedTable(
            *("learned_joint_angle", "joint angle", "rad", "", 0.0),
            *((-0.4, 0.0, 0.4), "N m", {"joint_torque_nm": (0.0, 0.2, 0.0)}),
        ),
    ),
    _CLOSED,
    0.98,
    (0.95, 0.99),
)

DIAGNOSES = {
    "named": Diagnosis(
        "named",
        "The simulation lacks Stribeck friction; with it, 99 % of the gap is gone.",
        learned=_LEARNED,
        effects=(
            FoundEffect(
                "stribeck_friction",
                {
                    "static_excess": Estimate(0.312, "1", (0.288, 0.336)),
                    "stribeck_speed": Estimate(0.0081, "m/s", (0.0072, float("inf"))),
                },
                0.98,
            ),
        ),
        not_testable=_UNTESTED,
        where=_WHERE,
        gap=_CLOSED,
        baseline=_BASELINE,
        provenance=_PROVENANCE,
        runner_ups=_RUNNERS,
        problems=("b.csv: 12 samples of joint_torque_nm are clipped and left out.",),
        trials=_TRIALS,
    ),
    "none": Diagnosis(
        "none",
        "The simulation agrees with the data to within their noise.",
        not_testable=_UNTESTED,
        gap={"joint_torque_nm": Gap(0.0415, 0.0415, 0.0413, float("nan"), (0.0, 0.0))},
        baseline=_BASELINE,
        provenance=_PROVENANCE,
    ),
    "unknown": Diagnosis(
        "unknown",
        "The simulation errs by ten times the noise and no known effect explains it.",
        where=_WHERE,
        gap=_OPEN,
        baseline=_BASELINE,
        provenance=_PROVENANCE,
        runner_ups=_RUNNERS[1:],
        trials=_TRIALS,
        question=_QUESTION,
    ),
    "tie": Diagnosis(
        "tie",
        "Stribeck friction and presliding explain these data equally well.",
        ties=(("stribeck_friction", "presliding"),),
        next_experiment=_EXPERIMENT,
        where=_WHERE,
        gap=_OPEN,
        baseline=_BASELINE,
        provenance=_PROVENANCE,
        runner_ups=_RUNNERS,
    ),
    "fix-data": Diagnosis(
        "fix-data",
        "Nothing can be concluded before the data are put right.",
        problems=(
            "a.csv: joint_angle_rad runs to 180 and looks like degrees; convert it.",
            "a.csv: motor_torque_nm <b>has</b> the sign of a brake; swap it.",
        ),
        provenance=_PROVENANCE,
    ),
    "fix-numerics": Diagnosis(
        "fix-numerics",
        "The simulation changes by more than the noise when its step is halved.",
        problems=("Halving the time step moves the joint torque by 0.08 N m RMS.",),
        provenance=_PROVENANCE,
    ),
}


def trace(name: str, seconds: float, closed: bool, seed: int = 0) -> TrialTrace:
    """Return a trial of slow sines whose friction the baseline underestimates."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, 0.004)
    joint = 0.6 * np.sin(1.5 * time) * (0.5 + time / (2 * seconds))
    speed = np.gradient(joint, time)
    measured, before, after = {}, {}, {}
    for size, channel in enumerate(TORQUES, start=1):
        torque = size * (1.5 * joint + 0.6 * np.tanh(speed / 0.05))
        missing = size * 0.25 * speed * np.abs(speed)
        noise = 0.03 * rng.standard_normal(len(time))
        measured[channel] = torque + missing + noise
        before[channel] = torque
        after[channel] = torque + 0.95 * missing if closed else torque
    counts = (time > 1.0).astype(float)
    motor = 3.0 * joint + 0.02 * np.tanh(speed / 0.05)
    return TrialTrace(name, time, motor, joint, measured, before, after, counts)


def maps(closed: bool = True) -> tuple[Map, ...]:
    """Return maps over speed, time and motion since reversal, in decades."""
    found = []
    for number, channel in enumerate(TORQUES):
        speed = np.linspace(-0.9, 0.9, 15)
        error = (0.3 - 0.1 * number) * speed * np.abs(speed)
        error[3] = np.nan
        flat = np.full(15, 0.02)
        rest = 0.05 * error if closed else error
        share = 0.62 - 0.3 * number
        found.append(
            Map(channel, "joint speed", "rad/s", speed, error, rest, flat, share, 0.04)
        )
        time = np.linspace(0.5, 19.5, 15)
        drift = 0.001 * (time - 10)
        found.append(
            Map(channel, "time in trial", "s", time, drift, drift, flat, 0.03, 0.05)
        )
        since = np.geomspace(1e-5, 1e-2, 15)
        step = 0.1 * np.exp(-since / 1e-3)
        left = 0.2 * step if closed else step
        found.append(
            Map(
                channel,
                "motion since reversal",
                "m",
                since,
                step,
                left,
                flat,
                0.21,
                0.05,
            )
        )
    return tuple(found)


def isolability() -> Isolability:
    """Return random signatures, two pairs of which are nearly collinear."""
    rng = np.random.default_rng(3)
    signs = rng.standard_normal((len(IDS), 8))
    signs[2] = signs[1] + 0.2 * rng.standard_normal(8)
    signs[7] = signs[4] + 0.4 * rng.standard_normal(8)
    signs /= np.linalg.norm(signs, axis=1, keepdims=True)
    visible = np.geomspace(0.05, 60.0, len(IDS))[rng.permutation(len(IDS))]
    return Isolability(IDS, np.abs(signs @ signs.T), visible)


def evidence(closed: bool = True) -> Evidence:
    """Return evidence with all figures, with the gap closed or not."""
    traces = (trace("a", 20.0, closed), trace("b & <c>", 9.0, closed, seed=1))
    return Evidence(traces, maps(closed), isolability())


NOTHING = Evidence((), (), Isolability((), np.zeros((0, 0)), np.zeros(0)))
"""Evidence of a diagnosis without any simulation."""
