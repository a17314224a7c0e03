"""Winch at the first site of a tendon, which takes over what acted on it as a whole.

A tendon of MuJoCo has one force F along its whole length. A cable with friction has a
tension for every piece, so nothing can act on it as a whole: what did so must act at
its first site. There a *winch* holds the proximal end: a joint `s`, by default a light
slide, that is the length of tendon paid out, and a fixed tendon `<tendon>_winch` of the
length s, on which everything moves that acted on the tendon itself: actuators, spring,
damper, dry friction, limit, armature, equalities. Without friction and stretch s is the
length of the tendon, so that commands in metres and in newtons mean what they did:

    virtual work   F ds = F dL,   the tension is -F.

The branches of a tendon with `<pulley>` have a winch each and the fixed tendon adds
them up, s = sum s_b / divisor_b: their tensions are -F / divisor_b, as MuJoCo has it.

A band, a tendon with nothing but a linear spring that is taut in the pose `qpos0`,
needs no winch: the cable itself has this stiffness, EA = k times the rest length.
"""

import copy
import dataclasses
import itertools
import math
from collections.abc import Iterable
from typing import Any

import mujoco
import numpy as np

from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray
from cc_mujoco.plugin._spec import add_element, compile_spec
from cc_mujoco.plugin._tendons import burden as burdens
from cc_mujoco.plugin._tendons.burden import Burden

_HINGE, _SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
_GAIN, _BIAS = mujoco.mjtGain, mujoco.mjtBias


@dataclasses.dataclass(frozen=True)
class Winch:
    """Joints that hold the proximal ends of the branches of a tendon."""

    burden: Burden  # loads on the tendon, which the winches take over
    names: tuple[str, ...]  # names of the joints, one for every branch
    radius: float  # radius of the drum [m]; 0 for a slide
    lengths: tuple[float, ...]  # lengths of the branches in the pose `qpos0` [m]
    inertias: tuple[float, ...]  # inertias of the joints, at the tendon [kg]
    damping: tuple[float, ...]  # damping of the joints, at the tendon [N s/m]

    @property
    def lever(self) -> float:
        """Length of tendon per unit of its joint: 1 for a slide, or the radius [m]."""
        return self.radius or 1.0


def _measure(model: mujoco.MjModel, tendons: Iterable[str]) -> dict[str, FloatArray]:
    """Measure tendons in the poses of `sample_poses`, of which `qpos0` is the first.

    Return, by tendon, its lengths [m] and the inertias that it moves [kg] (2, poses).
    An inertia is infinite if nothing moves.
    """
    data, poses = mujoco.MjData(model), sample_poses(model)
    found = {tendon: np.empty((2, len(poses))) for tendon in tendons}
    row, solved = np.zeros(model.nv), np.zeros((1, model.nv))
    for k, pose in enumerate(poses):
        data.qpos[:] = pose
        mujoco.mj_fwdPosition(model, data)
        for tendon, measured in found.items():
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
            measured[:, k] = data.ten_length[index], inertia
    return found


def sample_poses(model: mujoco.MjModel) -> list[FloatArray]:
    """Return `qpos0`, the keyframes, and poses within the ranges of the joints."""
    poses = [model.qpos0.copy(), *(key.copy() for key in model.key_qpos)]
    random = np.random.default_rng(0)
    limited = [i for i in range(model.njnt) if model.jnt_limited[i]]
    single = [i for i in limited if model.jnt_type[i] in (_HINGE, _SLIDE)]
    shares = [np.zeros(len(single)), np.ones(len(single))]
    shares += list(random.uniform(size=(12, len(single))))
    for share in shares if single else []:
        pose = model.qpos0.copy()
        low, high = model.jnt_range[single].T
        pose[model.jnt_qposadr[single]] = low + share * (high - low)
        poses.append(pose)
    return poses


def plan_winches(
    spec: mujoco.MjSpec,
    original: mujoco.MjModel,
    drums: dict[Burden, tuple[float, float] | None],
) -> list[Winch]:
    """Choose the winches of tendons, light but stable at the time step of the model.

    In `spec`, which is not changed, the branches have tendons already; `original` is
    the model before. `drums` have a radius [m] and an inertia [kg m^2], None for a
    light slide.
    """
    branched = any(burden.has_pulleys for burden in drums)
    model = compile_spec(spec.copy()) if branched else original
    measured = _measure(model, (x.name for burden in drums for x in burden.branches))
    trials, ways = list[Winch](), list[FloatArray]()
    for burden, drum in drums.items():
        count = len(burden.branches)
        names: tuple[str, ...] = (burden.winch,)
        if count > 1:
            names = tuple(f"{burden.winch}_{i + 1}" for i in range(count))
        own = np.array([measured[branch.name] for branch in burden.branches])
        moved = own[:, 1].min(axis=1)
        moved[np.isinf(moved)] = 1.0
        radius, rest = drum[0] if drum else 0.0, tuple(own[:, 0, 0].tolist())
        inertias, damping = tuple(moved.tolist()), (0.0,) * count
        trials.append(Winch(burden, names, radius, rest, inertias, damping))
        ways.append(own[:, 0])
    probe = spec.copy()
    for trial in trials:
        _write_winch(probe, original, trial, probing=True)
    for kind in ("equalities", "sensors"):
        places = {i for burden in drums for i in getattr(burden, kind)}
        for element in [getattr(probe, kind)[i] for i in places]:
            probe.delete(element)
    probed = compile_spec(probe)
    return [
        _stable_winch(
            original, trial, drums[trial.burden], *_drive_slopes(probed, trial, lengths)
        )
        for trial, lengths in zip(trials, ways, strict=True)
    ]


def _stable_winch(
    original: mujoco.MjModel,
    trial: Winch,
    drum: tuple[float, float] | None,
    stiffness: float,
    drag: float,
) -> Winch:
    """Return `trial` with inertia and damping at which it is stable.

    `trial` has the inertia that each of its branches moves [kg]. `drum` has a radius
    [m] and an inertia [kg m^2], None for a light slide. `stiffness` [N/m] and `drag` [N
    s/m] are those of what acts on the winch.
    """
    burden = trial.burden
    step, off = original.opt.timestep, original.opt.disableflags
    euler = original.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER
    rk4 = original.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
    undamped = off & mujoco.mjtDisableBit.mjDSBL_DAMPER or (
        euler and off & mujoco.mjtDisableBit.mjDSBL_EULERDAMP
    )
    if not (euler or rk4):
        # The damping of actuators is implicit only while they pull.
        drag = max(drag - float(original.tendon_damping[burden.index]), 0.0)
    sprung = "stiffness" in burden.fields  # which ends its drift
    # The inertia of a winch as a share of what its tendon moves. It is more where
    # limits, equalities or dry friction hold it: a cable feels a change of theirs a
    # step late, and a light winch would tremble.
    mass_share = 5e-3
    if burden.equalities or "range" in burden.fields:
        mass_share = 5e-2
    if "frictionloss" in burden.fields:
        mass_share = 0.1
    # Inertia that bears an explicit drag c at a step h, as a share of c h.
    muscles = any(burdens.kind_of(original, i) == "muscle" for i in burden.actuators)
    margin = 0.6 if muscles else 1.0
    inertias, damping = [], []
    for branch, mass in zip(burden.branches, trial.inertias, strict=True):
        # What acts on the sum of the branches acts on each by its share.
        share = 1.0 / branch.divisor**2
        k, c = stiffness * share, drag * share
        own = drum[1] / drum[0] ** 2 if drum else mass_share * mass
        # Without a brake, by a rate [1/s], a winch that nothing pulls would pay out for
        # ever what a falling load once drew.
        brake = 0.0 if drum or sprung else 0.05 * mass
        if not (rk4 or undamped):  # which makes damping of joints implicit
            brake = max(brake, k * step if own < k * step**2 else 0.0)
        elif not drum:
            own = max(own, k * step**2)
        inertias.append(own if drum else max(own, margin * c * step))
        damping.append(brake)
    return dataclasses.replace(trial, inertias=tuple(inertias), damping=tuple(damping))


def largest_pull(original: mujoco.MjModel, burden: Burden) -> float:
    """Return the largest tension that the actuators of a tendon make in a branch [N].

    Counted are motors and muscles with a limited command, and all actuators with a
    limited force. The force of others is unknown and counts as 0.
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
    index, pull = burden.index, sum(pulls)
    if original.tendon_actfrclimited[index]:
        pull = min(pull, -float(original.tendon_actfrcrange[index, 0]))
    return pull / min(branch.divisor for branch in burden.branches)


def _drive_slopes(
    model: mujoco.MjModel, winch: Winch, lengths: FloatArray
) -> tuple[float, float]:
    """Return the load's largest stiffness [N/m] and damping [N s/m] at `lengths`."""
    data = mujoco.MjData(model)
    joints = [model.joint(name) for name in winch.names]
    index = model.tendon(winch.burden.winch).id
    pulling = [
        i
        for i in range(model.nactuator)
        if model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_TENDON
        and model.actuator_trnid[i, 0] == index
    ]
    outputs = model.actuator_outadr[pulling]
    gears = model.actuator_gear[outputs, 0]
    controls = np.where(
        model.actuator_ctrllimited[:, None] != 0,
        model.actuator_ctrlrange,
        np.array([-1.0, 1.0]),
    )

    def force(length: float, speed: float, share: float, row: int) -> float:
        mujoco.mj_resetData(model, data)
        for joint, own in zip(joints, lengths[:, row], strict=True):
            data.qpos[joint.qposadr[0]] = own / winch.lever
        data.qpos[joints[0].qposadr[0]] += length / winch.lever
        data.qvel[joints[0].dofadr[0]] = speed / winch.lever
        data.ctrl[:] = controls[:, 0] + share * (controls[:, 1] - controls[:, 0])
        if model.na:
            data.act[:] = share
        mujoco.mj_forward(model, data)
        total = float(gears @ data.actuator_force[outputs])
        spring = data.qfrc_spring + data.qfrc_damper
        return total + float(spring[joints[0].dofadr[0]]) / winch.lever * first

    first = winch.burden.branches[0].divisor
    stiffness = drag = 0.0
    totals = np.sum(lengths, axis=0)
    for row in {0, int(np.argmin(totals)), int(np.argmax(totals))}:
        tiny = 1e-4 * max(float(totals[row]), 1e-3)
        for share in (0.0, 0.5, 1.0):
            at = force(0.0, 0.0, share, row)
            stiffness = max(stiffness, abs(force(tiny, 0.0, share, row) - at) / tiny)
            drag = max(drag, abs(force(0.0, tiny, share, row) - at) / tiny)
    return stiffness * first, drag * first


def write_winches(
    spec: mujoco.MjSpec,
    original: mujoco.MjModel,
    winches: list[Winch],
    model: mujoco.MjModel | None = None,
) -> mujoco.MjModel:
    """Write winches and retarget to them what acts on their tendons.

    In `spec` the branches have tendons already; `original` is the model before. Return
    the compiled `spec` with the winches, or `model` if that is given.
    """
    for winch in winches:
        _write_winch(spec, original, winch)
    model = compile_spec(spec.copy()) if model is None else model
    burdens.keep_constraints(spec, model, original, [winch.burden for winch in winches])
    _pose_keyframes(spec, original, winches)
    return model


def _write_winch(
    spec: mujoco.MjSpec, original: mujoco.MjModel, winch: Winch, probing: bool = False
) -> None:
    """Write a winch and retarget to it what acts on its tendon.

    With `probing`, leave out limits, dry friction, equalities and sensors.
    """
    burden = winch.burden
    for name, length, inertia, damping in zip(
        winch.names, winch.lengths, winch.inertias, winch.damping, strict=True
    ):
        lever = winch.lever
        body = spec.worldbody.add_body(name=name)
        body.explicitinertial = True
        body.mass, body.ipos, body.inertia = 1e-6, [0.0] * 3, [1e-12] * 3
        turns, rest = winch.radius > 0.0, length / lever
        add_element(
            body, "joint", name=name, type=_HINGE if turns else _SLIDE,
            axis=[1.0, 0.0, 0.0],
            ref=math.degrees(rest) if turns and spec.compiler.degree else rest,
            limited=mujoco.mjtLimited.mjLIMITED_FALSE, armature=inertia * lever**2,
            damping=[damping * lever**2, 0.0, 0.0],
        )  # fmt: skip
    own = spec.tendon(burden.tendon)
    taken = {field: copy.copy(getattr(own, field)) for field in burdens.CARRIED}
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
    burdens.slacken(spec, burden.tendon)
    for place in burden.actuators:
        _move_actuator(spec.actuators[place], original, place, burden.winch)
    if probing:
        return
    for place in burden.equalities:
        equality = spec.equalities[place]
        for end in ("name1", "name2"):
            if getattr(equality, end) == burden.tendon:
                setattr(equality, end, burden.winch)
    for place in burden.sensors:
        spec.sensors[place].objname = burden.winch


def _move_actuator(
    actuator: Any, original: mujoco.MjModel, place: int, winch: str
) -> None:
    """Let an actuator pull a winch; keep its length range, damping and strength."""
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
    if not burdens.can_push(original, burden):
        return None
    out = original.actuator_outadr[list(burden.actuators)]
    gears = original.actuator_gear[out, 0]
    if np.any(gears > 0.0) and np.any(gears < 0.0):
        raise CableError(
            f"actuators of tendon {burden.tendon!r} have gears of both signs; a cable "
            "cannot be pushed, and MuJoCo can only keep forces of one sign from doing "
            "so: write the negative gears as positive ones with the opposite gain."
        )
    any_force = 1e12
    low, high = (-any_force, 0.0) if np.all(gears > 0.0) else (0.0, any_force)
    index = burden.index
    if original.tendon_actfrclimited[index]:
        low = max(low, float(original.tendon_actfrcrange[index, 0]))
        high = min(high, float(original.tendon_actfrcrange[index, 1]))
        if low >= high:
            raise CableError(
                f"tendon {burden.tendon!r} has an `actuatorfrcrange` in which its "
                "actuators only push; a cable cannot be pushed."
            )
    return low, high


def _pose_keyframes(
    spec: mujoco.MjSpec, original: mujoco.MjModel, winches: list[Winch]
) -> None:
    """Set winches to their tendons' lengths in every keyframe; move plastic stretch."""
    if not spec.keys:
        return
    model = compile_spec(spec)  # its keyframes follow
    data = mujoco.MjData(model)
    for i, key in enumerate(spec.keys):
        pose = model.key_qpos[i].copy()
        data.qpos[:] = pose
        mujoco.mj_fwdPosition(model, data)
        for winch in winches:
            for name, branch in zip(winch.names, winch.burden.branches, strict=True):
                length = data.ten_length[model.tendon(branch.name).id]
                pose[model.joint(name).qposadr[0]] = length / winch.lever
        key.qpos = pose
        if getattr(original, "nplastic", 0):  # from MuJoCo 4.0
            key.plastic = _moved_plastic(original, model, winches, i)


def _moved_plastic(
    original: mujoco.MjModel, model: mujoco.MjModel, winches: list[Winch], key: int
) -> FloatArray:
    """Return a keyframe's plastic state, reordered from `original` to `model`."""
    before, after = _plastic_parts(original), _plastic_parts(model)
    for winch in winches:
        source = "tendon", winch.burden.index
        target = "tendon", model.tendon(winch.burden.winch).id
        if source in before:
            before[target] = before.pop(source)
    found = np.empty(model.nplastic)
    for part, own in after.items():
        found[own] = original.key_plastic[key][before[part]]
    return found


def _plastic_parts(model: mujoco.MjModel) -> dict[tuple[str, int], slice]:
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
