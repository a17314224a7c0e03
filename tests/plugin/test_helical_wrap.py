"""Joint torque of a driven tendon that climbs on a cylinder, by virtual work."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

import cc_mujoco

RADIUS, PULL, FRICTION = 0.03, 20.0, 0.3


def climbing(offset: float) -> mujoco.MjSpec:
    """Return an arm whose tendon leaves a post by `offset` along its axis [m]."""
    return mujoco.MjSpec.from_string(
        f"""<mujoco><option timestep="1e-3" gravity="0 0 0"
        integrator="implicitfast"/><worldbody>
        <geom name="post" type="cylinder" size="{RADIUS} .3" zaxis="0 1 0"
          pos=".1 0 .05" contype="0" conaffinity="0"/><site name="above" pos=".1 0 .2"/>
        <site name="a" pos="0 {-offset} .02"/><body pos=".2 0 0">
        <joint name="knee" axis="0 1 0" damping="2" stiffness="4"/>
        <geom size=".05" mass=".3" pos=".1 0 0" contype="0" conaffinity="0"/>
        <site name="b" pos=".03 {offset} .03"/></body></worldbody>
        <tendon><spatial name="t"><site site="a"/><geom geom="post" sidesite="above"/>
        <site site="b"/></spatial></tendon>
        <actuator><motor tendon="t" gear="-1"/></actuator></mujoco>"""
    )


def turn_of_helix(data: mujoco.MjData) -> float:
    """Return by how much the path turns on the post, from its first and last point."""
    first, last = data.wrap_xpos.reshape(-1, 3)[1:3] - [0.1, 0.0, 0.05]
    cosine = (first[0] * last[0] + first[2] * last[2]) / RADIUS**2
    wrap = math.acos(min(max(cosine, -1.0), 1.0))
    climb = abs(last[1] - first[1]) / (RADIUS * wrap)
    return wrap / math.sqrt(1.0 + climb * climb)


@pytest.mark.parametrize("offset", [0.0, 0.03, 0.1])
def test_a_tendon_that_climbs_on_a_post_pulls_by_its_last_piece(offset: float) -> None:
    """On a post that stands still, the joint moves the last piece alone."""
    spec = climbing(offset)
    plain = spec.compile()
    cc_mujoco.add_friction(spec, "t", friction=FRICTION)
    model = spec.compile()
    data, probe = mujoco.MjData(model), mujoco.MjData(plain)
    compared = 0
    for step in range(600):
        data.ctrl[0] = PULL * (1.0 + step / 600)
        mujoco.mj_fwdPosition(model, data)
        angle, turn = float(data.joint("knee").qpos[0]), turn_of_helix(data)
        mujoco.mj_step(model, data)
        if step < 300 or step % 50:
            continue
        lengths = []
        for shift in (-1e-5, 1e-5):
            probe.qpos[0] = angle + shift
            mujoco.mj_fwdPosition(plain, probe)
            lengths.append(float(probe.ten_length[0]))
        arm = (lengths[1] - lengths[0]) / 2e-5
        dof = model.joint("knee").dofadr[0]
        found = data.qfrc_passive[dof] + data.qfrc_actuator[dof]
        found += 4.0 * angle + 2.0 * data.qvel[dof]
        right = -data.ctrl[0] * math.exp(-FRICTION * turn) * arm
        assert turn > 0.5
        assert found == pytest.approx(right, rel=0.02)
        compared += 1
    assert compared == 6
    assert np.isfinite(data.qpos).all()
