"""Effects of a cable: friction in the conduit, path, tension, elasticity, ends."""

from cc_mujoco.cable._parameter import Parameter
from cc_mujoco.diagnosis.effects._effect import (
    ANTAGONIST,
    Cables,
    Effect,
    EffectParameter,
    RigGeometry,
    Shape,
    Size,
    Values,
    clamp_to_bounds,
    form_key,
    of_cable,
    sized,
)

_FORMS = {"exponential": (1.0, 0.0), "Gaussian": (2.0, 0.0), "Lorentzian": (2.0, 1.0)}
"""Exponent and tail of the forms of Stribeck friction."""
_END_FRICTION_SHARE = 0.015
"""Friction of uneven bends and ends over the pretension."""


def _stribeck(given: Cables, values: Values, _: RigGeometry) -> Cables:
    # A contact has one slip that renews it: with ageing, that of the ageing law.
    form = round(values.get(form_key("stribeck_friction"), 0.0))
    exponent, tail = tuple(_FORMS.values())[form]
    own = {name: values[name] for name in ("stribeck_friction", "stribeck_speed")}
    own |= {"stribeck_exponent": exponent, "stribeck_tail": tail}
    fresh = {**own, "critical_slip_distance": values["stribeck_slip"]}
    return tuple(c.replace(**own if c.ageing_friction > 0.0 else fresh) for c in given)


def _asymmetric(given: Cables, values: Values, _: RigGeometry) -> Cables:
    # Liners wear one by one; the antagonist moves the other way.
    each = (values["friction_asymmetry"], -values["asymmetry_antagonist"])
    pairs = zip(given, each, strict=False)
    return tuple(cable.replace(friction_asymmetry=size) for cable, size in pairs)


def _tension_dependent(given: Cables, values: Values, _: RigGeometry) -> Cables:
    # A cable refers to its own pretension, which may be that of one trial; the
    # baseline's friction stays that of a cable in the scene's.
    usual = max(values.get("pretension", given[0].pretension), 1e-9)
    exponent = values["tension_exponent"]
    made = list(given)
    for k, cable in enumerate(given):
        if cable.pretension > 0.0:
            friction = cable.friction * (cable.pretension / usual) ** exponent
            friction = clamp_to_bounds("friction", friction)
            made[k] = cable.replace(tension_exponent=exponent, friction=friction)
    return tuple(made)


FRICTION_EFFECTS = (
    Effect(
        id="viscous_friction",
        title="viscous friction in the conduit",
        equation="dT/dx += c v",
        parameters=(of_cable("viscous_friction", 0.0, 1e5, 50.0),),
        required_excitation="speeds over a decade",
        confounded_with=("sensor_delay", "stribeck_friction"),
        source="thesis 2.4.4, Fig. 2.13",
    ),
    Effect(
        id="grease_drag",
        title="drag of a grease that thins as it is sheared",
        equation="dT/dx += s g |v|^n",
        parameters=(
            of_cable("grease_drag", 0.0, 1e4, 5.0),
            of_cable("grease_exponent", 0.3, 0.7, 0.5),
        ),
        required_excitation="speeds over two decades",
        confounded_with=(
            "viscous_friction", "load_independent_friction", "stribeck_friction",
        ),
        source="Herschel and Bulkley, Kolloid-Zeitschrift 39, 1926",
        generalises=("viscous_friction", "load_independent_friction"),
    ),
    Effect(
        id="stribeck_friction",
        title="Stribeck friction: more friction at low speed",
        equation="mu += mu_b exp(-x), exp(-x^2) or 1/(1 + x^2), x = |v|/v_b",
        parameters=(
            of_cable("stribeck_friction", 0.0, 2.0, 0.05),
            of_cable("stribeck_speed", 5e-4, 0.5, 0.02),
            EffectParameter(
                Parameter(
                    "stribeck_slip", "m", "slip over which Stribeck friction adapts",
                    1e-5, 0.02, scale="log",
                ),
                2e-4,
            ),
        ),
        starts=tuple({"stribeck_speed": speed} for speed in (0.003, 0.01, 0.04)),
        required_excitation="slow motion and reversals",
        confounded_with=("viscous_friction", "presliding", "dwell_dependent_stiction"),
        source="Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30, 1994",
        cables=_stribeck,
        forms=tuple(_FORMS),
    ),
    Effect(
        id="presliding",
        title="presliding: friction builds up over a distance",
        equation="f = clip(f + sigma du, capstan cone), sigma = mu theta T/z",
        parameters=(of_cable("bristle_length", 0.0, 0.01, 1e-4),),
        starts=({"bristle_length": 5e-5}, {"bristle_length": 5e-4}),
        required_excitation="small reversals",
        confounded_with=("end_compliance", "backlash", "cable_stiffening"),
        source="Dahl 1968; Palli and Melchiorri 2014; thesis (1.2)",
    ),
    Effect(
        id="load_independent_friction",
        title="friction that needs no tension",
        equation="dT/dx += s f_0, and s F at the seal of either end",
        parameters=(
            of_cable(
                "load_independent_friction", 0.0, 1e4, 1.0,
                ordinary=_END_FRICTION_SHARE, ordinary_of="pretension per length",
            ),
            *(
                of_cable(
                    name, 0.0, 1e4, 1.0,
                    ordinary=_END_FRICTION_SHARE, ordinary_of="pretension",
                )
                for name in ("seal_proximal", "seal_distal")
            ),
        ),
        required_excitation="two levels of load or pretension",
        confounded_with=("tension_dependent_friction",),
        source="Palli and Melchiorri, Mechatronics 24, 2014",
    ),
    Effect(
        id="asymmetric_friction",
        title="friction that depends on the direction of motion",
        equation="mu (1 + s a)",
        parameters=tuple(
            of_cable(
                "friction_asymmetry", -0.9, 0.9, 0.1, name, plausible=(-0.5, 0.5),
            )
            for name in ("friction_asymmetry", "asymmetry_antagonist")
        ),
        required_excitation="motion in both directions at several loads",
        confounded_with=("torque_sensor_offset",),
        source="Duclusaud et al., arXiv 2410.08650 (directional friction)",
        cables=_asymmetric,
    ),
    Effect(
        id="tension_dependent_friction",
        title="friction or wrap that changes with tension",
        equation="mu theta (T/T0)^e",
        parameters=(of_cable("tension_exponent", -1.0, 1.0, 0.1),),
        starts=({"tension_exponent": -0.1},),
        required_excitation="tension over a factor of 2",
        confounded_with=("load_independent_friction", "configuration_dependent_wrap"),
        source="Jung, Pan, Kang, Tribology International 41, 2008",
        cables=_tension_dependent,
    ),
    Effect(
        id="dwell_dependent_stiction",
        title="break-away friction that grows with rest",
        equation="mu_s = mu + b ln(1 + t/t_a)",
        parameters=(
            of_cable("ageing_friction", 0.0, 2.0, 0.05),
            of_cable("critical_slip_distance", 1e-5, 0.02, 1e-3),
            of_cable("ageing_time", 1e-3, 100.0, 1.0),
        ),
        starts=tuple(
            {"ageing_friction": size, "critical_slip_distance": slip, "ageing_time": at}
            for size, slip, at in (
                (0.02, 2e-4, 0.05), (0.05, 3e-4, 1.0), (0.05, 3e-3, 1.0),
            )
        ),
        required_excitation="pauses of different length",
        confounded_with=("stribeck_friction",),
        source="Dieterich, Pure Appl. Geophys. 116, 1978; Ruina, JGR 88, 1983",
    ),
    Effect(
        id="friction_drift",
        title="friction that drifts during a trial",
        equation="mu (1 + d t + h W), W the heat of friction that is left",
        parameters=(
            of_cable("friction_drift", -1.0, 1.0, 0.01),
            of_cable("friction_heating", -10.0, 10.0, 0.02),
            of_cable("cooling_time", 1.0, 1e3, 10.0),
        ),
        required_excitation="trials much longer than a cycle",
        confounded_with=("pretension_loss",),
        source="thesis 3.2.3",
    ),
)  # fmt: skip
"""Effects of the friction of a cable, the plainest first."""

_FITTING_COMPLIANCES = (
    *("end_compliance", "end_compliance_antagonist"),
    *("proximal_compliance", "proximal_compliance_antagonist"),
)
"""Compliances of the cables' fasteners, at the joint and at the motor."""


def _change_wrap(given: Cables, values: Values, rig: RigGeometry) -> Cables:
    # The distal end of the agonist moves by minus the joint's rim.
    growth = clamp_to_bounds("wrap_growth", values["wrap_per_angle"] / rig.joint_radius)
    signs = (-1.0, 1.0)
    reach, pairs = values["wrap_reach"], zip(given, signs, strict=False)
    return tuple(c.replace(wrap_growth=s * growth, wrap_reach=reach) for c, s in pairs)


def _stiffening(given: Cables, values: Values, _: RigGeometry) -> Cables:
    # Strands bed in one by one, so two cables may differ. The baseline's
    # stiffness stays that of a cable in the scene's pretension, as far as it can.
    usual = values.get("pretension", given[0].pretension)
    half = values["bedding_tension"]
    each = (values["bedding_strain"], values["bedding_strain_antagonist"])
    found = []
    for cable, strain in zip(given, each, strict=False):
        soft = cable.axial_stiffness * strain * half / (usual + half) ** 2
        # A tenth of the compliance at rest, or more, is not bedding.
        stiff = cable.axial_stiffness / max(1.0 - soft, 0.1)
        stiff = clamp_to_bounds("axial_stiffness", stiff)
        bedding = {"bedding_strain": strain, "bedding_tension": half}
        found.append(cable.replace(axial_stiffness=stiff, **bedding))
    return tuple(found)


def _set_end_compliances(given: Cables, values: Values, _: RigGeometry) -> Cables:
    # Ends are fastened one by one, and give more than the scene says.
    sizes = [values.get(name, 0.0) for name in _FITTING_COMPLIANCES]
    return tuple(
        cable.replace(
            end_compliance=cable.end_compliance + far,
            proximal_compliance=cable.proximal_compliance + near,
        )
        for cable, far, near in zip(given, sizes[:2], sizes[2:], strict=False)
    )


CABLE_EFFECTS = (
    Effect(
        id="configuration_dependent_wrap",
        title="wrap that changes with the joint angle",
        equation="theta (1 + k q) in the last part of the conduit",
        parameters=(
            sized(
                "wrap_per_angle", "1/rad",
                "relative growth of the wrap angles per joint angle", -5.0, 5.0, 0.1,
            ),
            of_cable("wrap_reach", 0.05, 1.0, 0.5),
        ),
        starts=(
            {"wrap_per_angle": 0.1, "wrap_reach": 0.9},
            {"wrap_per_angle": 0.3, "wrap_reach": 0.3},
        ),
        required_excitation="motion at different joint angles",
        confounded_with=(
            "joint_gravity", "pulley_eccentricity", "tension_dependent_friction",
        ),
        source="thesis 2.4.3, Experiment 1b",
        cables=_change_wrap,
    ),
    Effect(
        id="pretension_loss",
        title="pretension that is lost during a trial",
        equation="T0 (1 - c (1 - exp(-t/t_c)))",
        parameters=(
            of_cable("stress_relaxation", 0.0, 1.0, 0.1),
            of_cable("relaxation_time", 0.5, 1e4, 10.0),
        ),
        starts=({"relaxation_time": 2.0}, {"relaxation_time": 20.0}),
        required_excitation="trials much longer than a cycle",
        confounded_with=("friction_drift",),
        source="standard linear solid",
    ),
    Effect(
        id="cable_stiffening",
        title="cable that stiffens under tension",
        equation="strain += e T / (T + T_b), EA at T_0 as before",
        parameters=(
            of_cable("bedding_strain", 0.0, 0.3, 5e-4),
            of_cable("bedding_strain", 0.0, 0.3, 5e-4, "bedding_strain_antagonist"),
            of_cable("bedding_tension", 1.0, 500.0, 20.0),
        ),
        starts=({"bedding_tension": 10.0}, {"bedding_tension": 60.0}),
        required_excitation="large and small loads, slack, or two pretensions",
        confounded_with=("end_compliance", "presliding"),
        source="constructional stretch of ropes, as their makers give it",
        cables=_stiffening,
    ),
    Effect(
        id="end_compliance",
        title="compliance of an end fitting",
        equation="u_d += C T_d, u_p -= C T_p",
        parameters=tuple(
            of_cable(
                name.removesuffix(f"_{ANTAGONIST}"), 0.0, 0.01, 1e-5, name,
                plausible=(0.0, 10.0), of="cable",  # beyond, it is a spring's
                # 3 % of the cable are straight at either end, where nothing holds it
                ordinary=0.06, ordinary_of="cable",
            )
            for name in _FITTING_COMPLIANCES
        ),
        required_excitation="reversals at several loads",
        confounded_with=("presliding", "backlash", "cable_stiffening"),
        source="series springs",
        cables=_set_end_compliances,
    ),
)  # fmt: skip
"""Effects of the path, tension, elasticity and ends of a cable."""


class ClampCreep:
    """Conduit that slides in its clamps under large tension, and stays there."""

    equation = (
        "ds/dt = c max(T - F, 0), the path shorter by s; s = 0 at a trial's start"
    )
    source = "plastic flow above a yield force, Bingham 1922"
    where = "conduit"
    needs = (
        "trials that begin without load, with loads that grow, and smaller ones later"
    )
    confused_with = ("pretension_loss", "cable_stiffening", "end_compliance")

    def parameters(self) -> list[Size | Shape]:
        sizes: list[Size | Shape] = [
            Size(f"{name}{one}", "m/(N s)", 1e-5, f"{meaning}{of}", 0.0, 1e-2)
            for name, meaning in (
                ("clamp_creep_distal", "creep of the clamp at the joint"),
                ("clamp_creep_proximal", "creep of the clamp at the motor"),
            )
            for one, of in (("", ""), (f"_{ANTAGONIST}", ", antagonist"))
        ]
        forces = [round(10.0 * 1.35**k, 1) for k in range(12)]
        held = "force up to which a clamp holds"
        return [*sizes, Shape("clamp_force", "N", forces, 1.0, 1e4, held)]

    def cables(self, cables: Cables, values: Values, rig: RigGeometry) -> Cables:
        ends, made = ("clamp_creep_distal", "clamp_creep_proximal"), []
        for cable, one in zip(cables, ("", f"_{ANTAGONIST}"), strict=False):
            sizes = {name: values.get(f"{name}{one}", 0.0) for name in ends}
            sizes["clamp_force"] = values["clamp_force"]
            made.append(cable.replace(**sizes))
        return tuple(made)


class SoftAnchor:
    """Textile or skin that holds the cables' ends at the joint, with hysteresis."""

    equation = "u_d += C ln(1 + h T_d) / h, less of it on the way back"
    source = "Fung, Am. J. Physiol. 213, 1967; Yandell et al., JNER 14:40, 2017"
    where = "conduit"
    needs = (
        "slow loads up to the largest and back to none, several sizes: the loop grows "
        "with the load and not with the speed, and stays with the motor clamped"
    )
    confused_with = ("end_compliance", "cable_stiffening", "presliding")
    generalises = ("end_compliance",)

    def parameters(self) -> list[Size | Shape]:
        given = "compliance of the anchor at the joint, slack"
        stiffer, lost = "its hardening with the load", "share of work that it keeps"
        return [
            Size("anchor_compliance", "m/N", 1e-5, given, 0.0, 0.01),
            Shape("anchor_hardening", "1/N", [3e-3, 0.03], 1e-4, 1.0, stiffer),
            Shape("anchor_loss", "1", [0.1, 0.3], 0.0, 0.6, lost),
        ]

    def cables(self, cables: Cables, values: Values, rig: RigGeometry) -> Cables:
        size = values["anchor_compliance"]
        if size == 0.0:
            return cables
        spring = {
            "end_hardening": values["anchor_hardening"],
            "end_loss": values["anchor_loss"],
        }
        return tuple(
            cable.replace(end_compliance=cable.end_compliance + size, **spring)
            for cable in cables
        )


def _with_friction(cables: Cables, change: float) -> Cables:
    factor = min(max(1.0 + change, 0.0), 10.0)  # between trials of other conditions
    sizes = [clamp_to_bounds("friction", factor * cable.friction) for cable in cables]
    pairs = zip(cables, sizes, strict=True)
    return tuple(cable.replace(friction=size) for cable, size in pairs)


class FrictionByOrder:
    """Friction that changes from trial to trial."""

    equation = "mu (1 + d n), n the order of the trial from the middle one"
    source = "running in and wear of liners"
    needs = "like trials at the beginning and the end of a session"
    confused_with = ("friction_drift",)

    def parameters(self) -> list[Size | Shape]:
        meaning = "relative change of friction per trial"
        return [Size("friction_per_trial", "1", 0.02, meaning, -1.0, 1.0)]

    def cables(self, cables: Cables, values: Values, rig: RigGeometry) -> Cables:
        change = values["friction_per_trial"] * rig.conditions.order
        return _with_friction(cables, change) if change else cables


class FrictionByTemperature:
    """Friction that changes with the temperature."""

    equation = "mu (1 + c (T - T_mean))"
    source = "greases and polymer liners"
    columns = ("temperature_c",)
    needs = "like trials at two temperatures, declared or in a column temperature_c"
    confused_with = ("friction_drift", "friction_by_order")

    def parameters(self) -> list[Size | Shape]:
        meaning = "relative change of friction per degree"
        return [Size("friction_per_kelvin", "1/K", 0.01, meaning, -1.0, 1.0)]

    def cables(self, cables: Cables, values: Values, rig: RigGeometry) -> Cables:
        share = values["friction_per_kelvin"]
        change = share * rig.conditions.temperature
        if change:
            cables = _with_friction(cables, change)
        if rate := share * rig.conditions.warming / max(1.0 + change, 0.1):
            name = "friction_drift"
            drifts = [clamp_to_bounds(name, c.friction_drift + rate) for c in cables]
            pairs = zip(cables, drifts, strict=True)
            cables = tuple(c.replace(friction_drift=drift) for c, drift in pairs)
        return cables
