"""Effects of a cable's path, its tension at rest, its elasticity and its ends."""

from __future__ import annotations

from cc_mujoco.cable import Cable
from cc_mujoco.diagnosis.effects._effect import (
    ANTAGONIST,
    PLUGIN_KEYS,
    Effect,
    EffectParameter,
    RigGeometry,
    Values,
    clamp_to_bounds,
    of_cable,
    on_all_cables,
    sized,
)

_LOOSE_END_SHARE = 0.03
"""Share of a cable that may lie straight in either end, where nothing holds it."""
_END_COMPLIANCE_BOUNDS = (0.0, 10.0)
"""Compliance of an end over that of the cable, beyond which it is a spring's."""
_MIN_LINEAR_SHARE = 0.1
"""Least share of the compliance at rest that is not bedding."""
_FITTING_COMPLIANCES = (
    "end_compliance",
    "end_compliance_antagonist",
    "proximal_compliance",
    "proximal_compliance_antagonist",
)
"""Compliances of where the cables are fastened, at the joint and at the motor."""


def _change_wrap(
    given: tuple[Cable, ...], values: Values, rig: RigGeometry
) -> tuple[Cable, ...]:
    # The distal end of the agonist moves by minus the joint's rim.
    growth = clamp_to_bounds("wrap_growth", values["wrap_per_angle"] / rig.joint_radius)
    signs = (-1.0, 1.0)
    return tuple(
        cable.replace(wrap_growth=sign * growth, wrap_reach=values["wrap_reach"])
        for cable, sign in zip(given, signs, strict=False)
    )


def _stiffening(
    given: tuple[Cable, ...], values: Values, _: RigGeometry
) -> tuple[Cable, ...]:
    # Strands bed in one by one, so two cables may differ. The baseline's
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
                axial_stiffness=clamp_to_bounds(
                    "axial_stiffness",
                    cable.axial_stiffness / max(1.0 - soft, _MIN_LINEAR_SHARE),
                ),
            )
        )
    return tuple(found)


def _set_end_compliances(
    given: tuple[Cable, ...], values: Values, _: RigGeometry
) -> tuple[Cable, ...]:
    # Ends are fastened one by one.
    each = zip(_FITTING_COMPLIANCES[0::2], _FITTING_COMPLIANCES[1::2], strict=True)
    distal, proximal = ([values.get(name, 0.0) for name in names] for names in each)
    return tuple(
        cable.replace(end_compliance=far, proximal_compliance=near)
        for cable, far, near in zip(given, distal, proximal, strict=False)
    )


CABLE_EFFECTS = (
    Effect(
        id="configuration_dependent_wrap",
        title="wrap that changes with the joint angle",
        equation="theta (1 + k q) in the last part of the conduit",
        where="conduit",
        parameters=(
            sized(
                "wrap_per_angle", "1/rad",
                "relative growth of the wrap angles per joint angle", -5.0, 5.0, 0.1,
            ),
            EffectParameter(of_cable("wrap_reach", 0.05, 1.0), 0.5),
        ),
        starts=(
            {"wrap_per_angle": 0.1, "wrap_reach": 0.9},
            {"wrap_per_angle": 0.3, "wrap_reach": 0.3},
        ),
        required_excitation="motion at different joint angles",
        confounded_with=(
            "joint_gravity", "pulley_eccentricity", "tension_dependent_friction",
        ),
        mujoco=PLUGIN_KEYS,
        source="thesis 2.4.3, Experiment 1b",
        cables=_change_wrap,
    ),
    Effect(
        id="pretension_loss",
        title="pretension that is lost during a trial",
        equation="T0 (1 - c (1 - exp(-t/t_c)))",
        where="conduit",
        parameters=(
            EffectParameter(of_cable("stress_relaxation", 0.0, 1.0), 0.1),
            EffectParameter(of_cable("relaxation_time", 0.5, 1e4), 10.0),
        ),
        starts=(
            {"stress_relaxation": 0.1, "relaxation_time": 2.0},
            {"stress_relaxation": 0.1, "relaxation_time": 20.0},
        ),
        required_excitation="trials much longer than a cycle",
        confounded_with=("friction_drift",),
        mujoco=PLUGIN_KEYS,
        source="standard linear solid",
        cables=on_all_cables("stress_relaxation", "relaxation_time"),
    ),
    Effect(
        id="cable_stiffening",
        title="cable that stiffens under tension",
        equation="strain += e T / (T + T_b), EA at T_0 as before",
        where="conduit",
        parameters=(
            EffectParameter(of_cable("bedding_strain", 0.0, 0.3), 5e-4),
            EffectParameter(
                of_cable("bedding_strain", 0.0, 0.3, "bedding_strain_antagonist"), 5e-4,
            ),
            EffectParameter(of_cable("bedding_tension", 1.0, 500.0), 20.0),
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
        mujoco=PLUGIN_KEYS,
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
                of_cable(name.removesuffix(f"_{ANTAGONIST}"), 0.0, 0.01, name),
                1e-5,
                _END_COMPLIANCE_BOUNDS,
                "cable",
                ordinary=2.0 * _LOOSE_END_SHARE,
                ordinary_of="cable",
            )
            for name in _FITTING_COMPLIANCES
        ),
        starts=(dict.fromkeys(_FITTING_COMPLIANCES, 1e-5),),
        required_excitation="reversals at several loads",
        confounded_with=("presliding", "backlash", "cable_stiffening"),
        mujoco=PLUGIN_KEYS,
        source="series springs",
        cables=_set_end_compliances,
    ),
)  # fmt: skip
"""Those of the library."""
