"""Ends that are implicit where the time step is long for them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cc_mujoco import Cable, Section, read
from cc_mujoco.errors import CableError
from cc_mujoco.plugin import cables, from_mjcf, settle, step_limits, to_mjcf
from study_marks import study_but

MODELS = Path(gymnasium.__file__).parent / "envs/mujoco/assets"
DRUM, LEVER = 0.03, 0.05
FINER = 32

LEG = """<mujoco><option timestep="{step}" integrator="{integrator}" cone="{cone}"/>
<worldbody><geom name="floor" type="plane" size="1 1 .1"/>
  <body name="drum"><joint name="drum" armature="{inertia}" damping="{damping}"/>
    <geom size=".01" mass=".01" contype="0" conaffinity="0"/></body>
  <body name="leg" pos="0 0 .3"><joint name="knee" axis="0 1 0" stiffness="20"/>
    <geom type="capsule" size=".03" fromto="0 0 0 .2 0 0" mass="{mass}"/>
    <geom name="foot" pos="{foot}" size=".05" mass=".1"/></body>
</worldbody>{more}</mujoco>"""
LOCK = '<equality><joint joint1="drum" polycoef="0 0 0 0 0"/></equality>'
SERVO = (
    '<actuator><position joint="drum" kp="50" kv="1"/></actuator>',
    "implicitfast",
)


def leg(
    step: float = 0.005,
    *,
    inertia: float = 2e-4,
    mass: float = 0.5,
    integrator: str = "Euler",
    cone: str = "pyramidal",
    damping: float = 0.01,
    foot: str = ".2 0 0",
    more: str = "",
    ends: str = "auto",
    friction: float = 0.1,
    length: float = 1.0,
    stiffness: float = 1.5e5,
    name: str = "cable",
) -> mujoco.MjModel:
    """Return a motor of an inertia [kg m^2] that pulls at a knee through a cable."""
    text = LEG.format(
        step=step, inertia=inertia, mass=mass, integrator=integrator, cone=cone,
        damping=damping, foot=foot, more=more,
    )  # fmt: skip
    spec = mujoco.MjSpec.from_string(text)
    cable = Cable(
        conduit=(Section(length, length / 3.0),),
        axial_stiffness=stiffness,
        friction=friction,
        pretension=100.0,
        segments=30,
        ends=ends,
    )
    to_mjcf(spec, name, cable, ("drum", DRUM), ("knee", LEVER))
    return spec.compile()


def end_tensions(m: mujoco.MjModel, d: mujoco.MjData) -> tuple[float, float]:
    """Tensions at the start of the last step, not at the last stage of RK4 [N]."""
    (name,) = cables(m)
    reading = read(m, d, name)
    return float(reading.tension_proximal), float(reading.tension_distal)


def pulled(m: mujoco.MjModel, seconds: float, push: float = 0.0) -> np.ndarray:
    """Both end tensions (steps, 2) [N] while the motor pulls, or the knee is pushed."""
    d = mujoco.MjData(m)
    settle(m, d)
    tension = np.empty((round(seconds / m.opt.timestep), 2))
    for i in range(len(tension)):
        swing = np.sin(2.0 * np.pi * d.time)
        if push:
            d.qfrc_applied[1] = LEVER * 100.0 + push * swing
        else:
            d.qfrc_applied[0] = -DRUM * (100.0 + 80.0 * swing)
        mujoco.mj_step(m, d)
        tension[i] = end_tensions(m, d)
    assert d.warning[mujoco.mjtWarning.mjWARN_BADQACC].number == 0
    return tension


def off_by(found: np.ndarray, fine: np.ndarray) -> float:
    """Largest RMS error of an end, as a part of its largest tension."""
    right = fine[::FINER]
    both = min(len(found), len(right))
    error = np.sqrt(((found[:both] - right[:both]) ** 2).mean(axis=0))
    return float((error / right.max(axis=0)).max())


CASES: dict[str, tuple[dict[str, Any], float]] = {
    "free": ({}, 0.0),
    "heavy": ({"mass": 3.0}, 0.0),
    "RK4": ({"integrator": "RK4"}, 0.0),
    "RK4, locked motor": ({"integrator": "RK4", "more": LOCK}, 2.0),
    "implicitfast": ({"integrator": "implicitfast"}, 0.0),
    "dampers": ({"damping": 1.0}, 0.0),
    "locked motor": ({"more": LOCK}, 2.0),
    "servo": ({"more": SERVO[0], "integrator": SERVO[1]}, 2.0),
    "on the ground": ({"foot": ".2 0 -.26"}, 0.0),
    "on the ground, elliptic": ({"foot": ".2 0 -.26", "cone": "elliptic"}, 0.0),
}


@pytest.mark.parametrize("case", study_but(3, CASES))
def test_tensions_at_a_long_step_are_those_at_a_short_one(case: str) -> None:
    given, push = CASES[case]
    given = {"step": 0.005} | given
    found = pulled(leg(**given), 1.0, push)
    fine = pulled(leg(**(given | {"step": given["step"] / FINER})), 1.0, push)
    assert off_by(found, fine) < 0.05


def test_explicit_ends_are_wrong_by_more_than_the_tension_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # for the log of MuJoCo's warnings
    found = pulled(leg(ends="explicit"), 0.5)
    fine = pulled(leg(0.005 / FINER, ends="explicit"), 0.5)
    assert off_by(found, fine) > 1.0


def test_under_discrete_ends_are_explicit_and_that_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its constraints are evaluated after the actuators, too late to look ahead."""
    monkeypatch.chdir(tmp_path)
    step = 0.9 * min(step_limits(leg())["cable"][:2])
    pulls = [
        pulled(leg(step, integrator="discrete", ends=ends), 0.05)
        for ends in ("auto", "explicit")
    ]
    assert np.array_equal(*pulls)
    m = leg(0.004, integrator="discrete")
    mujoco.mj_step(m, mujoco.MjData(m))
    assert "its proximal end is stable only" in Path("MUJOCO_LOG.TXT").read_text()


def test_a_short_step_takes_explicit_ends_bit_for_bit() -> None:
    step = 0.49 * min(step_limits(leg())["cable"][:2])
    assert np.array_equal(
        pulled(leg(step), 0.1), pulled(leg(step, ends="explicit"), 0.1)
    )


@settings(deadline=None, derandomize=True, max_examples=25)
@given(
    share=st.floats(0.6, 60.0),
    inertia=st.floats(1e-6, 1e-2),
    mass=st.floats(0.05, 5.0),
    friction=st.floats(0.0, 0.5),
    integrator=st.sampled_from(["Euler", "RK4", "implicit", "implicitfast"]),
    speed=st.floats(0.01, 0.5),
)
def test_no_step_gains_energy(
    share: float,
    inertia: float,
    mass: float,
    friction: float,
    integrator: str,
    speed: float,
) -> None:
    """Let go with a speed, motor and knee swing on the cable and lose it."""
    m = leg(
        inertia=inertia, mass=mass, friction=friction, integrator=integrator,
        damping=0.0,
    )  # fmt: skip
    m.opt.timestep = share * min(step_limits(m)["cable"][:2])
    m.opt.gravity[:] = 0.0
    m.jnt_stiffness[:] = 0.0
    m.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    # A constant force balances the pretension; its potential belongs to the energy.
    d.qfrc_applied[:] = -100.0 * DRUM, 100.0 * LEVER
    d.qvel[:] = speed, speed * DRUM / LEVER
    kinetic = np.empty(240)
    for i in range(kinetic.size):
        mujoco.mj_forward(m, d)
        kinetic[i] = d.energy[1]
        mujoco.mj_step(m, d)
    # Euler's positions and velocities are half a step apart, so that its kinetic energy
    # varies by up to 1 / (1 - s / 4), s = 2.5 of `_implicit_ends.py`. It does not grow.
    exact = integrator == "RK4"
    assert kinetic.max() <= (1.001 if exact else 8.0 / 3.0) * kinetic[0]
    assert kinetic[120:].max() <= 1.001 * kinetic[:120].max()
    # Friction has no more to take than what there was.
    lost = read(m, d, "cable").dissipated
    assert lost <= (1.1 if exact else 1.7) * kinetic[0]


@settings(deadline=None, derandomize=True, max_examples=4)
@given(
    share=st.floats(0.3, 0.95),
    inertia=st.floats(2e-4, 1e-2),
    mass=st.floats(0.1, 5.0),
    friction=st.floats(0.0, 0.5),
    integrator=st.sampled_from(["Euler", "RK4", "implicit", "implicitfast"]),
)
def test_ends_are_no_less_right_than_explicit_ones_where_those_are_stable(
    share: float, inertia: float, mass: float, friction: float, integrator: str
) -> None:
    given: dict[str, Any] = {
        "inertia": inertia,
        "mass": mass,
        "friction": friction,
        "integrator": integrator,
    }
    limit = min(step_limits(leg(**given))["cable"][:2])
    step = share * limit * (np.sqrt(2.0) if integrator == "RK4" else 1.0)
    fine = pulled(leg(step / FINER, **given), 0.12)
    own, explicit = (
        off_by(pulled(leg(step, ends=ends, **given), 0.12), fine)
        for ends in ("auto", "explicit")
    )
    assert own <= 1.05 * explicit + 1e-3


def at_joint(
    name: str, joint: str, armature: float, angle: float, ends: str, step: float
) -> tuple[np.ndarray, float]:
    """Return end tensions of a motor on a joint of Gymnasium [N], and its heat [J].

    During a second, with the torso held and no contacts. `step` is over the model's.
    """
    spec = mujoco.MjSpec.from_file(str(MODELS / f"{name}.xml"))
    for root in list(spec.worldbody.bodies[0].joints):
        spec.delete(root)
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    motor = spec.worldbody.add_body(name="motor", mass=0.1, inertia=[1e-6] * 3)
    motor.add_joint(name="motor", armature=armature, limited=0, stiffness=0, damping=0)
    cable = Cable(
        conduit=(Section(1.0, 0.32),),
        axial_stiffness=5e4,
        friction=0.1,
        pretension=100.0,
        ends=ends,
    )
    to_mjcf(spec, "cable", cable, ("motor", DRUM), (joint, LEVER))
    for end in ("proximal", "distal"):
        spec.actuator(f"cable_{end}").forcelimited = 0
    m = spec.compile()
    m.opt.timestep *= step
    d = mujoco.MjData(m)
    d.joint(joint).qpos[:] = angle
    settle(m, d)
    dof = m.joint("motor").dofadr[0]
    series = np.empty((round(1.0 / m.opt.timestep), 2))
    for i in range(len(series)):
        swing = 80.0 * np.sin(2.0 * np.pi * d.time)
        d.qfrc_applied[dof] = -DRUM * (100.0 + swing)
        mujoco.mj_step(m, d)
        series[i] = end_tensions(m, d)
    return series, float(read(m, d, "cable").dissipated)


@pytest.mark.filterwarnings("ignore:compiler attribute:UserWarning")
@pytest.mark.parametrize(
    ("name", "joint", "armature", "angle", "most"),
    [
        ("half_cheetah", "bfoot", 2e-3, 0.0, 0.03),
        ("ant", "ankle_1", 2e-4, 0.0, 0.06),
        pytest.param("ant", "ankle_1", 2e-3, 0.0, 0.08, marks=pytest.mark.study),
        ("ant", "ankle_1", 2e-2, 0.0, 0.1),
        ("ant", "ankle_1", 5e-3, 0.87, 0.03),
    ],
)
def test_a_model_of_other_makers_at_its_own_step(
    name: str, joint: str, armature: float, angle: float, most: float
) -> None:
    """Models of Gymnasium at their 10 ms; the ant is under RK4.

    At 0 its ankle is out of its range of 0.52 to 1.22 rad, and MuJoCo throws it back
    within a few steps.
    """
    given = (name, joint, armature, angle, "auto")
    found, taken = at_joint(*given, 1.0)
    fine, heat = at_joint(*given, 1.0 / FINER)
    assert off_by(found, fine) < most
    assert taken == pytest.approx(heat, rel=max(0.1, 1.25 * most))


@pytest.mark.study
@pytest.mark.filterwarnings("ignore:compiler attribute:UserWarning")
@pytest.mark.parametrize("armature", [2e-4, 2e-3, 5e-3, 2e-2])
@pytest.mark.parametrize("joint", ["ankle_1", "hip_1", "ankle_2", "hip_4"])
def test_under_rk4_ends_converge_where_explicit_ones_are_stable_and_beyond(
    joint: str, armature: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At 10, 5, 2.5 and 1.25 ms, beyond the limit of ends that friction holds.

    The ankles are thrown into slack. Explicit ends that stay bounded then err by up to
    2.4 % less at 10 ms, but give out more energy there.
    """
    monkeypatch.chdir(tmp_path)  # for the log of MuJoCo's warnings
    fine, _ = at_joint("ant", joint, armature, 0.0, "explicit", 1.0 / 256.0)
    errors = {}
    for ends in ("auto", "explicit"):
        for share in (1, 2, 4, 8):
            found, _ = at_joint("ant", joint, armature, 0.0, ends, 1.0 / share)
            right = fine[:: 256 // share][: len(found)]
            error = np.sqrt(((found - right) ** 2).mean(axis=0)) / fine.max(axis=0)
            errors[ends, share] = float(error.max())
    print(joint, armature, errors)
    assert errors["auto", 1] < 0.1
    assert errors["auto", 2] < 0.07
    for share in (1, 2, 4, 8):
        own, explicit = errors["auto", share], errors["explicit", share]
        assert own <= 1.2 * explicit + 0.025
    assert errors["auto", 8] < 0.5 * errors["auto", 1] + 0.01


@pytest.mark.parametrize("seed", study_but(2, range(12)))
def test_a_tension_that_errs_by_a_tenth_is_warned_of(
    seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cables of 10 kN to 100 MN on motors of 1e-5 to 1e-2 kg m^2, at 0.5 to 10 ms."""
    monkeypatch.chdir(tmp_path)
    random = np.random.default_rng(seed)
    given: dict[str, Any] = {
        "stiffness": 10.0 ** random.uniform(4.0, 8.0),
        "inertia": 10.0 ** random.uniform(-5.0, -2.0),
        "mass": 10.0 ** random.uniform(-1.0, 0.7),
        "friction": random.choice([0.1, 0.2, 0.3]),
        "integrator": random.choice(["Euler", "RK4", "implicitfast"]),
        "length": random.uniform(0.5, 2.0),
        "name": f"drawn_{seed}",
    }
    step = 10.0 ** random.uniform(-3.3, -2.0)
    found = pulled(leg(step, **given), 0.3)
    fine = pulled(leg(step / 10.0, **(given | {"name": "fine"})), 0.3)
    right = fine[::10][: len(found)]
    error = np.sqrt(((found[: len(right)] - right) ** 2).mean(axis=0))
    log = Path("MUJOCO_LOG.TXT")
    said = log.read_text() if log.exists() else ""
    warned = f"'drawn_{seed}': the period of its ends is" in said
    assert warned or (error / right.max(axis=0)).max() < 0.1


PATHS = {
    "guided": ('joint="arm" gear="-0.05"', {"conduit": "0.8:0.3 0.4:inf"}),
    "open": ('tendon="t" gear="1"', {"conduit": "1.2:inf", "route": "t"}),
    "mixed": (
        'tendon="t" gear="1"',
        {"conduit": "0.8:0.3", "route": "t", "mouth": "m"},
    ),
}


@pytest.mark.parametrize("inertia", [1e-4, 1e-3, 1e-2])
@pytest.mark.parametrize("path", PATHS)
def test_a_rope_of_ten_meganewtons_is_warned_of_at_one_millisecond(
    path: str, inertia: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    distal, keys = PATHS[path]
    name = f"stiff_{path}_{inertia}"
    config = keys | {
        "path": path, "axial_stiffness": "1e7", "pretension": "50", "friction": "0.15",
        "segments": "8",
    }  # fmt: skip
    lines = "".join(f'<config key="{k}" value="{v}"/>' for k, v in config.items())
    ends = "".join(
        f'<plugin {end} plugin="cc_mujoco.cable" instance="{name}"/>'
        for end in ('joint="drum" gear="-0.02"', distal)
    )
    m = mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="0.001"/>
    <extension><plugin plugin="cc_mujoco.cable"><instance name="{name}">{lines}
    </instance></plugin></extension><worldbody><site name="a"/>
    <site name="m" pos="0.8 0 0"/>
    <body><joint name="drum" axis="0 1 0" armature="{inertia}"/>
    <geom size="0.01" mass="0.05"/></body><body pos="1.2 0 -0.1">
    <joint name="arm" axis="0 1 0" damping="0.02" stiffness="2"/>
    <geom size="0.05" mass="{500 * inertia}" pos="0.1 0 0"/>
    <site name="b" pos="0 0 0.05"/></body></worldbody><tendon><spatial name="t">
    <site site="a"/><site site="m"/><site site="b"/></spatial></tendon>
    <actuator>{ends}</actuator></mujoco>""")
    mujoco.mj_step(m, mujoco.MjData(m), 5)
    warned = Path("MUJOCO_LOG.TXT").read_text()
    assert f"'{name}': the period of its ends is " in warned


def test_ends_are_told_in_words() -> None:
    cable = Cable(ends="explicit")
    assert Cable.from_config(cable.to_config()) == cable
    assert from_mjcf(leg(ends="explicit"))["cable"].ends == "explicit"
    with pytest.raises(CableError, match="`ends` is 'implicit'; it must be `auto`"):
        Cable(ends="implicit")


def test_cables_that_pass_the_limit_only_together_stay_explicit_and_are_warned_of() -> (
    None
):
    alone = min(step_limits(leg())["cable"])
    found, said = [], []
    mujoco.set_mju_user_warning(said.append)
    for ends in ("auto", "explicit"):
        m = leg(0.4 * alone, ends=ends)
        spec = mujoco.MjSpec.from_string(
            LEG.format(
                step=0.4 * alone, inertia=2e-4, mass=0.5, integrator="Euler",
                cone="pyramidal", damping=0.01, foot=".2 0 0", more="",
            )
        )  # fmt: skip
        for n in range(12):
            to_mjcf(
                spec, f"c{n}", from_mjcf(m)["cable"], ("drum", DRUM), ("knee", LEVER)
            )
        m = spec.compile()
        assert step_limits(m)["c3"][0] < m.opt.timestep
        d = mujoco.MjData(m)
        settle(m, d)
        for _ in range(30):
            d.qfrc_applied[0] = -DRUM * 12.0 * 100.0
            mujoco.mj_step(m, d)
        found.append(d.qpos.copy())
    mujoco.set_mju_user_warning(None)
    assert found[0].tobytes() == found[1].tobytes()
    assert sum("its proximal end is stable only with" in text for text in said) == 24
