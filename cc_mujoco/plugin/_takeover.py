"""Transfer of what acts on a whole tendon to the end of a cable.

A tendon of MuJoCo has one force along its whole length, F, and feels it everywhere. A
cable with friction has a tension for every piece, so nothing can act on it as a whole:
what did so must act at its first site. There a *winch* holds the proximal end: a joint
`s`, by default a light slide, that is the length of tendon paid out, and a fixed tendon
`<tendon>_winch` of the length s, on which everything moves that acted on the tendon
itself: actuators, spring, damper, dry friction, limit, armature, equalities. Without
friction and stretch s is the length of the tendon, so that commands in metres and in
newtons mean what they did:

    virtual work   F ds = F dL,   the tension is -F.

The branches of a tendon with `<pulley>` have a winch each and the fixed tendon adds
them up, s = sum s_b / divisor_b: their tensions are -F / divisor_b, as MuJoCo has it.

A band, a tendon with nothing but a linear spring that is taut in the pose `qpos0`,
needs no winch: the cable itself has this stiffness, EA = k times the rest length.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco.errors import CableError
from cc_mujoco.plugin._engine import PLUGIN
from cc_mujoco.plugin._spec import add_element, compile_spec, pristine_fields

_TENDON = mujoco.mjtTrn.mjTRN_TENDON
_HINGE, _SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
_GAIN, _BIAS, _DYN = mujoco.mjtGain, mujoco.mjtBias, mujoco.mjtDyn
_SENSOR = mujoco.mjtSensor
_MOVED_SENSORS = (
    _SENSOR.mjSENS_TENDONLIMITPOS,
    _SENSOR.mjSENS_TENDONLIMITVEL,
    _SENSOR.mjSENS_TENDONLIMITFRC,
    _SENSOR.mjSENS_TENDONACTFRC,
)
_CARRIED = (
    "stiffness", "springlength", "springyield", "damping", "frictionloss",
    "solref_friction", "solimp_friction", "limited", "range", "margin", "solref_limit",
    "solimp_limit", "actfrclimited", "actfrcrange", "armature",
)  # fmt: skip
"""Fields of a tendon that act on it as a whole."""
_MASS_SHARE, _HELD_MASS_SHARE, _DRY_MASS_SHARE = 5e-3, 5e-2, 0.1
"""Inertia of a winch, as a share of what its tendon moves; where limits or equalities
hold it, or dry friction does, more, because a cable feels a change of theirs a step
late, and a light winch would tremble."""
_SLOWING_RATE = 0.05
"""Rate at which the damping of a winch slows down what its tendon moves [1/s].

It stops a winch that nothing pulls: without it the winch would pay out for ever what a
falling load once drew.
"""
_DRAG_MARGIN, _MUSCLE_MARGIN = 1.0, 0.6
"""Inertia of a winch that bears an explicit drag c at a step h, as a share of c h."""
_ANY_FORCE = 1e12
_ENDS = ("proximal", "distal")
_POSES = 12


@dataclasses.dataclass(frozen=True)
class TendonTakeover:
    """Account of a tendon that became a cable; its text is one line for each change.

    Attributes:
        cables: names of the cables, one, or one for every branch behind a `<pulley>`.
        winch: fixed tendon that carries what acted on the tendon as a whole, or empty.
        lines: what became of everything that the tendon had.
    """

    cables: tuple[str, ...]
    winch: str
    lines: tuple[str, ...]

    def __str__(self) -> str:
        """Return the lines."""
        return "\n".join(self.lines)


@dataclasses.dataclass(frozen=True)
class TendonBranch:
    """Part of a tendon between two of its pulleys, or all of it.

    Attributes:
        name: tendon that has the path of the branch alone, and its cable.
        divisor: number by which MuJoCo divides its length and its force.
        path: sites, and geoms with their side sites, by name.
    """

    name: str
    divisor: float
    path: tuple[tuple[str, str], ...]


@dataclasses.dataclass(frozen=True)
class Burden:
    """All that acts on a tendon as a whole.

    Attributes:
        tendon: name of the tendon.
        actuators: places in the specification of those that pull it.
        equalities: the same of the equalities of its length.
        sensors: the same of the sensors of its limit and of its actuators' force.
        spring: stiffness [N/m], with its coefficients of higher order.
        rest: lengths between which the spring has no force [m].
        branches: parts of its path.
        length: of the tendon in the pose `qpos0` [m].
        fields: names of its own features, as in MJCF.
    """

    tendon: str
    actuators: tuple[int, ...]
    equalities: tuple[int, ...]
    sensors: tuple[int, ...]
    spring: tuple[float, ...]
    rest: tuple[float, float]
    branches: tuple[TendonBranch, ...]
    length: float
    fields: tuple[str, ...]

    @property
    def winch(self) -> str:
        """Return the name of what takes over."""
        return f"{self.tendon}_winch"

    @property
    def is_none(self) -> bool:
        """Return whether nothing acts on the tendon as a whole."""
        parts = (self.actuators, self.equalities, self.sensors, self.fields)
        return not any(parts) and not self.has_pulleys

    @property
    def has_pulleys(self) -> bool:
        """Return whether the path has branches."""
        return self.branches[0].name != self.tendon

    @property
    def is_band(self) -> bool:
        """Return whether it is an elastic band that is taut in the pose `qpos0`."""
        others = self.actuators or self.equalities or self.sensors or self.has_pulleys
        return (
            not others
            and self.fields == ("stiffness",)
            and not any(self.spring[1:])
            and 0.0 < self.rest[1] <= self.length
        )


def find_burden(spec: mujoco.MjSpec, model: mujoco.MjModel, tendon: str) -> Burden:
    """Return what acts on a spatial tendon as a whole.

    Args:
        spec: the specification.
        model: the same, compiled.
        tendon: name of the tendon.

    Raises:
        CableError: the tendon belongs to a cable already, or an equality couples it
            to itself.
    """
    own = spec.tendon(tendon)
    _refuse_second_cable(spec, tendon)
    index = model.tendon(tendon).id
    features = {
        "stiffness": bool(np.any(own.stiffness)),
        "damping": bool(np.any(own.damping)),
        "frictionloss": own.frictionloss != 0.0,
        "range": bool(model.tendon_limited[index]),
        "armature": own.armature != 0.0,
        "actuatorfrcrange": bool(model.tendon_actfrclimited[index]),
    }
    equalities = tuple(
        i
        for i, equality in enumerate(spec.equalities)
        if equality.type == mujoco.mjtEq.mjEQ_TENDON
        and tendon in (equality.name1, equality.name2)
    )
    return Burden(
        tendon,
        tuple(
            i
            for i, actuator in enumerate(spec.actuators)
            if actuator.trntype == _TENDON and actuator.target == tendon
        ),
        equalities,
        tuple(
            i
            for i, sensor in enumerate(spec.sensors)
            if sensor.type in _MOVED_SENSORS and sensor.objname == tendon
        ),
        tuple(float(x) for x in own.stiffness),
        (
            float(model.tendon_lengthspring[index, 0]),
            float(model.tendon_lengthspring[index, 1]),
        ),
        _branches(own),
        float(model.tendon_length0[index]),
        tuple(name for name, present in features.items() if present),
    )


def _refuse_second_cable(spec: mujoco.MjSpec, tendon: str) -> None:
    cables = {p.name: dict(p.config) for p in spec.plugins if p.plugin_name == PLUGIN}
    users = [name for name, config in cables.items() if config.get("route") == tendon]
    users += [
        a.plugin.name
        for a in spec.actuators
        if a.plugin.name in cables and a.trntype == _TENDON and a.target == tendon
    ]
    if tendon in cables or spec.tendon(f"{tendon}_winch") is not None:
        raise CableError(f"tendon {tendon!r} is a cable already.")
    if users:
        raise CableError(
            f"tendon {tendon!r} belongs to cable {users[0]!r} already; give the second "
            "cable a tendon of its own, over the same sites if need be."
        )


def _branches(tendon: Any) -> tuple[TendonBranch, ...]:
    """Return the branches of a spatial tendon."""
    parts: list[tuple[float, list[tuple[str, str]]]] = [(1.0, [])]
    pulleys = 0
    for wrap in tendon.path:
        if wrap.type == mujoco.mjtWrap.mjWRAP_PULLEY:
            pulleys += 1
            parts.append((float(wrap.divisor), []))
        else:
            kind = "site" if wrap.type == mujoco.mjtWrap.mjWRAP_SITE else "geom"
            side = "" if kind == "site" or wrap.sidesite is None else wrap.sidesite.name
            parts[-1][1].append((wrap.target.name, f"{kind} {side}"))
    found = [(divisor, tuple(path)) for divisor, path in parts if path]
    if not pulleys:
        return (TendonBranch(tendon.name, 1.0, found[0][1]),)
    return tuple(
        TendonBranch(f"{tendon.name}_{i}", divisor, path)
        for i, (divisor, path) in enumerate(found, start=1)
    )


def write_branches(spec: mujoco.MjSpec, burden: Burden) -> None:
    """Write a tendon for every branch of a tendon with pulleys."""
    if not burden.has_pulleys:
        return
    own = spec.tendon(burden.tendon)
    for branch in burden.branches:
        part = add_element(
            spec, "tendon", name=branch.name, width=own.width, rgba=own.rgba,
            group=own.group, material=own.material,
        )  # fmt: skip
        for target, how in branch.path:
            kind, side = how.split(" ", 1)
            if kind == "site":
                part.wrap_site(target)
            else:
                part.wrap_geom(target, side)


@dataclasses.dataclass(frozen=True)
class Winch:
    """Joints that hold the proximal ends of the branches of a tendon.

    Attributes:
        names: of the joints, one for every branch.
        radius: of the drum [m]; 0 for a slide.
        lengths: of the branches in the pose `qpos0` [m].
        inertias: of the joints, at the tendon [kg].
        damping: of the joints, at the tendon [N s/m].
    """

    names: tuple[str, ...]
    radius: float
    lengths: tuple[float, ...]
    inertias: tuple[float, ...]
    damping: tuple[float, ...]

    @property
    def lever(self) -> float:
        """Return the length of tendon by unit of joint: 1, or the radius [m]."""
        return self.radius or 1.0


@dataclasses.dataclass(frozen=True)
class Stance:
    """A pose in which a tendon was measured: length [m], inertia that it moves [kg]."""

    length: float
    inertia: float


def measure(model: mujoco.MjModel, tendon: str) -> list[Stance]:
    """Measure a tendon in the pose `qpos0`, in keyframes and over the joints' ranges.

    Returns:
        The stances, that of `qpos0` first; without inertia where nothing moves it.
    """
    data = mujoco.MjData(model)
    index = model.tendon(tendon).id
    found = []
    row, solved = np.zeros(model.nv), np.zeros((1, model.nv))
    for pose in sample_poses(model):
        data.qpos[:] = pose
        mujoco.mj_fwdPosition(model, data)
        row[:] = 0.0
        start = model.ten_J_rowadr[index]
        entries = slice(start, start + model.ten_J_rownnz[index])
        row[model.ten_J_colind.ravel()[entries]] = data.ten_J.ravel()[entries]
        mobility = 0.0
        if model.nv > 0:
            mujoco.mj_solveM(model, data, solved, row[None, :])
            mobility = float(row @ solved[0])
        inertia = 1.0 / mobility if mobility > mujoco.mjMINVAL else math.inf
        found.append(Stance(float(data.ten_length[index]), inertia))
    return found


def sample_poses(model: mujoco.MjModel) -> list[NDArray[np.float64]]:
    """Return `qpos0`, the keyframes, and poses within the ranges of the joints."""
    poses = [model.qpos0.copy(), *(key.copy() for key in model.key_qpos)]
    random = np.random.default_rng(0)
    limited = [i for i in range(model.njnt) if model.jnt_limited[i]]
    single = [i for i in limited if model.jnt_type[i] in (_HINGE, _SLIDE)]
    shares = [np.zeros(len(single)), np.ones(len(single))]
    shares += list(random.uniform(size=(_POSES, len(single))))
    for share in shares if single else []:
        pose = model.qpos0.copy()
        low, high = model.jnt_range[single].T
        pose[model.jnt_qposadr[single]] = low + share * (high - low)
        poses.append(pose)
    return poses


def plan_winch(
    spec: mujoco.MjSpec,
    original: mujoco.MjModel,
    burden: Burden,
    given: tuple[float, float] | None,
) -> Winch:
    """Choose the winch of a tendon, light but stable at the time step of the model.

    Args:
        spec: specification in which the branches have tendons already; not changed.
        original: the specification as it was, compiled.
        burden: what the winch takes over.
        given: radius [m] and inertia [kg m^2] of a drum; None for a light slide.
    """
    model = compile_spec(spec.copy())
    stances = [measure(model, branch.name) for branch in burden.branches]
    count = len(burden.branches)
    names: tuple[str, ...] = (burden.winch,)
    if count > 1:
        names = tuple(f"{burden.winch}_{i + 1}" for i in range(count))
    moved = [min(stance.inertia for stance in branch) for branch in stances]
    moved = [mass if math.isfinite(mass) else 1.0 for mass in moved]
    lengths = tuple(branch[0].length for branch in stances)
    radius = given[0] if given else 0.0
    trial = Winch(names, radius, lengths, tuple(moved), (0.0,) * count)
    probe = spec.copy()
    write_winch(probe, original, burden, trial, probing=True)
    stiffness, drag = _drive_slopes(
        compile_spec(probe), burden, trial, [[s.length for s in b] for b in stances]
    )
    step, integrator = model.opt.timestep, model.opt.integrator
    explicit = (mujoco.mjtIntegrator.mjINT_EULER, mujoco.mjtIntegrator.mjINT_RK4)
    if integrator not in explicit:
        # The damping of actuators is implicit only while they pull.
        index = original.tendon(burden.tendon).id
        drag = max(drag - float(original.tendon_damping[index]), 0.0)
    held = burden.equalities or "range" in burden.fields
    mass_share = _HELD_MASS_SHARE if held else _MASS_SHARE
    if "frictionloss" in burden.fields:
        mass_share = _DRY_MASS_SHARE
    muscles = any(kind_of(original, i) == "muscle" for i in burden.actuators)
    margin = _MUSCLE_MARGIN if muscles else _DRAG_MARGIN
    inertias, damping = [], []
    for branch, mass in zip(burden.branches, moved, strict=True):
        # What acts on the sum of the branches acts on each by its share.
        share = 1.0 / branch.divisor**2
        k, c = stiffness * share, drag * share
        own = given[1] / given[0] ** 2 if given else mass_share * mass
        brake = 0.0 if given else _SLOWING_RATE * mass
        if _damps_implicitly(model):
            brake = max(brake, k * step if own < k * step**2 else 0.0)
        elif not given:
            own = max(own, k * step**2)
        inertias.append(own if given else max(own, margin * c * step))
        damping.append(brake)
    return Winch(names, radius, lengths, tuple(inertias), tuple(damping))


def _damps_implicitly(model: mujoco.MjModel) -> bool:
    """Return whether the damping of joints is integrated implicitly."""
    integrator, off = model.opt.integrator, model.opt.disableflags
    if integrator == mujoco.mjtIntegrator.mjINT_RK4 or (
        off & mujoco.mjtDisableBit.mjDSBL_DAMPER
    ):
        return False
    euler = integrator == mujoco.mjtIntegrator.mjINT_EULER
    return not (euler and off & mujoco.mjtDisableBit.mjDSBL_EULERDAMP)


def _drive_slopes(
    model: mujoco.MjModel, burden: Burden, winch: Winch, lengths: list[list[float]]
) -> tuple[float, float]:
    """Return the stiffness [N/m] and damping [N s/m] of what acts on a winch.

    The largest over commands and over the lengths that its branches had.
    """
    data = mujoco.MjData(model)
    joints = [model.joint(name) for name in winch.names]
    index = model.tendon(burden.winch).id
    pulling = [
        i
        for i in range(model.nactuator)
        if model.actuator_trntype[i] == _TENDON and model.actuator_trnid[i, 0] == index
    ]
    gears = model.actuator_gear[model.actuator_outadr[pulling], 0]
    outputs = model.actuator_outadr[pulling]
    controls = np.where(
        model.actuator_ctrllimited[:, None] != 0,
        model.actuator_ctrlrange,
        np.array([-1.0, 1.0]),
    )

    def force(length: float, speed: float, share: float, row: int) -> float:
        mujoco.mj_resetData(model, data)
        for joint, branch in zip(joints, lengths, strict=True):
            data.qpos[joint.qposadr[0]] = branch[row] / winch.lever
        data.qpos[joints[0].qposadr[0]] += length / winch.lever
        data.qvel[joints[0].dofadr[0]] = speed / winch.lever
        data.ctrl[:] = controls[:, 0] + share * (controls[:, 1] - controls[:, 0])
        if model.na:
            data.act[:] = share
        mujoco.mj_forward(model, data)
        total = float(gears @ data.actuator_force[outputs])
        spring = data.qfrc_spring + data.qfrc_damper
        return total + float(spring[joints[0].dofadr[0]]) / winch.lever * first

    first = burden.branches[0].divisor
    stiffness = drag = 0.0
    totals = np.sum(lengths, axis=0)
    for row in {0, int(np.argmin(totals)), int(np.argmax(totals))}:
        scale = sum(branch[row] for branch in lengths)
        tiny = 1e-4 * max(scale, 1e-3)
        for share in (0.0, 0.5, 1.0):
            at = force(0.0, 0.0, share, row)
            stiffness = max(stiffness, abs(force(tiny, 0.0, share, row) - at) / tiny)
            drag = max(drag, abs(force(0.0, tiny, share, row) - at) / tiny)
    return stiffness * first, drag * first


def write_winch(
    spec: mujoco.MjSpec,
    original: mujoco.MjModel,
    burden: Burden,
    winch: Winch,
    *,
    probing: bool = False,
) -> None:
    """Write the winch of a tendon and move to it what acts on the tendon.

    Args:
        spec: the specification to change; the branches have tendons already.
        original: the specification as it was, compiled.
        burden: what the winch takes over.
        winch: the winch.
        probing: leave out limits, dry friction and equalities.
    """
    for name, length, inertia, damping in zip(
        winch.names, winch.lengths, winch.inertias, winch.damping, strict=True
    ):
        lever = winch.lever
        body = spec.worldbody.add_body(name=name)
        body.explicitinertial = True
        body.mass, body.ipos, body.inertia = 1e-6, [0.0] * 3, [1e-12] * 3
        turns, rest = winch.radius > 0.0, length / lever
        add_element(
            body,
            "joint",
            name=name,
            type=_HINGE if turns else _SLIDE,
            axis=[1.0, 0.0, 0.0],
            ref=math.degrees(rest) if turns and spec.compiler.degree else rest,
            limited=mujoco.mjtLimited.mjLIMITED_FALSE,
            armature=inertia * lever**2,
            damping=[damping * lever**2, 0.0, 0.0],
        )
    own = spec.tendon(burden.tendon)
    taken = {field: _copied(getattr(own, field)) for field in _CARRIED}
    taken["springlength"] = burden.rest
    clamp = None if probing else _pull_range(original, burden)
    if clamp is not None:
        taken["actfrclimited"] = mujoco.mjtLimited.mjLIMITED_TRUE
        taken["actfrcrange"] = clamp
    if probing:
        taken["limited"] = taken["actfrclimited"] = mujoco.mjtLimited.mjLIMITED_FALSE
        taken["frictionloss"] = 0.0
    sum_of = add_element(spec, "tendon", name=burden.winch, **taken)
    for name, branch in zip(winch.names, burden.branches, strict=True):
        sum_of.wrap_joint(name, winch.lever / branch.divisor)
    slacken(spec, burden.tendon)
    for place in burden.actuators:
        _move_actuator(spec.actuators[place], original, place, burden.winch)
    for place in () if probing else burden.equalities:
        equality = spec.equalities[place]
        for end in ("name1", "name2"):
            if getattr(equality, end) == burden.tendon:
                setattr(equality, end, burden.winch)
    for place in () if probing else burden.sensors:
        spec.sensors[place].objname = burden.winch
    if probing:
        for equality in [spec.equalities[i] for i in burden.equalities]:
            spec.delete(equality)
        for sensor in [spec.sensors[i] for i in burden.sensors]:
            spec.delete(sensor)


def slacken(spec: mujoco.MjSpec, tendon: str) -> None:
    """Take from a tendon all that acts on it as a whole."""
    own, plain = spec.tendon(tendon), pristine_fields("tendon")
    for field in _CARRIED:
        setattr(own, field, plain[field])


def _copied(value: Any) -> Any:
    return value.copy() if isinstance(value, np.ndarray) else value


def _move_actuator(
    actuator: Any, original: mujoco.MjModel, place: int, winch: str
) -> None:
    """Let an actuator pull a winch, with all that depended on its tendon as it was."""
    actuator.target = winch
    out = original.actuator_outadr[place]
    if original.actuator_lengthrange[out].any():
        actuator.lengthrange = original.actuator_lengthrange[out]
    if actuator.biastype == _BIAS.mjBIAS_AFFINE and actuator.biasprm[2] > 0.0:
        # A ratio of damping, of the inertia that the tendon moved.
        actuator.biasprm = original.actuator_biasprm[place]
    if actuator.gaintype == _GAIN.mjGAIN_MUSCLE and actuator.gainprm[2] < 0.0:
        strength = actuator.gainprm[3] / max(float(original.actuator_acc0[out]), 1e-15)
        for field in ("gainprm", "biasprm"):
            numbers = np.array(getattr(actuator, field))
            numbers[2] = strength
            setattr(actuator, field, numbers)


def can_push(original: mujoco.MjModel, burden: Burden) -> bool:
    """Return whether an actuator of the tendon might lengthen it."""
    return any(
        original.actuator_gaintype[i] != _GAIN.mjGAIN_MUSCLE for i in burden.actuators
    )


def _pull_range(original: mujoco.MjModel, burden: Burden) -> tuple[float, float] | None:
    """Return the range of the actuators' sum in which they pull, None for any.

    Raises:
        CableError: their gears have both signs, so that there is no such range.
    """
    if not can_push(original, burden):
        return None
    out = original.actuator_outadr[list(burden.actuators)]
    gears = original.actuator_gear[out, 0]
    if np.any(gears > 0.0) and np.any(gears < 0.0):
        raise CableError(
            f"actuators of tendon {burden.tendon!r} have gears of both signs; a cable "
            "cannot be pushed, and MuJoCo can only keep forces of one sign from doing "
            "so: write the negative gears as positive ones with the opposite gain."
        )
    low, high = (-_ANY_FORCE, 0.0) if np.all(gears > 0.0) else (0.0, _ANY_FORCE)
    index = original.tendon(burden.tendon).id
    if original.tendon_actfrclimited[index]:
        low = max(low, float(original.tendon_actfrcrange[index, 0]))
        high = min(high, float(original.tendon_actfrcrange[index, 1]))
        if low >= high:
            raise CableError(
                f"tendon {burden.tendon!r} has an `actuatorfrcrange` in which its "
                "actuators only push; a cable cannot be pushed."
            )
    return low, high


def keep_constraints(
    spec: mujoco.MjSpec, original: mujoco.MjModel, burden: Burden
) -> None:
    """Make limits, dry friction and equalities of a winch as stiff as the tendon's.

    MuJoCo scales the regularisation of a constraint by the inverse of the inertia that
    it moves, of which a winch has little. A constraint also resists like an inertia of
    its own, and what the light winch has of speed would count as the momentum of that:
    limits and dry friction therefore stop a winch within a step, as a spring and a
    dashpot do.
    """
    model = compile_spec(spec.copy())
    before = {
        t: original.tendon_invweight0[original.tendon(t).id] for t in _names(original)
    }
    after = {t: model.tendon_invweight0[model.tendon(t).id] for t in _names(model)}
    own, index = spec.tendon(burden.winch), original.tendon(burden.tendon).id
    inverse, step = before[burden.tendon], original.opt.timestep
    if not inverse > 0.0 or not after[burden.winch] > 0.0:
        return
    stop = _as_spring(
        original.tendon_solimp_lim[index],
        original.tendon_solref_lim[index],
        inverse,
        step,
    )
    # A stop that the elastic cable does not bounce from.
    drag = max(2.0 * math.sqrt(stop.stiffness / inverse), 2.0 * stop.stiffness * step)
    stop = dataclasses.replace(stop, damping=drag)
    own.solimp_limit, own.solref_limit = stop.on(after[burden.winch], step)
    dry = _as_spring(
        original.tendon_solimp_fri[index],
        original.tendon_solref_fri[index],
        inverse,
        step,
    )
    own.solimp_friction, own.solref_friction = dry.on(after[burden.winch], step)
    for place in burden.equalities:
        equality = spec.equalities[place]
        pair = [name for name in (equality.name1, equality.name2) if name]
        old = sum(before.get(n, before[burden.tendon]) for n in pair)
        new = sum(after[n] for n in pair)
        _rescale(equality, "solimp", "solref", old / max(new, mujoco.mjMINVAL))


@dataclasses.dataclass(frozen=True)
class _Stop:
    """A constraint as a spring and a dashpot: stiffness [N/m], damping [N s/m]."""

    stiffness: float
    damping: float

    def on(self, inverse: float, step: float) -> tuple[list[float], list[float]]:
        """Return `solimp` and `solref` for an inverse inertia [1/kg] at a step [s]."""
        weight = self.damping * step
        impedance = min(weight * inverse / (1.0 + weight * inverse), mujoco.mjMAXIMP)
        weight = impedance / ((1.0 - impedance) * inverse)
        rate = min(self.stiffness / weight, 0.5 / step**2)
        solimp = [impedance, impedance, 1e-3, 0.5, 2.0]
        return solimp, [-rate * impedance, -impedance / step]


def _as_spring(
    solimp: NDArray[np.float64],
    solref: NDArray[np.float64],
    inverse: float,
    step: float,
) -> _Stop:
    """Return the stiffness and the damping of a constraint, see MuJoCo's `solref`."""
    most = float(np.clip(solimp[1], mujoco.mjMINIMP, mujoco.mjMAXIMP))
    weight = most / ((1.0 - most) * inverse)
    if solref[0] > 0.0:
        time = max(float(solref[0]), 2.0 * step)
        rate = 1.0 / (most * time * float(solref[1])) ** 2
        return _Stop(weight * rate * most, weight * 2.0 / (most * time))
    return _Stop(-weight * float(solref[0]) / most, -weight * float(solref[1]) / most)


def _names(model: mujoco.MjModel) -> list[str]:
    return [model.tendon(i).name for i in range(model.ntendon)]


def _rescale(owner: Any, impedance: str, reference: str, ratio: float) -> None:
    """Change an impedance so that it leaves the regularisation as it was."""
    if not ratio > 0.0:
        return
    solimp = np.array(getattr(owner, impedance))
    limits = (mujoco.mjMINIMP, mujoco.mjMAXIMP)
    old = np.clip(solimp[:2], *limits)
    solimp[:2] = np.clip(1.0 / (1.0 + (1.0 / old - 1.0) * ratio), *limits)
    setattr(owner, impedance, solimp)
    solref = np.array(getattr(owner, reference))
    if solref[0] > 0.0:
        # Its time constant is in units of the impedance.
        solref[0] *= old[1] / solimp[1]
        setattr(owner, reference, solref)


def pose_keyframes(
    spec: mujoco.MjSpec, original: mujoco.MjModel, burden: Burden, winch: Winch
) -> None:
    """Pay out in every keyframe what its pose takes."""
    if not spec.keys:
        return
    model = compile_spec(spec)  # its keyframes follow
    data = mujoco.MjData(model)
    for i, key in enumerate(spec.keys):
        pose = model.key_qpos[i].copy()
        data.qpos[:] = pose
        mujoco.mj_fwdPosition(model, data)
        for name, branch in zip(winch.names, burden.branches, strict=True):
            length = data.ten_length[model.tendon(branch.name).id]
            pose[model.joint(name).qposadr[0]] = length / winch.lever
        key.qpos = pose


def kind_of(model: mujoco.MjModel, actuator: int) -> str:
    """Return the element of MJCF that an actuator was written as, or acts like."""
    gain, bias = model.actuator_gaintype[actuator], model.actuator_biastype[actuator]
    if model.actuator_plugin[actuator] >= 0:
        return "plugin"
    for kind, law in (
        ("muscle", _GAIN.mjGAIN_MUSCLE),
        ("dcmotor", _GAIN.mjGAIN_DCMOTOR),
        ("pid", _GAIN.mjGAIN_PID),
    ):
        if gain == law:
            return kind
    if gain != _GAIN.mjGAIN_FIXED:
        return "general"
    if bias == _BIAS.mjBIAS_NONE:
        plain = model.actuator_dyntype[actuator] == _DYN.mjDYN_NONE
        return "motor" if plain else "general"
    own, law = model.actuator_gainprm[actuator, 0], model.actuator_biasprm[actuator]
    if bias == _BIAS.mjBIAS_AFFINE and law[0] == 0.0:
        if law[1] == -own:
            return "position"
        if law[1] == 0.0 and law[2] == -own:
            return "velocity"
    return "general"


def describe_winch(
    original: mujoco.MjModel, spec: mujoco.MjSpec, burden: Burden, winch: Winch
) -> list[str]:
    """Return a line for everything that moved to a winch."""
    place = f"winch {burden.winch!r}"
    lines = []
    if burden.has_pulleys:
        parts = ", ".join(f"{b.name!r} (1/{b.divisor:g})" for b in burden.branches)
        lines.append(
            f"<pulley>: the branches are the cables {parts}, each with its share of "
            f"the force; tendon {burden.tendon!r} stays as their length"
        )
    for i in burden.actuators:
        kind, name = kind_of(original, i), original.actuator(i).name
        label = f"{kind} {name!r}" if name else f"{kind} {i}"
        law = "the same command, gains and ranges"
        if spec.actuators[i].gaintype == _GAIN.mjGAIN_MUSCLE:
            low, high = original.actuator_lengthrange[original.actuator_outadr[i]]
            law = f"the same excitation and length range {low:.4g} to {high:.4g} m"
        lines.append(f"{label}: pulls at the first site, through {place}, by {law}")
    if can_push(original, burden):
        lines.append(
            f"pushing: a cable cannot; the actuators of {place} give no force that "
            "would lengthen it"
        )
    index = original.tendon(burden.tendon).id
    low, high = burden.rest
    if "stiffness" in burden.fields:
        text = (
            f"stiffness {burden.spring[0]:g} N/m: a spring at the first site, on "
            f"{place}, without force up to {high:.4g} m"
        )
        if low > 0.0:
            text += f"; below {low:.4g} m, where it pushed, the cable is slack"
        lines.append(text)
    if "damping" in burden.fields:
        lines.append(f"damping: acts on {place}, on what moves past the first site")
    if "frictionloss" in burden.fields:
        value = original.tendon_frictionloss[index]
        lines.append(f"frictionloss {value:g} N: acts on {place}")
    if "armature" in burden.fields:
        value = original.tendon_armature[index]
        lines.append(f"armature {value:g} kg: turns with {place}")
    if "range" in burden.fields:
        least, most = original.tendon_range[index]
        text = f"range: {place} pays out no more than {most:.4g} m"
        if least > 0.0:
            text += (
                f" and winds up to {least:.4g} m; a path that joints make shorter than "
                "that hangs slack, so limit the joints"
            )
        lines.append(text)
    if "actuatorfrcrange" in burden.fields:
        lines.append(f"actuatorfrcrange: limits the actuators of {place}")
    for i in burden.equalities:
        name = spec.equalities[i].name or f"number {i}"
        lines.append(f"equality {name!r}: holds the length that {place} pays out")
    for i in burden.sensors:
        lines.append(f"sensor {spec.sensors[i].name!r}: reads {place}")
    kept = [
        s.name
        for s in spec.sensors
        if s.objname == burden.tendon and s.type not in _MOVED_SENSORS
    ]
    if kept:
        lines.append(
            f"sensors {', '.join(map(repr, kept))}: still read the length of the path"
        )
    joints = ", ".join(map(repr, winch.names))
    mass = ", ".join(f"{m:.2g}" for m in winch.inertias)
    drag = ", ".join(f"{c:.2g}" for c in winch.damping)
    word = "joint" if len(winch.names) == 1 else "joints"
    unit = "angle" if winch.radius else "length paid out"
    lines.append(
        f"new {word} {joints}, last in qpos: {unit}, of inertia {mass} kg and damping "
        f"{drag} N s/m at the tendon; a pose set by hand needs the length of the path "
        "there, then `cc_mujoco.plugin.settle`"
    )
    return lines


def describe_band(burden: Burden, stiffness: float, pretension: float) -> list[str]:
    """Return the lines of an elastic band."""
    low, high = burden.rest
    text = (
        f"stiffness {burden.spring[0]:g} N/m beyond {high:.4g} m: an elastic band, "
        f"axial_stiffness {stiffness:.4g} N, {pretension:.4g} N in the pose qpos0"
    )
    if low > 0.0:
        text += f"; below {low:.4g} m, where the tendon pushed, it is slack"
    return [text]


def order_line(model: mujoco.MjModel, cables: Sequence[str], before: int) -> str:
    """Return the line that tells where the ends of cables are among the actuators."""
    ends = [model.actuator(f"{name}_{end}").id for name in cables for end in _ENDS]
    places = sorted(int(model.actuator_ctrladr[end]) for end in ends)
    if places[0] >= before:
        text = "the places of all others stay"
    else:
        text = "the places of those behind them change"
    return (
        f"ctrl: the ends of the cable are {places[0]} to {places[-1]}, which take no "
        f"command; {text}"
    )
