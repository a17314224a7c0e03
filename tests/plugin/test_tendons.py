"""Friction added to tendons on models that are not ours."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest

import cc_mujoco
from cc_mujoco.errors import CableError
from cc_mujoco.plugin import from_mjcf, read
from plugin.tendon_chain import Chain

ASSETS = Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets"
CABLE = {"axial_stiffness": 20000.0, "pretension": 20.0}

ARM = (
    "reacher.xml",
    {"near": ("world", (-0.03, 0.03, 0.01)), "by": ("body0", (0.03, 0.015, 0.0)),
     "on": ("body0", (0.085, 0.014, 0.0)), "tip": ("body1", (0.06, 0.012, 0.0))},
    {"joint0": (0.6, 0.5), "joint1": (0.8, 0.9)},
)  # fmt: skip
"""Model, sites by name with body and place, amplitude and pace of joints."""
EXOSUIT = (
    "humanoid.xml",
    {"waist": ("pelvis", (0.09, -0.1, 0.0)),
     "thigh_top": ("right_thigh", (0.09, 0.01, -0.1)),
     "thigh_low": ("right_thigh", (0.07, 0.01, -0.28)),
     "shin": ("right_shin", (0.07, 0.0, -0.12))},
    {"right_hip_y": (0.5, 1.0), "right_knee": (0.6, 1.9)},
)  # fmt: skip


def with_tendon(
    case: tuple, friction: float | None
) -> tuple[mujoco.MjModel, dict[str, tuple[float, float]], list[str]]:
    """Return the model with a winch, sites and a tendon over them."""
    file, sites, joints = case
    spec = mujoco.MjSpec.from_file(str(ASSETS / file))
    spec.option.timestep = 5e-4
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    winch = spec.worldbody.add_body(name="winch", mass=0.1, inertia=[1e-4] * 3)
    winch.add_joint(name="winch", limited=mujoco.mjtLimited.mjLIMITED_FALSE)
    tendon = spec.add_tendon(name="cord")
    for name, (body, place) in sites.items():
        (spec.worldbody if body == "world" else spec.body(body)).add_site(
            name=name, pos=place
        )
        tendon.wrap_site(name)
    if friction is not None:
        cc_mujoco.add_friction(
            spec, "cord", motor=("winch", 0.02), friction=friction, **CABLE
        )
    return spec.compile(), joints, list(sites)


def poses(m: mujoco.MjModel, joints: dict[str, tuple[float, float]]) -> np.ndarray:
    """Return a motion of these joints and of the winch, (steps, nq)."""
    out = np.tile(m.qpos0, (400, 1))
    for row, t in zip(out, np.linspace(0.0, 6.0, 400), strict=True):
        for name, (size, pace) in joints.items():
            row[m.joint(name).qposadr[0]] = -size * (1.0 - math.cos(pace * t)) / 2
    data = mujoco.MjData(m)
    lengths = []
    for row in out:
        data.qpos[:] = row
        mujoco.mj_fwdPosition(m, data)
        lengths.append(data.tendon("cord").length[0])
    drawn = np.array(lengths) - lengths[0]
    pull = 0.003 * (1.0 - np.cos(np.linspace(0.0, 25.0, 400)))
    out[:, m.joint("winch").qposadr[0]] = (pull - drawn) / 0.02
    return out


@pytest.mark.parametrize("friction", [0.1, 0.2, 0.3])
@pytest.mark.parametrize("case", [ARM, EXOSUIT], ids=["arm", "exosuit"])
def test_every_joint_of_a_public_model_feels_its_own_pieces(
    case: tuple, friction: float
) -> None:
    m, joints, sites = with_tendon(case, friction)
    bare = with_tendon(case, None)[0]
    d, e = mujoco.MjData(m), mujoco.MjData(bare)
    mujoco.mj_forward(bare, e)
    referee = Chain(
        bare, e, sites, stiffness=20000.0, pretension=20.0, friction=friction
    )
    felt, true, single = [], [], []
    dofs = [int(m.joint(name).dofadr[0]) for name in joints]
    for pose in poses(m, joints):
        d.qpos[:], d.qvel[:] = pose, 0.0
        e.qpos[:], e.qvel[:] = pose, 0.0
        mujoco.mj_step(m, d)
        mujoco.mj_forward(bare, e)
        wound = 0.02 * pose[m.joint("winch").qposadr[0]]
        tension = referee.tension(e, wound)
        felt.append((d.qfrc_actuator + d.qfrc_passive - e.qfrc_passive)[dofs])
        true.append(referee.torque(e, tension)[dofs])
        single.append(referee.torque(e, np.full(len(tension), tension[-1]))[dofs])
    felt, true, single = np.array(felt), np.array(true), np.array(single)
    error = np.sqrt(np.mean((felt - true) ** 2, axis=0)) / np.abs(true).max(axis=0)
    naive = np.sqrt(np.mean((single - true) ** 2, axis=0)) / np.abs(true).max(axis=0)
    assert np.all(error < 0.02)
    # One tension for the whole tendon, as MuJoCo's own tendons have.
    assert naive.max() > 2.0 * error.max()


def test_the_cable_is_as_long_and_bends_as_the_tendon() -> None:
    m, _, sites = with_tendon(ARM, 0.2)
    cable = from_mjcf(m)["cord"]
    assert cable.path == "open"
    assert cable.segments == len(sites) - 2
    assert cable.length == pytest.approx(m.tendon_length0[0])
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    assert cable.wrap == pytest.approx(cc_mujoco.plugin.route_wrap(m, d, "cord"))
    assert read(m, d, "cord").tension == pytest.approx(20.0)


def spec_of(case: tuple = ARM) -> mujoco.MjSpec:
    spec = mujoco.MjSpec.from_file(str(ASSETS / case[0]))
    tendon = spec.add_tendon(name="cord")
    for name, place in (("one", 0.01), ("two", 0.05)):
        spec.body("body1").add_site(name=name, pos=[place, 0, 0])
        tendon.wrap_site(name)
    return spec


def test_what_cannot_be_is_refused_in_one_sentence() -> None:
    with pytest.raises(CableError, match=r"tendon 'chord'.*did you mean `?'?cord"):
        cc_mujoco.add_friction(spec_of(), "chord", friction=0.1)
    wrong: Any = "w"
    for motor in (wrong, (0.02, wrong)):
        with pytest.raises(CableError, match="motor must be a joint and the radius"):
            cc_mujoco.add_friction(spec_of(), "cord", friction=0.1, motor=motor)
    for end in ("motor", "joint"):
        spec = spec_of()
        sled = spec.worldbody.add_body(mass=0.1, inertia=[1e-4] * 3)
        sliding = sled.add_joint(name="sled", type=mujoco.mjtJoint.mjJNT_SLIDE)
        for drum in ("sled", sliding):
            ends: dict[str, Any] = {end: (drum, 0.02)}
            with pytest.raises(CableError, match=f"{end} must be a hinge.*'sled'"):
                cc_mujoco.add_friction(spec, "cord", friction=0.1, **ends)
    with pytest.raises(CableError, match="spec must be a MjSpec, not 'w'"):
        cc_mujoco.add_friction(wrong, "cord", friction=0.1)
    with pytest.raises(CableError, match="add_friction needs friction="):
        cc_mujoco.add_friction(spec_of(), "cord")
    with pytest.raises(CableError, match="cable parameter 'mu'"):
        cc_mujoco.add_friction(spec_of(), "cord", friction=0.1, mu=0.2)


def pulled(spec: mujoco.MjSpec) -> None:
    actuator = spec.add_actuator(name="pull", target="cord")
    actuator.trntype = mujoco.mjtTrn.mjTRN_TENDON


def nameless(spec: mujoco.MjSpec) -> None:
    pulled(spec)
    spec.actuators[-1].name = ""


def equated(spec: mujoco.MjSpec) -> None:
    spec.add_equality(
        type=mujoco.mjtEq.mjEQ_TENDON, objtype=mujoco.mjtObj.mjOBJ_TENDON, name1="cord"
    )


def given(name: str, value: Any) -> Callable[[mujoco.MjSpec], None]:
    return lambda spec: setattr(spec.tendon("cord"), name, value)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (pulled, "actuator 'pull' pulls its tendon as a whole"),
        (nameless, r"actuator \d pulls its tendon as a whole"),
        (given("stiffness", [100.0, 0.0, 0.0]), "its tendon has a `stiffness` of its"),
        (given("damping", [10.0, 0.0, 0.0]), "its tendon has a `damping` of its own"),
        (given("frictionloss", 2.0), "its tendon has a `frictionloss` of its own"),
        (given("range", [0.0, 1.0]), "its tendon has a `range` of its own"),
        (given("armature", 5.0), "its tendon has an `armature` of its own"),
        (equated, "its tendon has an equality of its own"),
    ],
)
def test_nothing_pulls_a_cable_as_a_whole_later(
    change: Callable[[mujoco.MjSpec], None], told: str
) -> None:
    later = spec_of()
    cc_mujoco.add_friction(later, "cord", friction=0.1)
    later.copy().compile()
    change(later)
    with pytest.raises(ValueError, match=told):
        later.compile()
