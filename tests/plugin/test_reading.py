"""Readings agree with MuJoCo's sensors, with arrays of a batch, with the geometry."""

from __future__ import annotations

import math

import mujoco
import mujoco.batch
import numpy as np
import pytest

from cc_mujoco.errors import CableError
from cc_mujoco.plugin import cables, from_mjcf, read, read_state, route, route_wrap
from plugin.scenes import (
    CONFIG,
    build,
    end,
    excitation,
    instance,
    model,
    pull_pull,
    run,
)

SENSORS = """<sensor>
  <actuatorfrc name="near" actuator="flexor_proximal"/>
  <actuatorfrc name="far" actuator="flexor_distal"/>
</sensor>"""


def test_sensors_and_readings_agree() -> None:
    m, d = build(pull_pull(extra=SENSORS))
    run(m, d, excitation(300))
    reading = read(m, d, "flexor")
    assert d.sensor("near").data[0] == reading.tension_proximal
    assert d.sensor("far").data[0] == -reading.tension_distal
    assert reading.tension.shape == (11,)
    assert reading.slip.shape == (10,)
    assert reading.slip.dtype == np.int8
    assert reading.tension[0] == reading.tension_proximal
    assert reading.tension[-1] == reading.tension_distal
    assert reading.moving_fraction == np.mean(reading.slip != 0)
    assert reading.dissipated > 0.0
    assert all(
        type(getattr(reading, name)) is float
        for name in ("tension_proximal", "moving_fraction", "slack", "dissipated")
    )
    kept = reading.tension.copy()
    run(m, d, excitation(20))
    assert np.array_equal(reading.tension, kept)


def test_direction_of_slip_and_slack() -> None:
    m, d = build(pull_pull())
    d.qpos[0] = 0.5  # the motor winds up 10 mm of the flexor and pays out the extensor
    mujoco.mj_step(m, d)
    flexor, extensor = read(m, d, "flexor"), read(m, d, "extensor")
    assert flexor.slip[0] == -1  # toward the motor
    assert flexor.tension_proximal > 20.0 > 10.0 > extensor.tension_proximal
    assert extensor.tension_proximal == 0.0
    # 10 mm of cable too much, less what its pretension had stretched and still holds.
    assert 0.004 < extensor.slack < 0.01
    assert flexor.slack == 0.0


def test_arrays_of_a_batch() -> None:
    m, _ = build(pull_pull())
    batch = mujoco.batch.Batch(m, 5)
    ctrl, state = batch.bind("ctrl"), batch.bind("plugin_state")
    ctrl[:, 0] = np.linspace(-1.0, 1.0, 5)
    batch.step(nstep=100)
    together = read_state(m, "extensor", state)
    assert together.tension.shape == (5, 11)
    d = mujoco.MjData(m)
    for i in range(5):
        d.plugin_state[:] = state[i]
        single = read(m, d, "extensor")
        assert np.array_equal(together.tension[i], single.tension)
        assert np.array_equal(together.slip[i], single.slip)
        for name in ("tension_proximal", "tension_distal", "moving_fraction",
                     "slack", "dissipated"):  # fmt: skip
            assert getattr(together, name)[i] == pytest.approx(getattr(single, name))
    with pytest.raises(CableError, match="numbers per simulation"):
        read_state(m, "extensor", state[:, 1:])


def test_unknown_names_are_refused() -> None:
    m, d = build(pull_pull())
    with pytest.raises(CableError, match="did you mean 'flexor'"):
        read(m, d, "flexer")
    with pytest.raises(CableError, match="no route"):
        route(m, d, "flexor")
    assert cables(mujoco.MjModel.from_xml_string("<mujoco/>")) == ()


BENT = """
<mujoco>
  <extension><plugin plugin="cc_mujoco.cable">{instance}</plugin></extension>
  <worldbody>
    <geom name="post" type="cylinder" size="0.2 0.5"/>
    <site name="a" pos="-1 0.2 0"/><site name="b" pos="0.2 -1 0"/>
    <site name="outside" pos="0.4 0.4 0"/>
    <body><joint name="j"/><geom size="0.1"/></body>
    <body><joint name="k"/><geom size="0.1"/></body>
  </worldbody>
  <tendon><spatial name="path">
    <site site="a"/><geom geom="post" sidesite="outside"/><site site="b"/>
  </spatial></tendon>
  <actuator>{proximal}{distal}</actuator>
</mujoco>"""


def test_route_follows_the_tendon_around_geoms() -> None:
    m, d = build(
        BENT.format(
            instance=instance("bowden", CONFIG | {"route": "path"}),
            proximal=end("near", "bowden", 'joint="j"', -0.1),
            distal=end("far", "bowden", 'joint="k"', -0.1),
        )
    )
    mujoco.mj_forward(m, d)
    points = route(m, d, "bowden")
    assert points.shape == (4, 3)
    assert np.allclose(points, [[-1, 0.2, 0], [0, 0.2, 0], [0.2, 0, 0], [0.2, -1, 0]])
    assert route_wrap(m, d, "bowden") == pytest.approx(math.pi / 2)
    assert d.ten_length[0] == pytest.approx(2.0 + 0.1 * math.pi)
    assert from_mjcf(m)["bowden"].route == "path"


def test_a_route_that_is_not_drawn_is_refused_by_the_model() -> None:
    with pytest.raises(ValueError, match="`route` is 'gone'"):
        build(
            model(
                instance("bowden", CONFIG | {"route": "gone"}),
                end("near", "bowden", 'joint="motor"', -0.1)
                + end("far", "bowden", 'joint="wrist"', -0.1),
            )
        )
