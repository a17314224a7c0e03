"""Winch at the first site of a tendon, which takes over what acted on it as a whole.

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
import itertools
import math
from collections.abc import Iterable
from typing import Any, TypeAlias

import mujoco
import numpy as np
from numpy.typing import NDArray

from cc_mujoco.errors import CableError
from cc_mujoco.plugin._spec import add_element, compile_spec
from cc_mujoco.plugin._tendons.burden import (
    CARRIED,
    Burden,
    can_push,
    kind_of,
    slacken,
)

_TENDON = mujoco.mjtTrn.mjTRN_TENDON
_HINGE, _SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
_GAIN, _BIAS = mujoco.mjtGain, mujoco.mjtBias
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
_POSES = 12


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


def measure(model: mujoco.MjModel, tendons: Iterable[str]) -> dict[str, list[Stance]]:
    """Measure tendons in the pose `qpos0`, in keyframes and over the joints' ranges.

    The stances are by tendon, that of `qpos0` first; without inertia where nothing
    moves it.
    """
    data = mujoco.MjData(model)
    found: dict[str, list[Stance]] = {tendon: [] for tendon in tendons}
    row, solved = np.zeros(model.nv), np.zeros((1, model.nv))
    for pose in sample_poses(model):
        data.qpos[:] = pose
        mujoco.mj_fwdPosition(model, data)
        for tendon, stances in found.items():
            index = model.tendon(tendon).id
            row[:] = 0.0
            start = model.ten_J_rowadr[index]
            entries = slice(start, start + model.ten_J_rownnz[index])
            row[model.ten_J_colind.ravel()[entries]] = data.ten_J.ravel()[entries]
            mobility = 0.0
            if model.nv > 0:
                mujoco.mj_solveM(model, data, solved, row[None, :])
                mobility = float(row @ solved[0])
            inertia = 1.0 / mobility if mobility > mujoco.mjMINVAL else math.inf
            stances.append(Stance(float(data.ten_length[index]), inertia))
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


Taken: TypeAlias = list[tuple[Burden, Winch]]
"""Burdens of tendons, with the winches that take them over."""


def plan_winches(
    spec: mujoco.MjSpec,
    original: mujoco.MjModel,
    burdens: dict[Burden, tuple[float, float] | None],
) -> Taken:
    """Choose the winches of tendons, light but stable at the time step of the model.

    In `spec`, which is not changed, the branches have tendons already; `original` is
    the model before. `burdens` have radius [m] and inertia [kg m^2] of each drum, None
    for a light slide.
    """
    branched = any(burden.has_pulleys for burden in burdens)
    model = compile_spec(spec.copy()) if branched else original
    branches = [branch.name for burden in burdens for branch in burden.branches]
    stances = measure(model, branches)
    trials: Taken = []
    for burden, given in burdens.items():
        count, radius = len(burden.branches), given[0] if given else 0.0
        names: tuple[str, ...] = (burden.winch,)
        if count > 1:
            names = tuple(f"{burden.winch}_{i + 1}" for i in range(count))
        own = [stances[branch.name] for branch in burden.branches]
        moved = [min(stance.inertia for stance in branch) for branch in own]
        moved = [mass if math.isfinite(mass) else 1.0 for mass in moved]
        lengths = tuple(branch[0].length for branch in own)
        trial = Winch(names, radius, lengths, tuple(moved), (0.0,) * count)
        trials.append((burden, trial))
    probe = spec.copy()
    write_winches(probe, original, trials, probing=True)
    probed = compile_spec(probe)
    planned: Taken = []
    for burden, trial in trials:
        ways = [[s.length for s in stances[b.name]] for b in burden.branches]
        slopes = _drive_slopes(probed, burden, trial, ways)
        winch = _stable_winch(original, burden, trial, burdens[burden], *slopes)
        planned.append((burden, winch))
    return planned


def _stable_winch(
    original: mujoco.MjModel,
    burden: Burden,
    trial: Winch,
    given: tuple[float, float] | None,
    stiffness: float,
    drag: float,
) -> Winch:
    """Return a winch with inertia and damping that bear what acts on it.

    `trial` has the inertia that each of its branches moves, `given` are as in
    `plan_winches`, `stiffness` [N/m] and `drag` [N s/m] those of what acts on it.
    """
    step, integrator = original.opt.timestep, original.opt.integrator
    explicit = (mujoco.mjtIntegrator.mjINT_EULER, mujoco.mjtIntegrator.mjINT_RK4)
    if integrator not in explicit:
        # The damping of actuators is implicit only while they pull.
        index = original.tendon(burden.tendon).id
        drag = max(drag - float(original.tendon_damping[index]), 0.0)
    sprung = "stiffness" in burden.fields  # which ends its drift
    held = burden.equalities or "range" in burden.fields
    mass_share = _HELD_MASS_SHARE if held else _MASS_SHARE
    if "frictionloss" in burden.fields:
        mass_share = _DRY_MASS_SHARE
    muscles = any(kind_of(original, i) == "muscle" for i in burden.actuators)
    margin = _MUSCLE_MARGIN if muscles else _DRAG_MARGIN
    inertias, damping = [], []
    for branch, mass in zip(burden.branches, trial.inertias, strict=True):
        # What acts on the sum of the branches acts on each by its share.
        share = 1.0 / branch.divisor**2
        k, c = stiffness * share, drag * share
        own = given[1] / given[0] ** 2 if given else mass_share * mass
        brake = 0.0 if given or sprung else _SLOWING_RATE * mass
        if _damps_implicitly(original):
            brake = max(brake, k * step if own < k * step**2 else 0.0)
        elif not given:
            own = max(own, k * step**2)
        inertias.append(own if given else max(own, margin * c * step))
        damping.append(brake)
    return dataclasses.replace(trial, inertias=tuple(inertias), damping=tuple(damping))


def largest_pull(original: mujoco.MjModel, burden: Burden) -> float:
    """Return the largest tension that the actuators of a tendon make in a branch [N].

    That of motors and muscles whose command is limited and of all whose force is; 0 for
    others, of which no limit is known.
    """
    data = mujoco.MjData(original)
    pulls = [0.0] * len(burden.actuators)
    for share in (0.0, 1.0):
        low, high = original.actuator_ctrlrange.T
        limited = original.actuator_ctrllimited != 0
        data.ctrl[:] = np.where(limited, low + share * (high - low), 0.0)
        if original.na:
            data.act[:] = share
        mujoco.mj_forward(original, data)
        for k, i in enumerate(burden.actuators):
            out = original.actuator_outadr[i]
            gear = original.actuator_gear[out, 0]
            if original.actuator_forcelimited[i]:
                force = original.actuator_forcerange[i][int(share)]
            elif limited[i] and original.actuator_biastype[i] != _BIAS.mjBIAS_AFFINE:
                force = data.actuator_force[out]
            else:
                continue
            pulls[k] = max(pulls[k], float(-gear * force))
    index = original.tendon(burden.tendon).id
    pull = sum(pulls)
    if original.tendon_actfrclimited[index]:
        pull = min(pull, -float(original.tendon_actfrcrange[index, 0]))
    return pull / min(branch.divisor for branch in burden.branches)


def _damps_implicitly(model: mujoco.MjModel) -> bool:
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


def write_winches(
    spec: mujoco.MjSpec,
    original: mujoco.MjModel,
    taken: Taken,
    *,
    probing: bool = False,
) -> None:
    """Write the winches of tendons and move to them what acts on the tendons.

    In `spec` the branches have tendons already; `original` is the model before. With
    `probing` without limits, dry friction, equalities and sensors.
    """
    for burden, winch in taken:
        _write_winch(spec, original, burden, winch, probing)
    if probing:
        for kind in ("equalities", "sensors"):
            places = {i for burden, _ in taken for i in getattr(burden, kind)}
            for element in [getattr(spec, kind)[i] for i in places]:
                spec.delete(element)


def _write_winch(
    spec: mujoco.MjSpec,
    original: mujoco.MjModel,
    burden: Burden,
    winch: Winch,
    probing: bool,
) -> None:
    """Write a winch as `write_winches` does; where probing without what it removes."""
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
    taken = {field: _copied(getattr(own, field)) for field in CARRIED}
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


def _pull_range(original: mujoco.MjModel, burden: Burden) -> tuple[float, float] | None:
    """Return the range of the actuators' sum in which they pull, None for any."""
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


def pose_keyframes(spec: mujoco.MjSpec, original: mujoco.MjModel, taken: Taken) -> None:
    """Pay out in every keyframe what its pose takes; move what springs have yielded."""
    if not spec.keys:
        return
    model = compile_spec(spec)  # its keyframes follow
    data = mujoco.MjData(model)
    for i, key in enumerate(spec.keys):
        pose = model.key_qpos[i].copy()
        data.qpos[:] = pose
        mujoco.mj_fwdPosition(model, data)
        for burden, winch in taken:
            for name, branch in zip(winch.names, burden.branches, strict=True):
                length = data.ten_length[model.tendon(branch.name).id]
                pose[model.joint(name).qposadr[0]] = length / winch.lever
        key.qpos = pose
        if getattr(original, "nplastic", 0):  # from MuJoCo 4.0
            key.plastic = _moved_plastic(original, model, taken, i)


def _moved_plastic(
    original: mujoco.MjModel, model: mujoco.MjModel, taken: Taken, key: int
) -> NDArray[np.float64]:
    """Return the plastic state of a keyframe, which MuJoCo keeps by its place alone.

    `original` is the model before its tendons were taken over, `model` the one after.
    """
    before, after = _plastic_parts(original), _plastic_parts(model)
    for burden, _ in taken:
        source = "tendon", original.tendon(burden.tendon).id
        target = "tendon", model.tendon(burden.winch).id
        if source in before:
            before[target] = before.pop(source)
    found = np.empty(model.nplastic)
    for part, own in after.items():
        found[own] = original.key_plastic[key][before[part]]
    return found


def _plastic_parts(model: mujoco.MjModel) -> dict[tuple[str, int], slice]:
    """Return where joints, tendons and flexes are in the plastic state, by index."""
    starts = {
        int(adr): (kind, i)
        for kind, places in (
            ("joint", model.jnt_plasticadr),
            ("tendon", model.tendon_plasticadr),
            ("flex", model.flex_plasticadr),
        )
        for i, adr in enumerate(places)
        if adr >= 0
    }
    order = [*sorted(starts), model.nplastic]
    return {starts[a]: slice(a, b) for a, b in itertools.pairwise(order)}
