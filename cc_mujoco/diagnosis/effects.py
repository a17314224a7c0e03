"""The effects that a diagnosis can name: one entry each.

An entry says what the effect is, where it acts, what its parameters are, and how it
changes a simulation: through the cables (`cables`), or through what the sensors of
motor and joint show (`torques`; `JOINT_DELAY` changes what is played, too). Parameters
at 0 are off, bit for bit. To add an effect, write its entry, and how MuJoCo has it in
`realisation` where it is not in the cable.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from cc_mujoco.compiled import FloatArray
from cc_mujoco.transmission import PARAMETERS, Cable

Values = Mapping[str, float]

GAIN = (-0.3, 0.3)
"""Error of a torque sensor's gain that calibration leaves; beyond, it is declared."""
_BIAS = (-0.3, 0.3)
"""Offset of a torque sensor over the largest torque, beyond which anybody sees it."""
_ONE_WAY = (-0.5, 0.5)
"""Difference of friction between two directions, over its mean."""
PLAY = (0.0, 0.15)
"""Backlash over the joint's range of motion."""
_ROUND = (-0.25, 0.25)
"""Eccentricity and ovality over the radius of a pulley that anybody would use."""
_LATE = (-0.1, 0.1)
"""Delay of a signal chain that would not have been noticed [s]."""
_POSITIVE = (0.0, math.inf)
_LOOSE_END = 0.03
"""Share of a cable that may lie straight in either end, where nothing holds it."""
_SOFT = (0.0, 10.0)
"""Compliance of an end over that of the cable, beyond which it is a spring's."""
_TIGHT_END = 0.015
"""Friction of uneven bends and ends over the pretension."""
_TAUTEST = 0.1
"""Least share of the compliance at rest that is not bedding."""
_LARGEST = next(p.high for p in PARAMETERS if p.name == "friction")
"""Largest coefficient that a cable takes."""
ANTAGONIST = "antagonist"
"""In the names of parameters that are the second cable's of a pair."""
_FITTINGS = (
    "end_compliance",
    "end_compliance_antagonist",
    "proximal_compliance",
    "proximal_compliance_antagonist",
)
"""Compliances of where the cables are fastened, at the joint and at the motor."""
JOINT_DELAY = "joint_delay"
"""By how much the joint's angle and torque come late together [s]."""


class EffectParameter(NamedTuple):
    """One parameter of an effect; 0 is off.

    Attributes:
        name: of the parameter.
        unit: its unit.
        typical: size that is plausible on a rig; the scale of fits.
        low: lower bound of fits.
        high: upper bound of fits.
        plausible: least and largest value that the effect can stand for; what fits only
            beyond is not named.
        of: what `plausible` is a share of: the joint's range of motion, the motor's
            radius, the largest torque, the elongation of the scene's cable per tension,
            or nothing.
        ordinary: size that any rig may have without being told, a share of
            `ordinary_of`; what is no larger belongs into the model, but is not called
            missing.
        ordinary_of: the elongation of the cable per tension, or the pretension (of
            the friction per length times the length of the conduit).
    """

    name: str
    unit: str
    typical: float
    low: float
    high: float
    plausible: tuple[float, float] = (-math.inf, math.inf)
    of: Literal[
        "", "motion", "motor_radius", "motor_torque", "joint_torque", "cable"
    ] = ""
    ordinary: float = 0.0
    ordinary_of: Literal["", "cable", "pretension", "pretension per length"] = ""


@dataclass(frozen=True)
class Torques:
    """Signals of one record (samples,): motion given, torques simulated [SI].

    Attributes:
        dt: time between samples.
        time: since the start of the trial.
        motor_angle: of the motor.
        joint_angle: of the joint as it is measured; of a lever as the scene has it.
        motor: torque that the motor puts into its pulley.
        joint: torque that the transmission puts into the joint.
        tilt: angle by which the rig was turned about the joint's axis.
    """

    dt: float
    time: FloatArray
    motor_angle: FloatArray
    joint_angle: FloatArray
    motor: FloatArray
    joint: FloatArray
    tilt: float = 0.0

    def added(
        self, motor: FloatArray | float = 0.0, joint: FloatArray | float = 0.0
    ) -> Torques:
        """With something added to the torques [Nm]."""
        return replace(self, motor=self.motor + motor, joint=self.joint + joint)


class Rig(NamedTuple):
    """What an effect may need to know of the rig."""

    motor_radius: float
    joint_radius: float
    exit_angle: float


@dataclass(frozen=True, kw_only=True)
class Effect:
    """One physical effect.

    Attributes:
        id: its name in `verdict.json`.
        title: what a person calls it.
        equation: what it adds.
        where: the part of the rig it sits in.
        parameters: its parameters.
        starts: values from which it is screened and fitted; several where the answer
            depends on a scale that the data must tell.
        required_excitation: what a recording needs to show it.
        confounded_with: ids that it is easily confused with.
        generalises: ids that are special cases of it; where one of them does as well,
            this one is no rival.
        mujoco: how a scene has it.
        source: publication.
        cables: the cables with the effect, agonist first.
        torques: the signals with the effect, in the order motor, joint, sensors.
        sensor: whether it belongs to a sensor and so comes after the mechanical ones.
    """

    id: str
    title: str
    equation: str
    where: Literal["conduit", "motor", "joint", "sensor"]
    parameters: tuple[EffectParameter, ...]
    starts: tuple[Values, ...]
    required_excitation: str
    confounded_with: tuple[str, ...]
    mujoco: str
    source: str
    cables: Callable[[tuple[Cable, ...], Values, Rig], tuple[Cable, ...]] | None = None
    torques: Callable[[Torques, Values], Torques] | None = None
    sensor: bool = False
    generalises: tuple[str, ...] = ()


def _on_both(*names: str) -> Callable[..., tuple[Cable, ...]]:
    """The same parameters on every cable."""

    def cables(given: tuple[Cable, ...], values: Values, _: Rig) -> tuple[Cable, ...]:
        changes = {name: values[name] for name in names}
        return tuple(cable.replace(**changes) for cable in given)

    return cables


def _stribeck(given: tuple[Cable, ...], values: Values, _: Rig) -> tuple[Cable, ...]:
    # A contact has one slip that renews it: where it ages, that which ageing tells.
    return tuple(
        cable.replace(
            stribeck_friction=values["stribeck_friction"],
            stribeck_speed=values["stribeck_speed"],
            critical_slip_distance=cable.critical_slip_distance
            if cable.ageing_friction > 0.0
            else values["stribeck_slip"],
        )
        for cable in given
    )


def _asymmetric(given: tuple[Cable, ...], values: Values, _: Rig) -> tuple[Cable, ...]:
    # Liners wear one by one, so two cables need not be alike. The antagonist moves the
    # other way.
    each = (values["friction_asymmetry"], -values["asymmetry_antagonist"])
    return tuple(
        cable.replace(friction_asymmetry=asymmetry)
        for cable, asymmetry in zip(given, each, strict=False)
    )


def _wrap(given: tuple[Cable, ...], values: Values, rig: Rig) -> tuple[Cable, ...]:
    # The distal end of the agonist moves by minus the joint's rim.
    growth = values["wrap_per_angle"] / rig.joint_radius
    signs = (-1.0, 1.0)
    return tuple(
        cable.replace(wrap_growth=sign * growth, wrap_reach=values["wrap_reach"])
        for cable, sign in zip(given, signs, strict=False)
    )


def _tension_dependent(
    given: tuple[Cable, ...], values: Values, _: Rig
) -> tuple[Cable, ...]:
    # A cable refers to its own pretension, which may be that of one trial; the
    # baseline's friction stays that of a cable in the scene's.
    usual = max(values.get("pretension", given[0].pretension), 1e-9)
    exponent = values["tension_exponent"]
    return tuple(
        cable.replace(
            tension_exponent=exponent,
            friction=min(
                cable.friction * (cable.pretension / usual) ** exponent, _LARGEST
            ),
        )
        if cable.pretension > 0.0
        else cable
        for cable in given
    )


def _eccentric(given: tuple[Cable, ...], values: Values, rig: Rig) -> tuple[Cable, ...]:
    def wave(name: str) -> tuple[float, float]:
        cosine, sine = values[f"{name}_cosine"], values[f"{name}_sine"]
        # A fit may try what no cable takes: more than the radius.
        size = min(math.hypot(cosine, sine), 0.45 * rig.motor_radius)
        return size, math.atan2(sine, cosine)

    size, phase = wave("eccentricity")
    ovality, second = wave("ovality")
    return tuple(
        cable.replace(
            eccentricity=size,
            eccentricity_phase=_turned(phase, side * rig.exit_angle),
            ovality=ovality,
            ovality_phase=_turned(second, 2.0 * side * rig.exit_angle),
        )
        for side, cable in enumerate(given)
    )


def _turned(phase: float, angle: float) -> float:
    return math.remainder(phase + angle, 2.0 * math.pi)


def _stiffening(given: tuple[Cable, ...], values: Values, _: Rig) -> tuple[Cable, ...]:
    # Strands bed in one by one, so two cables need not be alike. The baseline's
    # stiffness stays that of a cable in the scene's pretension, as far as it can.
    usual = values.get("pretension", given[0].pretension)
    half = values["bedding_tension"]
    each = (values["bedding_strain"], values["bedding_strain_antagonist"])
    found = []
    for cable, strain in zip(given, each, strict=False):
        soft = cable.axial_stiffness * strain * half / (usual + half) ** 2
        found.append(
            cable.replace(
                bedding_strain=strain,
                bedding_tension=half,
                axial_stiffness=cable.axial_stiffness / max(1.0 - soft, _TAUTEST),
            )
        )
    return tuple(found)


def _fitted(given: tuple[Cable, ...], values: Values, _: Rig) -> tuple[Cable, ...]:
    # Ends are fastened one by one.
    each = zip(_FITTINGS[0::2], _FITTINGS[1::2], strict=True)
    distal, proximal = ([values.get(name, 0.0) for name in names] for names in each)
    return tuple(
        cable.replace(end_compliance=far, proximal_compliance=near)
        for cable, far, near in zip(given, distal, proximal, strict=False)
    )


def acceleration(angle: FloatArray, dt: float) -> FloatArray:
    """Second derivative (samples,) [rad/s^2]."""
    found: FloatArray = np.gradient(np.gradient(angle, dt), dt)
    return found


def delayed(signal: FloatArray, by: float, dt: float) -> FloatArray:
    """The signal later by this time (samples,), held before it begins."""
    at = np.arange(signal.size) * dt
    found: FloatArray = np.interp(at - by, at, signal)
    return found


def _cogging(s: Torques, v: Values) -> Torques:
    at = v["cogging_order"] * s.motor_angle
    wave = v["cogging_cosine"] * np.cos(at) + v["cogging_sine"] * np.sin(at)
    return s.added(motor=wave)


def _gravity(s: Torques, v: Values) -> Torques:
    q = s.joint_angle + s.tilt
    return s.added(
        joint=-(v["gravity_sine"] * np.sin(q) + v["gravity_cosine"] * np.cos(q))
    )


def _gain(s: Torques, v: Values) -> Torques:
    motor, joint = v["motor_torque_gain"], v["joint_torque_gain"]
    return replace(s, motor=s.motor * (1.0 + motor), joint=s.joint * (1.0 + joint))


def _delay(s: Torques, v: Values) -> Torques:
    return replace(
        s,
        motor=delayed(s.motor, v["motor_torque_delay"], s.dt),
        joint=delayed(s.joint, v["joint_torque_delay"], s.dt),
    )


_PLUGIN = "keys of the cable plugin"

EFFECTS: dict[str, Effect] = {
    effect.id: effect
    for effect in (
        Effect(
            id="viscous_friction",
            title="viscous friction in the conduit",
            equation="dT/dx += c v",
            where="conduit",
            parameters=(
                EffectParameter("viscous_friction", "N s/m^2", 50.0, 0.0, 1e5),
            ),
            starts=({"viscous_friction": 50.0},),
            required_excitation="speeds over a decade",
            confounded_with=("sensor_delay", "stribeck_friction"),
            mujoco=_PLUGIN,
            source="thesis 2.4.4, Fig. 2.13",
            cables=_on_both("viscous_friction"),
        ),
        Effect(
            id="grease_drag",
            title="drag of a grease that thins as it is sheared",
            equation="dT/dx += s g |v|^n",
            where="conduit",
            parameters=(
                EffectParameter("grease_drag", "N/m", 5.0, 0.0, 1e4),
                EffectParameter("grease_exponent", "1", 0.5, 0.3, 0.7),
            ),
            starts=({"grease_drag": 5.0, "grease_exponent": 0.5},),
            required_excitation="speeds over two decades",
            confounded_with=(
                "viscous_friction",
                "load_independent_friction",
                "stribeck_friction",
            ),
            mujoco=_PLUGIN,
            source="Herschel and Bulkley, Kolloid-Zeitschrift 39, 1926",
            cables=_on_both("grease_drag", "grease_exponent"),
            generalises=("viscous_friction", "load_independent_friction"),
        ),
        Effect(
            id="stribeck_friction",
            title="Stribeck friction: more friction at low speed",
            equation="mu += mu_b exp(-|v|/v_b)",
            where="conduit",
            parameters=(
                EffectParameter("stribeck_friction", "1", 0.05, 0.0, 2.0),
                EffectParameter("stribeck_speed", "m/s", 0.02, 5e-4, 0.5),
                EffectParameter("stribeck_slip", "m", 2e-4, 1e-5, 0.02),
            ),
            starts=tuple(
                {
                    "stribeck_friction": 0.05,
                    "stribeck_speed": speed,
                    "stribeck_slip": 2e-4,
                }
                for speed in (0.003, 0.01, 0.04)
            ),
            required_excitation="slow motion and reversals",
            confounded_with=(
                "viscous_friction",
                "presliding",
                "dwell_dependent_stiction",
            ),
            mujoco=_PLUGIN,
            source="Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30, 1994",
            cables=_stribeck,
        ),
        Effect(
            id="presliding",
            title="presliding: friction builds up over a distance",
            equation="f = clip(f + sigma du, capstan cone), sigma = mu theta T/z",
            where="conduit",
            parameters=(EffectParameter("bristle_length", "m", 1e-4, 0.0, 0.01),),
            starts=({"bristle_length": 5e-5}, {"bristle_length": 5e-4}),
            required_excitation="small reversals",
            confounded_with=("end_compliance", "backlash", "cable_stiffening"),
            mujoco=_PLUGIN,
            source="Dahl 1968; Palli and Melchiorri 2014; thesis (1.2)",
            cables=_on_both("bristle_length"),
        ),
        Effect(
            id="load_independent_friction",
            title="friction that needs no tension",
            equation="dT/dx += s f_0, and s F at the seal of either end",
            where="conduit",
            parameters=(
                EffectParameter(
                    "load_independent_friction",
                    "N/m",
                    1.0,
                    0.0,
                    1e4,
                    ordinary=_TIGHT_END,
                    ordinary_of="pretension per length",
                ),
                *(
                    EffectParameter(
                        name,
                        "N",
                        1.0,
                        0.0,
                        1e4,
                        ordinary=_TIGHT_END,
                        ordinary_of="pretension",
                    )
                    for name in ("seal_proximal", "seal_distal")
                ),
            ),
            starts=(
                {
                    "load_independent_friction": 1.0,
                    "seal_proximal": 1.0,
                    "seal_distal": 1.0,
                },
            ),
            required_excitation="two levels of load or pretension",
            confounded_with=("tension_dependent_friction",),
            mujoco=_PLUGIN,
            source="Palli and Melchiorri, Mechatronics 24, 2014",
            cables=_on_both(
                "load_independent_friction", "seal_proximal", "seal_distal"
            ),
        ),
        Effect(
            id="asymmetric_friction",
            title="friction that depends on the direction of motion",
            equation="mu (1 + s a)",
            where="conduit",
            parameters=(
                EffectParameter("friction_asymmetry", "1", 0.1, -0.9, 0.9, _ONE_WAY),
                EffectParameter("asymmetry_antagonist", "1", 0.1, -0.9, 0.9, _ONE_WAY),
            ),
            starts=({"friction_asymmetry": 0.1, "asymmetry_antagonist": 0.1},),
            required_excitation="motion in both directions at several loads",
            confounded_with=("torque_sensor_offset",),
            mujoco=_PLUGIN,
            source="Duclusaud et al., arXiv 2410.08650 (directional friction)",
            cables=_asymmetric,
        ),
        Effect(
            id="tension_dependent_friction",
            title="friction coefficient that changes with tension",
            equation="mu (T/T0)^e",
            where="conduit",
            parameters=(EffectParameter("tension_exponent", "1", 0.1, -1.0, 1.0),),
            starts=({"tension_exponent": -0.1},),
            required_excitation="tension over a factor of 2",
            confounded_with=(
                "load_independent_friction",
                "configuration_dependent_wrap",
            ),
            mujoco=_PLUGIN,
            source="Jung, Pan, Kang, Tribology International 41, 2008",
            cables=_tension_dependent,
        ),
        Effect(
            id="dwell_dependent_stiction",
            title="break-away friction that grows with rest",
            equation="mu_s = mu + b ln(1 + t/t_a)",
            where="conduit",
            parameters=(
                EffectParameter("ageing_friction", "1", 0.05, 0.0, 2.0),
                EffectParameter("critical_slip_distance", "m", 1e-3, 1e-5, 0.02),
                EffectParameter("ageing_time", "s", 1.0, 1e-3, 100.0),
            ),
            starts=(
                {
                    "ageing_friction": 0.02,
                    "critical_slip_distance": 2e-4,
                    "ageing_time": 0.05,
                },
                {
                    "ageing_friction": 0.05,
                    "critical_slip_distance": 3e-4,
                    "ageing_time": 1.0,
                },
                {
                    "ageing_friction": 0.05,
                    "critical_slip_distance": 3e-3,
                    "ageing_time": 1.0,
                },
            ),
            required_excitation="pauses of different length",
            confounded_with=("stribeck_friction",),
            mujoco=_PLUGIN,
            source="Dieterich, Pure Appl. Geophys. 116, 1978; Ruina, JGR 88, 1983",
            cables=_on_both("ageing_friction", "critical_slip_distance", "ageing_time"),
        ),
        Effect(
            id="configuration_dependent_wrap",
            title="wrap that changes with the joint angle",
            equation="theta (1 + k q) in the last part of the conduit",
            where="conduit",
            parameters=(
                EffectParameter("wrap_per_angle", "1/rad", 0.1, -5.0, 5.0),
                EffectParameter("wrap_reach", "1", 0.5, 0.05, 1.0),
            ),
            starts=(
                {"wrap_per_angle": 0.1, "wrap_reach": 0.9},
                {"wrap_per_angle": 0.3, "wrap_reach": 0.3},
            ),
            required_excitation="motion at different joint angles",
            confounded_with=(
                "joint_gravity",
                "pulley_eccentricity",
                "tension_dependent_friction",
            ),
            mujoco=_PLUGIN,
            source="thesis 2.4.3, Experiment 1b",
            cables=_wrap,
        ),
        Effect(
            id="pretension_loss",
            title="pretension that is lost during a trial",
            equation="T0 (1 - c (1 - exp(-t/t_c)))",
            where="conduit",
            parameters=(
                EffectParameter("stress_relaxation", "1", 0.1, 0.0, 1.0),
                EffectParameter("relaxation_time", "s", 10.0, 0.5, 1e4),
            ),
            starts=(
                {"stress_relaxation": 0.1, "relaxation_time": 2.0},
                {"stress_relaxation": 0.1, "relaxation_time": 20.0},
            ),
            required_excitation="trials much longer than a cycle",
            confounded_with=("friction_drift",),
            mujoco=_PLUGIN,
            source="standard linear solid",
            cables=_on_both("stress_relaxation", "relaxation_time"),
        ),
        Effect(
            id="friction_drift",
            title="friction that drifts during a trial",
            equation="mu (1 + d t + h W), W the heat of friction that is left",
            where="conduit",
            parameters=(
                EffectParameter("friction_drift", "1/s", 0.01, -1.0, 1.0),
                EffectParameter("friction_heating", "1/J", 0.02, -10.0, 10.0),
                EffectParameter("cooling_time", "s", 10.0, 1.0, 1e3),
            ),
            starts=(
                {
                    "friction_drift": 0.01,
                    "friction_heating": 0.02,
                    "cooling_time": 10.0,
                },
            ),
            required_excitation="trials much longer than a cycle",
            confounded_with=("pretension_loss",),
            mujoco=_PLUGIN,
            source="thesis 3.2.3",
            cables=_on_both("friction_drift", "friction_heating", "cooling_time"),
        ),
        Effect(
            id="backlash",
            title="play between pulley and joint",
            equation="|q_pulley - q| <= b/2",
            where="joint",
            parameters=(
                EffectParameter("backlash", "rad", 0.02, 0.0, 0.5, PLAY, "motion"),
            ),
            starts=({"backlash": 0.01}, {"backlash": 0.05}),
            required_excitation="reversals of torque at several loads",
            confounded_with=("presliding", "end_compliance"),
            mujoco="pulley on a hinge of its own, coupled by a fixed tendon "
            "with two limits",
            source="Nordin and Gutman, Automatica 38, 2002",
        ),
        Effect(
            id="pulley_eccentricity",
            title="motor pulley that is eccentric or oval",
            equation="r + e cos(q_m - p) + o cos(2 q_m - s)",
            where="motor",
            parameters=(
                EffectParameter(
                    "eccentricity_cosine",
                    "m",
                    5e-4,
                    -0.05,
                    0.05,
                    _ROUND,
                    "motor_radius",
                ),
                EffectParameter(
                    "eccentricity_sine", "m", 5e-4, -0.05, 0.05, _ROUND, "motor_radius"
                ),
                EffectParameter(
                    "ovality_cosine", "m", 2e-4, -0.05, 0.05, _ROUND, "motor_radius"
                ),
                EffectParameter(
                    "ovality_sine", "m", 2e-4, -0.05, 0.05, _ROUND, "motor_radius"
                ),
            ),
            starts=(
                {
                    "eccentricity_cosine": 5e-4,
                    "eccentricity_sine": 5e-4,
                    "ovality_cosine": 2e-4,
                    "ovality_sine": 2e-4,
                },
            ),
            required_excitation="half a turn of the motor pulley or more",
            confounded_with=("torque_sensor_gain", "joint_gravity", "motor_cogging"),
            mujoco=_PLUGIN,
            source="geometry",
            cables=_eccentric,
        ),
        Effect(
            id="motor_cogging",
            title="torque ripple of the motor",
            equation="tau_m += a cos(n q_m - p)",
            where="motor",
            parameters=(
                EffectParameter("cogging_cosine", "Nm", 0.02, -100.0, 100.0),
                EffectParameter("cogging_sine", "Nm", 0.02, -100.0, 100.0),
                EffectParameter("cogging_order", "1", 1.0, 3.5, 200.0),
            ),
            starts=tuple(
                {"cogging_cosine": 0.02, "cogging_sine": 0.02, "cogging_order": order}
                for order in (*range(4, 28, 2), 30, 33, 36, 40, 44, 48)
            ),
            required_excitation="slow motion over several poles",
            confounded_with=("pulley_eccentricity",),
            mujoco="cogging of a `dcmotor` actuator on the motor, in the sum "
            "of its torque",
            source="MuJoCo dcmotor cogging",
            torques=_cogging,
        ),
        Effect(
            id="cable_stiffening",
            title="cable that stiffens under tension",
            equation="strain += e T / (T + T_b), EA at T_0 as before",
            where="conduit",
            parameters=(
                EffectParameter("bedding_strain", "1", 5e-4, 0.0, 0.3),
                EffectParameter("bedding_strain_antagonist", "1", 5e-4, 0.0, 0.3),
                EffectParameter("bedding_tension", "N", 20.0, 1.0, 500.0),
            ),
            starts=tuple(
                {
                    "bedding_strain": 5e-4,
                    "bedding_strain_antagonist": 5e-4,
                    "bedding_tension": half,
                }
                for half in (10.0, 60.0)
            ),
            required_excitation="large and small loads, slack, or two pretensions",
            confounded_with=("end_compliance", "presliding"),
            mujoco=_PLUGIN,
            source="constructional stretch of ropes, as their makers give it",
            cables=_stiffening,
        ),
        Effect(
            id="end_compliance",
            title="compliance of an end fitting",
            equation="u_d += C T_d, u_p -= C T_p",
            where="conduit",
            parameters=tuple(
                EffectParameter(
                    name,
                    "m/N",
                    1e-5,
                    0.0,
                    0.01,
                    _SOFT,
                    "cable",
                    ordinary=2.0 * _LOOSE_END,
                    ordinary_of="cable",
                )
                for name in _FITTINGS
            ),
            starts=(dict.fromkeys(_FITTINGS, 1e-5),),
            required_excitation="reversals at several loads",
            confounded_with=("presliding", "backlash", "cable_stiffening"),
            mujoco=_PLUGIN,
            source="series springs",
            cables=_fitted,
        ),
        Effect(
            id="joint_gravity",
            title="gravity on the joint",
            equation="tau_j -= a sin q + b cos q",
            where="joint",
            parameters=(
                EffectParameter("gravity_sine", "Nm", 0.1, -1e3, 1e3),
                EffectParameter("gravity_cosine", "Nm", 0.1, -1e3, 1e3),
            ),
            starts=({"gravity_sine": 0.1, "gravity_cosine": 0.1},),
            required_excitation="joint angles over half a radian",
            confounded_with=(
                "joint_stiffness",
                "torque_sensor_gain",
                "torque_sensor_offset",
            ),
            mujoco="cogging of a `dcmotor` actuator on the joint, one period per turn",
            source="statics",
            torques=_gravity,
        ),
        Effect(
            id="joint_stiffness",
            title="a spring on the joint",
            equation="tau_j -= k q",
            where="joint",
            parameters=(
                EffectParameter("joint_stiffness", "Nm/rad", 0.2, -1e4, 1e4, _POSITIVE),
            ),
            starts=({"joint_stiffness": 0.2},),
            required_excitation="joint angles over half a radian",
            confounded_with=("joint_gravity", "torque_sensor_gain"),
            mujoco="`stiffness` of the joint",
            source="statics",
            torques=lambda s, v: s.added(joint=-v["joint_stiffness"] * s.joint_angle),
        ),
        Effect(
            id="joint_inertia",
            title="inertia between transmission and joint sensor",
            equation="tau_j -= J q''",
            where="joint",
            parameters=(
                EffectParameter(
                    "joint_inertia", "kg m^2", 1e-3, -10.0, 10.0, _POSITIVE
                ),
            ),
            starts=({"joint_inertia": 1e-3},),
            required_excitation="accelerations over a decade",
            confounded_with=("sensor_delay", "joint_stiffness"),
            mujoco="`armature` of the joint, shown by a weightless body "
            "that rides along",
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
                EffectParameter("motor_inertia", "kg m^2", 1e-4, -1.0, 1.0, _POSITIVE),
            ),
            starts=({"motor_inertia": 1e-4},),
            required_excitation="accelerations over a decade",
            confounded_with=("sensor_delay", "viscous_friction"),
            mujoco="`armature` of the motor, shown by a weightless body "
            "that rides along",
            source="dynamics",
            torques=lambda s, v: s.added(
                motor=v["motor_inertia"] * acceleration(s.motor_angle, s.dt)
            ),
        ),
        Effect(
            id="torque_sensor_gain",
            title="gain of a torque sensor",
            equation="tau (1 + g)",
            where="sensor",
            parameters=(
                EffectParameter("motor_torque_gain", "1", 0.05, -0.9, 9.0, GAIN),
                EffectParameter("joint_torque_gain", "1", 0.05, -0.9, 9.0, GAIN),
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
                EffectParameter(
                    "motor_torque_bias", "Nm", 0.1, -1e3, 1e3, _BIAS, "motor_torque"
                ),
                EffectParameter(
                    "joint_torque_bias", "Nm", 0.1, -1e3, 1e3, _BIAS, "joint_torque"
                ),
                EffectParameter("motor_torque_drift", "Nm/s", 0.01, -10.0, 10.0),
                EffectParameter("joint_torque_drift", "Nm/s", 0.01, -10.0, 10.0),
            ),
            starts=(
                {
                    "motor_torque_bias": 0.1,
                    "joint_torque_bias": 0.1,
                    "motor_torque_drift": 0.01,
                    "joint_torque_drift": 0.01,
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
                EffectParameter(JOINT_DELAY, "s", 0.005, -0.2, 0.2, _LATE),
                EffectParameter("motor_torque_delay", "s", 0.005, -0.2, 0.2, _LATE),
                EffectParameter("joint_torque_delay", "s", 0.005, -0.2, 0.2, _LATE),
            ),
            starts=(
                {
                    JOINT_DELAY: 0.005,
                    "motor_torque_delay": 0.005,
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
    )
}
"""Every effect of the library by its id."""
