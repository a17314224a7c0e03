"""Effects of pulleys, motor, joint and sensors; those of sensors act last."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from cc_mujoco.cable import Cable
from cc_mujoco.cable._parameter import Parameter
from cc_mujoco.diagnosis.effects._effect import (
    PLUGIN_KEYS,
    Effect,
    EffectParameter,
    RigGeometry,
    Signals,
    Values,
    clamp_to_bounds,
    form_key,
    sized,
)
from cc_mujoco.native import FloatArray

BACKLASH_BOUNDS = (0.0, 0.15)
"""Backlash over the joint's range of motion."""
_ROUNDNESS_BOUNDS = (-0.25, 0.25)
"""Largest plausible eccentricity and ovality of a pulley over its radius."""
_AT_MOST_MEASURED = (-1.0, 1.0)
"""Share of the largest torque at the joint; more would show in the readings."""
MAX_REST_ANGLE = 2.0 * math.pi
"""Largest angle between a joint's 0 and the rest of a spring on it [rad]."""
EXIT_FORMS = ("cables leaving as the scene has them", "cables leaving half a turn off")
"""Forms of an eccentric pulley: the exit angle, and half a turn more."""
_POSITIVE = (0.0, math.inf)


def _eccentric(
    given: tuple[Cable, ...], values: Values, rig: RigGeometry
) -> tuple[Cable, ...]:
    def wave(name: str) -> tuple[float, float]:
        cosine, sine = values[f"{name}_cosine"], values[f"{name}_sine"]
        # A fit may try values that no cable accepts: more than the radius.
        size = min(math.hypot(cosine, sine), 0.45 * rig.motor_radius)
        return size, math.atan2(sine, cosine)

    turn = rig.exit_angle + math.pi * values.get(form_key("pulley_eccentricity"), 0.0)
    size, phase = wave("eccentricity")
    ovality, second = wave("ovality")
    return tuple(
        cable.replace(
            eccentricity=size,
            eccentricity_phase=_rotate_phase(phase, side * turn),
            ovality=ovality,
            ovality_phase=_rotate_phase(second, 2.0 * side * turn),
        )
        for side, cable in enumerate(given)
    )


def _soft_play(
    given: tuple[Cable, ...], values: Values, rig: RigGeometry
) -> tuple[Cable, ...]:
    # In the soft form the pretension presses each cable's part of the edges in by a
    # quarter of the play.
    play = values["backlash"]
    if play == 0.0 or round(values.get(form_key("backlash"), 0.0)) == 0:
        return given
    edge = 0.25 * play * rig.joint_radius
    return tuple(
        cable.replace(
            end_compliance=clamp_to_bounds(
                "end_compliance",
                cable.end_compliance + edge / max(cable.pretension, 1e-9),
            )
        )
        for cable in given
    )


def _rotate_phase(phase: float, angle: float) -> float:
    return math.remainder(phase + angle, 2.0 * math.pi)


def acceleration(angle: FloatArray, dt: float) -> FloatArray:
    """Return the second derivative (samples,) [rad/s^2]."""
    found: FloatArray = np.gradient(np.gradient(angle, dt), dt)
    return found


def _cogging(s: Signals, v: Values) -> Signals:
    at = v["cogging_order"] * s.motor_angle
    wave = v["cogging_cosine"] * np.cos(at) + v["cogging_sine"] * np.sin(at)
    return s.added(motor=wave)


def _gravity(s: Signals, v: Values) -> Signals:
    q = s.joint_angle + s.tilt
    return s.added(
        joint=-(v["gravity_sine"] * np.sin(q) + v["gravity_cosine"] * np.cos(q))
    )


def _spring(s: Signals, v: Values) -> Signals:
    moment = v["joint_stiffness"] * s.joint_angle + v["joint_stiffness_moment"]
    return s.added(joint=-moment)


def _far_rest(v: Values) -> str:
    """Describe a spring with a rest so far away that it only adds an offset."""
    stiffness, moment = abs(v["joint_stiffness"]), abs(v["joint_stiffness_moment"])
    if moment <= MAX_REST_ANGLE * stiffness:
        return ""
    angle = moment / max(stiffness, 1e-300)
    return f"a spring that rests {angle:.3g} rad from joint angle 0, over a turn"


DRIVE_EFFECTS = (
    Effect(
        id="backlash",
        title="play between pulley and joint",
        equation="|q_pulley - q| <= b/2",
        where="joint",
        parameters=(
            sized(
                "backlash", "rad", "play of the joint in its pulley, from stop to stop",
                0.0, 0.5, 0.02, BACKLASH_BOUNDS, "motion",
            ),
        ),
        starts=({"backlash": 0.01}, {"backlash": 0.05}),
        required_excitation="reversals of torque at several loads",
        confounded_with=("presliding", "end_compliance"),
        mujoco=(
            "pulley on a hinge of its own, coupled by a fixed tendon with two limits"
        ),
        source="Nordin and Gutman, Automatica 38, 2002",
        cables=_soft_play,
        forms=("hard", "soft"),
    ),
    Effect(
        id="pulley_eccentricity",
        title="motor pulley that is eccentric or oval",
        equation="r + e cos(q_m - p) + o cos(2 q_m - s)",
        where="motor",
        parameters=(
            sized(
                "eccentricity_cosine", "m",
                "eccentricity of the motor pulley, cosine of its angle", -0.05, 0.05,
                5e-4, _ROUNDNESS_BOUNDS, "motor_radius",
            ),
            sized(
                "eccentricity_sine", "m",
                "eccentricity of the motor pulley, sine of its angle", -0.05, 0.05,
                5e-4, _ROUNDNESS_BOUNDS, "motor_radius",
            ),
            sized(
                "ovality_cosine", "m",
                "ovality of the motor pulley, cosine of twice its angle", -0.05, 0.05,
                2e-4, _ROUNDNESS_BOUNDS, "motor_radius",
            ),
            sized(
                "ovality_sine", "m",
                "ovality of the motor pulley, sine of twice its angle", -0.05, 0.05,
                2e-4, _ROUNDNESS_BOUNDS, "motor_radius",
            ),
        ),
        starts=tuple(
            {
                "eccentricity_cosine": 5e-4,
                "eccentricity_sine": 5e-4,
                "ovality_cosine": 2e-4,
                "ovality_sine": 2e-4,
                form_key("pulley_eccentricity"): form,
            }
            for form in (0.0, 1.0)
        ),
        required_excitation="half a turn of the motor pulley or more",
        confounded_with=("torque_sensor_gain", "joint_gravity", "motor_cogging"),
        mujoco=PLUGIN_KEYS,
        source="geometry",
        cables=_eccentric,
        forms=EXIT_FORMS,
    ),
    Effect(
        id="motor_cogging",
        title="torque ripple of the motor",
        equation="tau_m += a cos(n q_m - p)",
        where="motor",
        parameters=(
            sized(
                "cogging_cosine", "N m", "torque ripple of the motor, cosine", -100.0,
                100.0, 0.02,
            ),
            sized(
                "cogging_sine", "N m", "torque ripple of the motor, sine", -100.0,
                100.0, 0.02,
            ),
            EffectParameter(
                Parameter(
                    "cogging_order", "1",
                    "periods of the ripple per turn of the motor pulley", 3.5, 200.0,
                    scale="log",
                ),
                1.0,
            ),
        ),
        starts=tuple(
            {"cogging_cosine": 0.02, "cogging_sine": 0.02, "cogging_order": order}
            for order in (*range(4, 28, 2), 30, 33, 36, 40, 44, 48)
        ),
        required_excitation="slow motion over several poles",
        confounded_with=("pulley_eccentricity",),
        mujoco="cogging of a `dcmotor` actuator on the motor, in the sum of its torque",
        source="MuJoCo dcmotor cogging",
        torques=_cogging,
    ),
    Effect(
        id="joint_gravity",
        title="gravity on the joint",
        equation="tau_j -= a sin q + b cos q",
        where="joint",
        parameters=(
            sized(
                "gravity_sine", "N m",
                "moment of gravity at the joint, sine of its angle", -1e3, 1e3, 0.1,
                _AT_MOST_MEASURED, "joint_torque",
            ),
            sized(
                "gravity_cosine", "N m",
                "moment of gravity at the joint, cosine of its angle", -1e3, 1e3, 0.1,
                _AT_MOST_MEASURED, "joint_torque",
            ),
        ),
        starts=({"gravity_sine": 0.1, "gravity_cosine": 0.1},),
        required_excitation="joint angles over half a radian",
        confounded_with=(
            "joint_stiffness", "torque_sensor_gain", "torque_sensor_offset",
        ),
        mujoco="cogging of a `dcmotor` actuator on the joint, one period per turn",
        source="statics",
        torques=_gravity,
    ),
    Effect(
        id="joint_stiffness",
        title="a spring on the joint",
        equation="tau_j -= k q + m, at rest where q = -m/k",
        where="joint",
        parameters=(
            sized(
                "joint_stiffness", "N m/rad", "stiffness of a spring on the joint",
                -1e4, 1e4, 0.2, (0.0, 1.0), "joint_torque per motion",
            ),
            sized(
                "joint_stiffness_moment", "N m",
                "moment of that spring where the joint is at 0", -1e3, 1e3, 0.1,
                _AT_MOST_MEASURED, "joint_torque", beside=True,
            ),
        ),
        starts=({"joint_stiffness": 0.2, "joint_stiffness_moment": 0.1},),
        required_excitation="joint angles over half a radian",
        confounded_with=("joint_gravity", "torque_sensor_gain", "torque_sensor_offset"),
        mujoco="`stiffness` and `springref` of the joint",
        source="statics",
        torques=_spring,
        form_of=("joint_gravity",),
        implausible=_far_rest,
    ),
    Effect(
        id="joint_inertia",
        title="inertia between transmission and joint sensor",
        equation="tau_j -= J q''",
        where="joint",
        parameters=(
            sized(
                "joint_inertia", "kg m^2",
                "inertia between transmission and joint sensor", -10.0, 10.0, 1e-3,
                _POSITIVE,
            ),
        ),
        starts=({"joint_inertia": 1e-3},),
        required_excitation="accelerations over a decade",
        confounded_with=("sensor_delay", "joint_stiffness"),
        mujoco="`armature` of the joint, shown by a weightless body that rides along",
        source="dynamics",
        torques=lambda s, v: s.added(
            joint=-v["joint_inertia"] * acceleration(s.joint_angle, s.dt)
        ),
    ),
    Effect(
        id="motor_inertia",
        title="inertia between motor sensor and pulley",
        equation="tau_m += J q_m''",
        where="motor",
        parameters=(
            sized(
                "motor_inertia", "kg m^2", "inertia between motor sensor and pulley",
                -1.0, 1.0, 1e-4, _POSITIVE,
            ),
        ),
        starts=({"motor_inertia": 1e-4},),
        required_excitation="accelerations over a decade",
        confounded_with=("sensor_delay", "viscous_friction"),
        mujoco="`armature` of the motor, shown by a weightless body that rides along",
        source="dynamics",
        torques=lambda s, v: s.added(
            motor=v["motor_inertia"] * acceleration(s.motor_angle, s.dt)
        ),
    ),
)  # fmt: skip
"""Effects of pulleys, motor and joint in the library."""


GAIN_BOUNDS = (-0.3, 0.3)
"""Error of a torque sensor's gain that calibration leaves; beyond, it is declared."""
_OFFSET_BOUNDS = (-0.3, 0.3)
"""Offset of a torque sensor over the largest torque; a larger one would be noticed."""
_DELAY_BOUNDS = (-0.1, 0.1)
"""Delay of a signal chain; a larger one would be noticed [s]."""
JOINT_DELAY = "joint_delay"
"""Effect that delays the joint's angle and torque together [s]."""


def delay_signal(signal: FloatArray, by: float, dt: float) -> FloatArray:
    """Return the signal delayed by this time, its first value held (samples,)."""
    at = np.arange(signal.size) * dt
    found: FloatArray = np.interp(at - by, at, signal)
    return found


def _gain(s: Signals, v: Values) -> Signals:
    motor, joint = v["motor_torque_gain"], v["joint_torque_gain"]
    return replace(s, motor=s.motor * (1.0 + motor), joint=s.joint * (1.0 + joint))


def _delay(s: Signals, v: Values) -> Signals:
    return replace(
        s,
        motor=delay_signal(s.motor, v["motor_torque_delay"], s.dt),
        joint=delay_signal(s.joint, v["joint_torque_delay"], s.dt),
    )


SENSOR_EFFECTS = (
    Effect(
        id="torque_sensor_gain",
        title="gain of a torque sensor",
        equation="tau (1 + g)",
        where="sensor",
        parameters=(
            sized(
                "motor_torque_gain", "1",
                "relative error of the gain of the motor torque sensor", -0.9, 9.0,
                0.05, GAIN_BOUNDS,
            ),
            sized(
                "joint_torque_gain", "1",
                "relative error of the gain of the joint torque sensor", -0.9, 9.0,
                0.05, GAIN_BOUNDS,
            ),
        ),
        starts=({"motor_torque_gain": 0.05, "joint_torque_gain": 0.05},),
        required_excitation="loads that hold still",
        confounded_with=("joint_gravity", "joint_stiffness"),
        mujoco="weights of the sensors that a torque is the sum of",
        source="calibration",
        torques=_gain,
        sensor=True,
    ),
    Effect(
        id="torque_sensor_offset",
        title="offset of a torque sensor",
        equation="tau + b + d t",
        where="sensor",
        parameters=(
            sized(
                "motor_torque_bias", "N m", "offset of the motor torque sensor", -1e3,
                1e3, 0.1, _OFFSET_BOUNDS, "motor_torque",
            ),
            sized(
                "joint_torque_bias", "N m", "offset of the joint torque sensor", -1e3,
                1e3, 0.1, _OFFSET_BOUNDS, "joint_torque",
            ),
            sized(
                "motor_torque_drift", "N m/s",
                "rate at which that of the motor torque sensor grows", -10.0, 10.0,
                0.01,
            ),
            sized(
                "joint_torque_drift", "N m/s",
                "rate at which that of the joint torque sensor grows", -10.0, 10.0,
                0.01,
            ),
        ),
        starts=(
            {
                "motor_torque_bias": 0.1, "joint_torque_bias": 0.1,
                "motor_torque_drift": 0.01, "joint_torque_drift": 0.01,
            },
        ),
        required_excitation=(
            "loads of both signs; for a drift, trials much longer than a cycle"
        ),
        confounded_with=("asymmetric_friction", "joint_gravity"),
        mujoco="a `clock` sensor in the sum that is the torque",
        source="calibration",
        torques=lambda s, v: s.added(
            v["motor_torque_bias"] + v["motor_torque_drift"] * s.time,
            v["joint_torque_bias"] + v["joint_torque_drift"] * s.time,
        ),
        sensor=True,
    ),
    Effect(
        id="sensor_delay",
        title="readings that are recorded late",
        equation="tau(t - d), q_j(t - d)",
        where="sensor",
        parameters=(
            sized(
                JOINT_DELAY, "s", "delay of the joint angle sensor", -0.2, 0.2, 0.005,
                _DELAY_BOUNDS,
            ),
            sized(
                "motor_torque_delay", "s", "delay of the motor torque sensor", -0.2,
                0.2, 0.005, _DELAY_BOUNDS,
            ),
            sized(
                "joint_torque_delay", "s", "delay of the joint torque sensor", -0.2,
                0.2, 0.005, _DELAY_BOUNDS,
            ),
        ),
        starts=(
            {
                JOINT_DELAY: 0.005, "motor_torque_delay": 0.005,
                "joint_torque_delay": 0.005,
            },
        ),
        required_excitation="fast and slow motion",
        confounded_with=("viscous_friction", "joint_inertia", "motor_inertia"),
        mujoco="`delay` of the sensors that a torque is the sum of",
        source="signal chain",
        torques=_delay,
        sensor=True,
    ),
)  # fmt: skip
"""Effects of sensors in the library."""
