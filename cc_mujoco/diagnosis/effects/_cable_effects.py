"""Effects of a cable: friction in the conduit, path, tension, elasticity, ends."""

from typing import Any

from cc_mujoco.cable import Cable
from cc_mujoco.diagnosis.effects._effect import (
    ANTAGONIST,
    Cables,
    RigGeometry,
    Shape,
    Size,
    Values,
    clamp_to_bounds,
    form_key,
)

_FORMS = (1.0, 0.0), (2.0, 0.0), (2.0, 1.0)
"""Exponent and tail of the forms of Stribeck friction."""


def _stribeck(given: Cables, values: Values, _: RigGeometry) -> Cables:
    # A contact has one slip that renews it: with ageing, that of the ageing law.
    form = round(values.get(form_key("stribeck_friction"), 0.0))
    exponent, tail = _FORMS[form]
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

    def softened(cable: Cable, **more: float) -> Cable:
        pairs = ((name, getattr(cable, name) + size) for name, size in more.items())
        return cable.replace(**{name: clamp_to_bounds(name, s) for name, s in pairs})

    return tuple(
        softened(cable, end_compliance=far, proximal_compliance=near)
        for cable, far, near in zip(given, sizes[:2], sizes[2:], strict=False)
    )


ACTIONS: dict[str, dict[str, Any]] = {
    "stribeck_friction": {"cables": _stribeck},
    "asymmetric_friction": {"cables": _asymmetric},
    "tension_dependent_friction": {"cables": _tension_dependent},
    "configuration_dependent_wrap": {"cables": _change_wrap},
    "cable_stiffening": {"cables": _stiffening},
    "end_compliance": {"cables": _set_end_compliances},
}
"""Functions of `Effect` by its id; other effects set parameters of the cables."""


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
