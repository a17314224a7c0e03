"""Ends of cables on fixed tendons, whose lengths and moments are MuJoCo's."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

import cc_mujoco
from cc_mujoco import (
    Cable,
    Device,
    Plant,
    Section,
    cli,
    from_mjcf,
    read,
    simulate,
    to_mjcf,
)
from cc_mujoco.datasets import Bench
from cc_mujoco.errors import CableError
from cc_mujoco.plugin import step_limits
from cc_mujoco.viz._cable_lines import cable_lines

EXAMPLE = Path(cc_mujoco.__file__).parents[1] / "scripts/examples/differential.xml"
ARMS = np.array([[-0.06, -0.04], [-0.06, 0.04]])
"""Moments of both cables at hip and knee [m], as in the scene."""
DRUM = 0.02
LEG = """<mujoco><option timestep="{step}" gravity="0 0 0"/>
<default><geom contype="0" conaffinity="0"/></default><worldbody>
  <body pos="-.3 0 0"><joint name="a" armature="2e-3"/>
    <geom size=".01" mass=".01"/></body>
  <body pos="-.3 .1 0"><joint name="b" armature="2e-3"/>
    <geom size=".01" mass=".01"/></body>
  <body><joint name="hip" axis="0 1 0" stiffness="20"/>
    <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".05" mass="6"/>
    <body pos="0 0 -.4"><joint name="knee" axis="0 1 0" stiffness="20" {knee}/>
      <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".04" mass="3"/></body></body>
</worldbody><tendon>
  <fixed name="sum"><joint joint="hip" coef="{arm}"/>
    <joint joint="knee" coef="-.04"/></fixed>
  <fixed name="difference"><joint joint="hip" coef="-.06"/>
    <joint joint="knee" coef=".04"/></fixed>
  <fixed name="hip"><joint joint="hip" coef="-.06"/></fixed>
</tendon><actuator>
  <motor name="a" joint="a"/><motor name="b" joint="b"/></actuator></mujoco>"""
CABLE = Cable(
    conduit=(Section(0.7, 0.5),), axial_stiffness=4e4, friction=0.1, pretension=80.0
)


def leg(
    *ends: str, step: float = 2e-4, arm: float = -0.06, knee: str = "", **changes: float
) -> mujoco.MjSpec:
    """Return a leg with a cable from motors `a`, `b` to tendons or joints by name."""
    spec = mujoco.MjSpec.from_string(LEG.format(step=step, arm=arm, knee=knee))
    for motor, end in zip("ab", ends, strict=False):
        target = (spec.tendon(end), 1.0) if spec.tendon(end) else (end, -0.06)
        if end == "joint":
            target = (spec.joint("hip"), -0.06)
        to_mjcf(spec, end, CABLE.replace(**changes), (motor, -DRUM), target)
    return spec


def drive(model: mujoco.MjModel, seconds: float):
    """Yield the data after every step while the motors wind to and fro."""
    data = mujoco.MjData(model)
    for k in range(round(seconds / model.opt.timestep)):
        time = k * model.opt.timestep
        data.ctrl[:2] = 2.0 + np.sin(7.0 * time), 2.0 - np.sin(9.0 * time)
        mujoco.mj_step(model, data)
        yield data


@pytest.mark.parametrize("step", [2e-4, 5e-3])
def test_a_differential_pulls_by_its_moments_transposed(step: float) -> None:
    model = leg("sum", "difference", step=step).compile()
    limits = step_limits(model, mujoco.MjData(model)).values()
    is_implicit = any(min(each.proximal, each.distal) < step / 0.8 for each in limits)
    assert is_implicit == (step > 1e-3)
    moved, hips = np.zeros(2), [model.joint(name).dofadr[0] for name in ("hip", "knee")]
    for data in drive(model, 1.0):
        cables = [read(model, data, name) for name in ("sum", "difference")]
        pull = -np.array([cable.tension_distal for cable in cables])
        np.testing.assert_allclose(
            data.qfrc_actuator[hips], ARMS.T @ pull, rtol=1e-9, atol=1e-9
        )
        moved = np.maximum(moved, np.abs(data.qpos[hips]))
    assert np.all(moved > 0.02)


@pytest.mark.parametrize("step", [2e-4, 5e-3])
@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
def test_a_fixed_tendon_of_one_joint_is_a_pulley_on_it(
    step: float, integrator: str
) -> None:
    runs = []
    for end in ("hip", "joint"):
        spec = leg(end, step=step)
        spec.option.integrator = getattr(
            mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}"
        )
        model = spec.compile()
        runs.append([(*data.qpos, *data.actuator_force) for data in drive(model, 0.5)])
    np.testing.assert_allclose(*runs, rtol=1e-9, atol=1e-9)


def test_motors_give_what_moves_stretches_and_rubs() -> None:
    model = leg("sum", "difference", step=2e-5).compile()
    dofs = [model.joint(name).dofadr[0] for name in "ab"]
    work, most, before = 0.0, 0.0, np.zeros(2)
    stretch = 0.7 / CABLE.segments / CABLE.axial_stiffness  # m/N of a segment

    def stored(data: mujoco.MjData) -> float:
        total = sum(data.energy)
        for name in ("sum", "difference"):
            # Mean of T^2 along a segment between its nodes.
            t = read(model, data, name).tension
            square = (t[1:] ** 2 + t[1:] * t[:-1] + t[:-1] ** 2) / 3.0
            total += 0.5 * stretch * np.sum(square)
        return float(total)

    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    start = mujoco.MjData(model)
    mujoco.mj_forward(model, start)
    for data in drive(model, 0.5):
        work += float(data.ctrl[:2] @ (data.qpos[dofs] - before))
        before = data.qpos[dofs].copy()
        most = max(most, work)
    mujoco.mj_forward(model, data)
    heat = sum(read(model, data, n).dissipated for n in ("sum", "difference"))
    assert heat > 0.03 * most
    assert work == pytest.approx(stored(data) - stored(start) + heat, abs=0.01 * most)


def test_an_attached_copy_moves_as_the_original() -> None:
    alone, parent = leg("sum", "difference"), mujoco.MjSpec()
    parent.option.timestep, parent.option.gravity = alone.option.timestep, [0, 0, 0]
    for place, prefix in enumerate(("left_", "right_")):
        frame = parent.worldbody.add_frame(pos=[place, 0, 0])
        parent.attach(leg("sum", "difference"), prefix=prefix, frame=frame)
    both, one = parent.compile(), alone.compile()
    assert [*from_mjcf(both)] == [
        f"{side}_{name}" for side in ("left", "right") for name in ("sum", "difference")
    ]
    data, whole = mujoco.MjData(one), mujoco.MjData(both)
    for _ in range(500):
        for motor, torque in (("a", 3.0), ("b", 1.0)):
            data.actuator(motor).ctrl = torque
            for side in ("left", "right"):
                whole.actuator(f"{side}_{motor}").ctrl = torque
        mujoco.mj_step(one, data)
        mujoco.mj_step(both, whole)
    np.testing.assert_allclose(whole.qpos, [*data.qpos, *data.qpos], rtol=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"arm": -1.0}, "times `coef` of a fixed tendon, must be the signed pulley"),
        ({"knee": 'actuatorfrcrange="-5 5"'}, "pulls a joint that has an `actuator"),
    ],
)
def test_an_arm_of_a_metre_or_a_clamped_joint_is_refused(
    change: dict, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        leg("sum", "difference", **change).compile()


def test_the_example_holds_both_torques_only_if_it_is_decoupled() -> None:
    device = Device(EXAMPLE)
    errors = {}
    for law in ("pi_tuned", "decoupled_pi_tuned"):
        log = simulate(device, law, duration=1.5)
        late = log["time_s"] > 0.5
        errors[law] = [
            np.sqrt(
                np.mean((own["joint_torque_nm"] - own["desired_torque_nm"])[late] ** 2)
            )
            for _, own in log.each_axis()
        ]
        pull = [log[f"tension_{name}_distal_n"] for name in ("extensor", "flexor")]
        torque = [own["joint_torque_nm"] for _, own in log.each_axis()]
        np.testing.assert_allclose(
            np.array(torque)[:, 1:],
            -ARMS.T @ np.array(pull)[:, 1:],
            rtol=1e-5,
            atol=1e-5,
        )
    assert np.all(np.array(errors["decoupled_pi_tuned"]) < 0.3)
    assert np.all(np.array(errors["pi_tuned"]) > 1.5)


def test_the_example_is_a_bench_and_can_be_exported(tmp_path: Path) -> None:
    hip = Bench.of(EXAMPLE, axis="hip")
    assert (hip.joint_radius, hip.others) == (pytest.approx(0.06), ("knee",))
    knee = Bench.of(EXAMPLE, axis="knee")
    assert (knee.joint_radius, knee.others) == (pytest.approx(0.04), ("hip",))
    words = ["export", str(EXAMPLE), "--controller", "decoupled_pi_tuned", "--no-check"]
    assert cli.main([*words, "--out", str(tmp_path / "c")]) == 0
    assert list((tmp_path / "c").glob("*.c"))


def test_an_end_without_a_drawn_route_is_drawn_at_a_joint() -> None:
    model = leg("sum", "difference").compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    (line,) = cable_lines(model, ["sum"])
    np.testing.assert_allclose(line.points(model, data)[-1], data.joint("hip").xanchor)


def test_a_radius_that_is_a_coefficient_is_not_varied() -> None:
    with pytest.raises(
        CableError, match=r"'joint_radius' cannot be varied.*'extensor'"
    ):
        Plant(EXAMPLE, {"hip.joint_radius": 0.05}).check()
