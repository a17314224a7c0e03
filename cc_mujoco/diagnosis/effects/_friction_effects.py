"""Effects of friction in the conduit."""

from __future__ import annotations

from cc_mujoco.cable import Cable
from cc_mujoco.cable._parameter import Parameter
from cc_mujoco.diagnosis.effects._effect import (
    PLUGIN_KEYS,
    Effect,
    EffectParameter,
    RigGeometry,
    Values,
    clamp_to_bounds,
    form_key,
    of_cable,
    on_all_cables,
)

_ASYMMETRY_BOUNDS = (-0.5, 0.5)
"""Difference of friction between two directions, over its mean."""
_STRIBECK_FORMS = {
    "exponential": (1.0, 0.0),
    "Gaussian": (2.0, 0.0),
    "Lorentzian": (2.0, 1.0),
}
"""Exponent and tail of the forms of Stribeck friction."""
_END_FRICTION_SHARE = 0.015
"""Friction of uneven bends and ends over the pretension."""


def _stribeck(
    given: tuple[Cable, ...], values: Values, _: RigGeometry
) -> tuple[Cable, ...]:
    # A contact has one slip that renews it: where it ages, that which ageing tells.
    form = round(values.get(form_key("stribeck_friction"), 0.0))
    exponent, tail = tuple(_STRIBECK_FORMS.values())[form]
    return tuple(
        cable.replace(
            stribeck_friction=values["stribeck_friction"],
            stribeck_speed=values["stribeck_speed"],
            stribeck_exponent=exponent,
            stribeck_tail=tail,
            critical_slip_distance=cable.critical_slip_distance
            if cable.ageing_friction > 0.0
            else values["stribeck_slip"],
        )
        for cable in given
    )


def _asymmetric(
    given: tuple[Cable, ...], values: Values, _: RigGeometry
) -> tuple[Cable, ...]:
    # Liners wear one by one, so two cables may differ. The antagonist moves the
    # other way.
    each = (values["friction_asymmetry"], -values["asymmetry_antagonist"])
    return tuple(
        cable.replace(friction_asymmetry=asymmetry)
        for cable, asymmetry in zip(given, each, strict=False)
    )


def _tension_dependent(
    given: tuple[Cable, ...], values: Values, _: RigGeometry
) -> tuple[Cable, ...]:
    # A cable refers to its own pretension, which may be that of one trial; the
    # baseline's friction stays that of a cable in the scene's.
    usual = max(values.get("pretension", given[0].pretension), 1e-9)
    exponent = values["tension_exponent"]
    return tuple(
        cable.replace(
            tension_exponent=exponent,
            friction=clamp_to_bounds(
                "friction", cable.friction * (cable.pretension / usual) ** exponent
            ),
        )
        if cable.pretension > 0.0
        else cable
        for cable in given
    )


FRICTION_EFFECTS = (
    Effect(
        id="viscous_friction",
        title="viscous friction in the conduit",
        equation="dT/dx += c v",
        where="conduit",
        parameters=(EffectParameter(of_cable("viscous_friction", 0.0, 1e5), 50.0),),
        starts=({"viscous_friction": 50.0},),
        required_excitation="speeds over a decade",
        confounded_with=("sensor_delay", "stribeck_friction"),
        mujoco=PLUGIN_KEYS,
        source="thesis 2.4.4, Fig. 2.13",
        cables=on_all_cables("viscous_friction"),
    ),
    Effect(
        id="grease_drag",
        title="drag of a grease that thins as it is sheared",
        equation="dT/dx += s g |v|^n",
        where="conduit",
        parameters=(
            EffectParameter(of_cable("grease_drag", 0.0, 1e4), 5.0),
            EffectParameter(of_cable("grease_exponent", 0.3, 0.7), 0.5),
        ),
        starts=({"grease_drag": 5.0, "grease_exponent": 0.5},),
        required_excitation="speeds over two decades",
        confounded_with=(
            "viscous_friction", "load_independent_friction", "stribeck_friction",
        ),
        mujoco=PLUGIN_KEYS,
        source="Herschel and Bulkley, Kolloid-Zeitschrift 39, 1926",
        cables=on_all_cables("grease_drag", "grease_exponent"),
        generalises=("viscous_friction", "load_independent_friction"),
    ),
    Effect(
        id="stribeck_friction",
        title="Stribeck friction: more friction at low speed",
        equation="mu += mu_b exp(-x), exp(-x^2) or 1/(1 + x^2), x = |v|/v_b",
        where="conduit",
        parameters=(
            EffectParameter(of_cable("stribeck_friction", 0.0, 2.0), 0.05),
            EffectParameter(of_cable("stribeck_speed", 5e-4, 0.5), 0.02),
            EffectParameter(
                Parameter(
                    "stribeck_slip", "m", "slip over which Stribeck friction adapts",
                    1e-5, 0.02, scale="log",
                ),
                2e-4,
            ),
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
        confounded_with=("viscous_friction", "presliding", "dwell_dependent_stiction"),
        mujoco=PLUGIN_KEYS,
        source="Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30, 1994",
        cables=_stribeck,
        forms=tuple(_STRIBECK_FORMS),
    ),
    Effect(
        id="presliding",
        title="presliding: friction builds up over a distance",
        equation="f = clip(f + sigma du, capstan cone), sigma = mu theta T/z",
        where="conduit",
        parameters=(EffectParameter(of_cable("bristle_length", 0.0, 0.01), 1e-4),),
        starts=({"bristle_length": 5e-5}, {"bristle_length": 5e-4}),
        required_excitation="small reversals",
        confounded_with=("end_compliance", "backlash", "cable_stiffening"),
        mujoco=PLUGIN_KEYS,
        source="Dahl 1968; Palli and Melchiorri 2014; thesis (1.2)",
        cables=on_all_cables("bristle_length"),
    ),
    Effect(
        id="load_independent_friction",
        title="friction that needs no tension",
        equation="dT/dx += s f_0, and s F at the seal of either end",
        where="conduit",
        parameters=(
            EffectParameter(
                of_cable("load_independent_friction", 0.0, 1e4), 1.0,
                ordinary=_END_FRICTION_SHARE, ordinary_of="pretension per length",
            ),
            *(
                EffectParameter(
                    of_cable(name, 0.0, 1e4),
                    1.0,
                    ordinary=_END_FRICTION_SHARE,
                    ordinary_of="pretension",
                )
                for name in ("seal_proximal", "seal_distal")
            ),
        ),
        starts=(
            {
                "load_independent_friction": 1.0, "seal_proximal": 1.0,
                "seal_distal": 1.0,
            },
        ),
        required_excitation="two levels of load or pretension",
        confounded_with=("tension_dependent_friction",),
        mujoco=PLUGIN_KEYS,
        source="Palli and Melchiorri, Mechatronics 24, 2014",
        cables=on_all_cables(
            "load_independent_friction", "seal_proximal", "seal_distal",
        ),
    ),
    Effect(
        id="asymmetric_friction",
        title="friction that depends on the direction of motion",
        equation="mu (1 + s a)",
        where="conduit",
        parameters=(
            EffectParameter(
                of_cable("friction_asymmetry", -0.9, 0.9), 0.1, _ASYMMETRY_BOUNDS,
            ),
            EffectParameter(
                of_cable("friction_asymmetry", -0.9, 0.9, "asymmetry_antagonist"), 0.1,
                _ASYMMETRY_BOUNDS,
            ),
        ),
        starts=({"friction_asymmetry": 0.1, "asymmetry_antagonist": 0.1},),
        required_excitation="motion in both directions at several loads",
        confounded_with=("torque_sensor_offset",),
        mujoco=PLUGIN_KEYS,
        source="Duclusaud et al., arXiv 2410.08650 (directional friction)",
        cables=_asymmetric,
    ),
    Effect(
        id="tension_dependent_friction",
        title="friction coefficient that changes with tension",
        equation="mu (T/T0)^e",
        where="conduit",
        parameters=(EffectParameter(of_cable("tension_exponent", -1.0, 1.0), 0.1),),
        starts=({"tension_exponent": -0.1},),
        required_excitation="tension over a factor of 2",
        confounded_with=("load_independent_friction", "configuration_dependent_wrap"),
        mujoco=PLUGIN_KEYS,
        source="Jung, Pan, Kang, Tribology International 41, 2008",
        cables=_tension_dependent,
    ),
    Effect(
        id="dwell_dependent_stiction",
        title="break-away friction that grows with rest",
        equation="mu_s = mu + b ln(1 + t/t_a)",
        where="conduit",
        parameters=(
            EffectParameter(of_cable("ageing_friction", 0.0, 2.0), 0.05),
            EffectParameter(of_cable("critical_slip_distance", 1e-5, 0.02), 1e-3),
            EffectParameter(of_cable("ageing_time", 1e-3, 100.0), 1.0),
        ),
        starts=(
            {
                "ageing_friction": 0.02, "critical_slip_distance": 2e-4,
                "ageing_time": 0.05,
            },
            {
                "ageing_friction": 0.05, "critical_slip_distance": 3e-4,
                "ageing_time": 1.0,
            },
            {
                "ageing_friction": 0.05, "critical_slip_distance": 3e-3,
                "ageing_time": 1.0,
            },
        ),
        required_excitation="pauses of different length",
        confounded_with=("stribeck_friction",),
        mujoco=PLUGIN_KEYS,
        source="Dieterich, Pure Appl. Geophys. 116, 1978; Ruina, JGR 88, 1983",
        cables=on_all_cables(
            "ageing_friction", "critical_slip_distance", "ageing_time",
        ),
    ),
    Effect(
        id="friction_drift",
        title="friction that drifts during a trial",
        equation="mu (1 + d t + h W), W the heat of friction that is left",
        where="conduit",
        parameters=(
            EffectParameter(of_cable("friction_drift", -1.0, 1.0), 0.01),
            EffectParameter(of_cable("friction_heating", -10.0, 10.0), 0.02),
            EffectParameter(of_cable("cooling_time", 1.0, 1e3), 10.0),
        ),
        starts=(
            {"friction_drift": 0.01, "friction_heating": 0.02, "cooling_time": 10.0},
        ),
        required_excitation="trials much longer than a cycle",
        confounded_with=("pretension_loss",),
        mujoco=PLUGIN_KEYS,
        source="thesis 3.2.3",
        cables=on_all_cables("friction_drift", "friction_heating", "cooling_time"),
    ),
)  # fmt: skip
"""Those of the library, the plainest first."""
