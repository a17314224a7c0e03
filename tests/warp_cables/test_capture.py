"""Evaluations that are captured once and replayed, as a GPU does with a graph.

Warp records on a processor too: launches with their arguments, and nothing else. What
is read back or allocated inside a step would be missing from a replay.
"""

from __future__ import annotations

import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp

from cc_mujoco.warp import attach, without_plugin
from warp_cables.test_callback import CABLE, DT, SHORT, Rig, lengths
from warp_cables.test_scenes import scene, wrist_control


def arrays(owner) -> dict[str, int]:
    """Return the addresses of all arrays of an object."""
    found = vars(owner).items()
    return {name: own.ptr for name, own in found if isinstance(own, wp.array)}


@pytest.mark.parametrize("is_split", [False, True])
def test_a_replay_is_an_evaluation(monkeypatch, is_split):
    monkeypatch.setattr("cc_mujoco.warp._cables._is_interleaved", lambda _: is_split)
    direct, replayed = Rig(CABLE, SHORT), Rig(CABLE, SHORT)
    moved = lengths(40, 4)
    for rig in (direct, replayed):
        rig.evaluate(0, moved[0])
    before = arrays(replayed.cables)
    with wp.ScopedCapture("cpu") as capture:
        replayed.m.callback.act_bias(replayed.m, replayed.d)
    for step in range(1, 40):
        time = step * DT if step != 20 else 0.0  # a reset
        replayed.d.time.fill_(time)
        replayed.d.actuator_length.assign(moved[step].astype(np.float32))
        wp.capture_launch(capture.graph)
        found = replayed.cables.tensions.numpy().copy()
        np.testing.assert_array_equal(found, direct.evaluate(time / DT, moved[step]))
    assert arrays(replayed.cables) == before


def replay_equals_steps(spec, control):
    """Take 60 steps of two worlds, as steps and as replays of one; compare them."""
    plain, found = without_plugin(spec).compile(), []
    for captured in (False, True):
        m, d = mjw.put_model(plain), mjw.make_data(plain, nworld=2)
        cables = attach(m, d, spec)
        mjw.step(m, d)
        if captured:
            with wp.ScopedCapture("cpu") as capture:
                mjw.step(m, d)
        for k in range(1, 60):
            given = np.zeros((2, plain.nu), np.float32)
            now = control(k * plain.opt.timestep)
            given[:, : len(now)] = now
            d.ctrl.assign(given)
            wp.capture_launch(capture.graph) if captured else mjw.step(m, d)
        found.append((d.qpos.numpy().copy(), cables.tensions.numpy().copy()))
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.study
@pytest.mark.parametrize("step", [5e-4, 1e-2])
def test_a_captured_step_is_a_step(step):
    replay_equals_steps(scene("wrist", step), wrist_control)
