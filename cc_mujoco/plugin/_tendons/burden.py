"""Survey of what acts on a tendon as a whole.

A `Burden` lists the actuators, features, equalities and sensors of a spatial tendon,
and the branches of its path between pulleys.
"""

import dataclasses
import math
from collections.abc import Collection
from typing import Any

import mujoco
import numpy as np

from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray
from cc_mujoco.plugin._engine import PLUGIN
from cc_mujoco.plugin._spec import add_element, cable_ends, pristine_fields

_GAIN, _BIAS, _DYN = mujoco.mjtGain, mujoco.mjtBias, mujoco.mjtDyn
_YIELDS = hasattr(mujoco.MjsTendon, "springyield")  # from MuJoCo 4.0
CARRIED = (
    "stiffness", "springlength", *["springyield"] * _YIELDS, "damping", "frictionloss",
    "solref_friction", "solimp_friction", "limited", "range", "margin", "solref_limit",
    "solimp_limit", "actfrclimited", "actfrcrange", "armature",
)  # fmt: skip
"""Fields of a tendon that act on it as a whole."""


@dataclasses.dataclass(frozen=True)
class TendonBranch:
    """Part of a tendon between two pulleys, or a whole tendon without pulleys."""

    name: str  # tendon that has the path of the branch alone, and its cable
    divisor: float  # number by which MuJoCo divides its length and its force
    # Sites and geoms by name, each with its side site: "" for a geom without one, None
    # for a site.
    path: tuple[tuple[str, str | None], ...]


@dataclasses.dataclass(frozen=True)
class Burden:
    """All that acts on a tendon as a whole."""

    tendon: str  # name of the tendon
    index: int  # its index in the model
    actuators: tuple[int, ...]  # indices in the specification of its actuators
    equalities: tuple[int, ...]  # indices of the equalities of its length
    sensors: tuple[int, ...]  # indices of the sensors of its limit and actuators' force
    spring: tuple[float, ...]  # stiffness [N/m], with its coefficients of higher order
    rest: tuple[float, float]  # lengths between which the spring has no force [m]
    branches: tuple[TendonBranch, ...]  # parts of its path
    length: float  # length of the tendon in the pose `qpos0` [m]
    fields: tuple[str, ...]  # names of its own features, as in MJCF

    @property
    def winch(self) -> str:
        return f"{self.tendon}_winch"

    @property
    def is_none(self) -> bool:
        parts = (self.actuators, self.equalities, self.sensors, self.fields)
        return not any(parts) and not self.has_pulleys

    @property
    def has_pulleys(self) -> bool:
        return self.branches[0].name != self.tendon

    @property
    def is_band(self) -> bool:
        """Return whether the tendon is an elastic band, taut in the pose `qpos0`."""
        others = self.actuators or self.equalities or self.sensors or self.has_pulleys
        return (
            not others
            and self.fields == ("stiffness",)
            and not any(self.spring[1:])
            and 0.0 < self.rest[1] <= self.length
        )

    @property
    def needs_winch(self) -> bool:
        return not self.is_none and not self.is_band


def find_burden(spec: mujoco.MjSpec, model: mujoco.MjModel, tendon: str) -> Burden:
    """Return the `Burden` of a spatial tendon: all that acts on it as a whole.

    Raise a `CableError` for a fixed tendon, or one that belongs to a cable already.
    """
    own, index = spec.tendon(tendon), model.tendon(tendon).id
    if model.wrap_type[model.tendon_adr[index]] == mujoco.mjtWrap.mjWRAP_JOINT:
        raise CableError(
            f"tendon {tendon!r} is fixed: it has no path that could bend; friction "
            "is for a spatial tendon of sites and geoms."
        )
    _refuse_second_cable(spec, tendon)
    features = {
        "stiffness": bool(np.any(own.stiffness)),
        "springyield": _YIELDS and np.any(own.stiffness) and own.springyield != 0.0,
        "damping": bool(np.any(own.damping)),
        "frictionloss": own.frictionloss != 0.0,
        "range": bool(model.tendon_limited[index]),
        "armature": own.armature != 0.0,
        "actuatorfrcrange": bool(model.tendon_actfrclimited[index]),
    }
    pulled = [_pulls(actuator, tendon) for actuator in spec.actuators]
    held = [
        e.type == mujoco.mjtEq.mjEQ_TENDON and tendon in (e.name1, e.name2)
        for e in spec.equalities
    ]
    # They read the winch instead of the tendon.
    moved = [
        getattr(mujoco.mjtSensor, f"mjSENS_TENDON{name}")
        for name in ("LIMITPOS", "LIMITVEL", "LIMITFRC", "ACTFRC")
    ]
    read = [s.type in moved and s.objname == tendon for s in spec.sensors]
    actuators, equalities, sensors = (
        tuple(np.flatnonzero(x).tolist()) for x in (pulled, held, read)
    )
    return Burden(
        tendon, index, actuators, equalities, sensors,
        tuple(float(x) for x in own.stiffness),
        tuple(model.tendon_lengthspring[index].tolist()), _branches(own),
        float(model.tendon_length0[index]),
        tuple(name for name, present in features.items() if present),
    )  # fmt: skip


def _refuse_second_cable(spec: mujoco.MjSpec, tendon: str) -> None:
    cables = {p.name: dict(p.config) for p in spec.plugins if p.plugin_name == PLUGIN}
    users = [name for name, config in cables.items() if config.get("route") == tendon]
    ends = [a for a in cable_ends(spec) if a.plugin.name in cables]
    users += [end.plugin.name for end in ends if _pulls(end, tendon)]
    if tendon in cables or spec.tendon(f"{tendon}_winch") is not None:
        raise CableError(f"tendon {tendon!r} is a cable already.")
    if users:
        raise CableError(
            f"tendon {tendon!r} belongs to cable {users[0]!r} already; give the second "
            "cable a tendon of its own, over the same sites if need be."
        )


def _pulls(actuator: Any, tendon: str) -> bool:
    on_tendon = actuator.trntype == mujoco.mjtTrn.mjTRN_TENDON
    return bool(on_tendon and actuator.target == tendon)


def _branches(tendon: Any) -> tuple[TendonBranch, ...]:
    parts: list[tuple[float, list[tuple[str, str | None]]]] = [(1.0, [])]
    for wrap in tendon.path:
        if wrap.type == mujoco.mjtWrap.mjWRAP_PULLEY:
            parts.append((float(wrap.divisor), []))
        elif wrap.type == mujoco.mjtWrap.mjWRAP_SITE:
            parts[-1][1].append((wrap.target.name, None))
        else:
            side = "" if wrap.sidesite is None else wrap.sidesite.name
            parts[-1][1].append((wrap.target.name, side))
    if len(parts) == 1:
        return (TendonBranch(tendon.name, 1.0, tuple(parts[0][1])),)
    full = [(divisor, tuple(path)) for divisor, path in parts if path]
    return tuple(
        TendonBranch(f"{tendon.name}_{i}", divisor, path)
        for i, (divisor, path) in enumerate(full, start=1)
    )


def write_branches(spec: mujoco.MjSpec, burden: Burden) -> None:
    if not burden.has_pulleys:
        return
    own = spec.tendon(burden.tendon)
    for branch in burden.branches:
        part = add_element(
            spec, "tendon", name=branch.name, width=own.width, rgba=own.rgba,
            group=own.group, material=own.material,
        )  # fmt: skip
        for target, side in branch.path:
            if side is None:
                part.wrap_site(target)
            else:
                part.wrap_geom(target, side)


def slacken(spec: mujoco.MjSpec, tendon: str) -> None:
    own, plain = spec.tendon(tendon), pristine_fields("tendon")
    for field in CARRIED:
        setattr(own, field, plain[field])


def can_push(original: mujoco.MjModel, burden: Burden) -> bool:
    return any(
        original.actuator_gaintype[i] != _GAIN.mjGAIN_MUSCLE for i in burden.actuators
    )


def kind_of(model: mujoco.MjModel, actuator: int) -> str:
    """Return the MJCF element ("motor", "position") that an actuator acts like."""
    gain, bias = model.actuator_gaintype[actuator], model.actuator_biastype[actuator]
    if model.actuator_plugin[actuator] >= 0:
        return "plugin"
    for kind in ("muscle", "dcmotor", "pid"):
        if gain == getattr(_GAIN, f"mjGAIN_{kind.upper()}"):
            return kind
    dynamics = model.actuator_dyntype[actuator]
    own, law = model.actuator_gainprm[actuator], model.actuator_biasprm[actuator]
    if gain != _GAIN.mjGAIN_FIXED:
        damper = bias == _BIAS.mjBIAS_NONE and dynamics == _DYN.mjDYN_NONE
        damper = damper and own[0] == own[1] == 0.0
        return "damper" if damper else "general"
    if bias == _BIAS.mjBIAS_NONE:
        return "motor" if dynamics == _DYN.mjDYN_NONE else "general"
    if bias == _BIAS.mjBIAS_AFFINE and law[0] == 0.0:
        if law[1] == -own[0]:
            integrated = dynamics == _DYN.mjDYN_INTEGRATOR
            return "intvelocity" if integrated else "position"
        if law[1] == 0.0 and law[2] == -own[0]:
            return "velocity"
    return "general"


def keep_constraints(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    original: mujoco.MjModel,
    burdens: Collection[Burden],
) -> None:
    """Make limits, dry friction and equalities of winches as stiff as the tendons'.

    MuJoCo scales the regularisation of a constraint by the inverse of the inertia that
    it moves, and a winch has little inertia. A constraint also resists like an inertia,
    to which the speed of a light winch would give momentum. So limits and dry friction
    get the parameters of a spring and a dashpot that stop a winch within a step.
    """
    tendon_of = {burden.winch: burden.tendon for burden in burdens}
    step, equalities = original.opt.timestep, set[int]()
    for burden in burdens:
        before = _inverse_weight(original, burden.tendon)
        after = _inverse_weight(model, burden.winch)
        if not (before > 0.0 and after > 0.0):
            continue
        equalities.update(burden.equalities)
        winch, index = spec.tendon(burden.winch), burden.index
        limit = original.tendon_solimp_lim[index], original.tendon_solref_lim[index]
        stiffness, _ = _as_spring(*limit, before, step)
        # A stop that the elastic cable does not bounce from.
        drag = max(2.0 * math.sqrt(stiffness / before), 2.0 * stiffness * step)
        winch.solimp_limit, winch.solref_limit = _as_constraint(
            stiffness, drag, after, step
        )
        dry = original.tendon_solimp_fri[index], original.tendon_solref_fri[index]
        winch.solimp_friction, winch.solref_friction = _as_constraint(
            *_as_spring(*dry, before, step), after, step
        )
    for place in equalities:
        equality = spec.equalities[place]
        pair = [name for name in (equality.name1, equality.name2) if name]
        old = sum(_inverse_weight(original, tendon_of.get(name, name)) for name in pair)
        new = sum(_inverse_weight(model, name) for name in pair)
        _rescale(equality, old / max(new, mujoco.mjMINVAL))


def _inverse_weight(model: mujoco.MjModel, tendon: str) -> float:
    return float(model.tendon_invweight0[model.tendon(tendon).id])


def _as_spring(
    solimp: FloatArray, solref: FloatArray, inverse: float, step: float
) -> tuple[float, float]:
    """Return stiffness [N/m] and damping [N s/m] of a constraint by its `solref`.

    `inverse` [1/kg] is that of the inertia that it moves, `step` the time step [s].
    """
    most = float(np.clip(solimp[1], mujoco.mjMINIMP, mujoco.mjMAXIMP))
    weight = most / ((1.0 - most) * inverse)
    if solref[0] > 0.0:
        time = max(float(solref[0]), 2.0 * step)
        rate = 1.0 / (most * time * float(solref[1])) ** 2
        return weight * rate * most, weight * 2.0 / (most * time)
    return -weight * float(solref[0]) / most, -weight * float(solref[1]) / most


def _as_constraint(
    stiffness: float, damping: float, inverse: float, step: float
) -> tuple[list[float], list[float]]:
    """Return `solimp` and `solref` of a stiffness and damping, as in `_as_spring`."""
    weight = damping * step
    impedance = min(weight * inverse / (1.0 + weight * inverse), mujoco.mjMAXIMP)
    weight = impedance / ((1.0 - impedance) * inverse)
    rate = min(stiffness / weight, 0.5 / step**2)
    solimp = [impedance, impedance, 1e-3, 0.5, 2.0]
    return solimp, [-rate * impedance, -impedance / step]


def _rescale(equality: Any, ratio: float) -> None:
    """Change `solimp` of an equality so that its regularisation stays what it was.

    `ratio` is the inverse inertia that it moved before, over the present one.
    """
    if not ratio > 0.0:
        return
    solimp = np.array(equality.solimp)
    limits = (mujoco.mjMINIMP, mujoco.mjMAXIMP)
    old = np.clip(solimp[:2], *limits)
    solimp[:2] = np.clip(1.0 / (1.0 + (1.0 / old - 1.0) * ratio), *limits)
    equality.solimp = solimp
    solref = np.array(equality.solref)
    if solref[0] > 0.0:
        # Its time constant is in units of the impedance.
        solref[0] *= old[1] / solimp[1]
        equality.solref = solref


def held_tension(original: mujoco.MjModel, burden: Burden) -> float:
    """Return the tension that the dry friction of a tendon holds in `qpos0` [N].

    It is 0 if friction would have to push, or if the tendon has pulleys.
    """
    if "frictionloss" not in burden.fields or burden.has_pulleys:
        return 0.0
    data = mujoco.MjData(original)
    mujoco.mj_forward(original, data)
    own = (data.efc_type == mujoco.mjtConstraint.mjCNSTR_FRICTION_TENDON) & (
        data.efc_id == burden.index
    )
    return max(-float(np.sum(data.efc_force[own])), 0.0)
