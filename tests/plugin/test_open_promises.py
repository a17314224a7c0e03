"""Operations of MuJoCo on simulations whose cables leave their conduits."""

from __future__ import annotations

import copy
from pathlib import Path

import mujoco
import mujoco.batch
import mujoco.rollout
import numpy as np
import pytest

from cc_mujoco.cable._layout import STATE_HEADER
from cc_mujoco.plugin import cables, read, settle
from plugin.open_scenes import atwood, end, winch
from plugin.test_moving_route import INTEGRATORS, LIMB, RATES, drive, run

FULL = mujoco.mjtState.mjSTATE_FULLPHYSICS
OPEN = '<config key="path" value="open"/>'
MIXED = '<config key="path" value="mixed"/><config key="mouth" value="b"/>'
SAME = '<config key="pretension" value="20"/>'


def limb(path: str, integrator: str = "Euler", more: str = "") -> mujoco.MjModel:
    """Return a model of a cable past an elbow to the wrist, partly or wholly open."""
    text = LIMB.format(integrator=integrator, more=more + path)
    if path == OPEN:
        length = tendon_length(text.replace(OPEN, ""))
        text = text.replace('"0.9:1"', f'"{length}:1"')
    return mujoco.MjModel.from_xml_string(text)


def tendon_length(text: str) -> float:
    return float(mujoco.MjModel.from_xml_string(text).tendon_length0[0])


@pytest.fixture(params=[OPEN, MIXED], ids=["open", "mixed"])
def path(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_repeats_resets_copies_and_goes_on_from_a_saved_state(
    path: str, integrator: str
) -> None:
    m = limb(path, integrator, RATES)
    controls = drive(160)
    d = mujoco.MjData(m)
    whole = run(m, d, controls)
    assert np.all(np.isfinite(whole))
    assert np.ptp(whole[:, -m.npluginstate + STATE_HEADER + 1]) > 5.0
    mujoco.mj_resetData(m, d)
    run(m, d, controls[:80])
    twin = copy.copy(d)
    fresh = mujoco.MjData(m)
    state = np.empty(mujoco.mj_stateSize(m, mujoco.mjtState.mjSTATE_INTEGRATION))
    mujoco.mj_getState(m, d, state, mujoco.mjtState.mjSTATE_INTEGRATION)
    mujoco.mj_setState(m, fresh, state, mujoco.mjtState.mjSTATE_INTEGRATION)
    for other in (d, twin, fresh):
        assert np.array_equal(run(m, other, controls[80:]), whole[80:])


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_forward_in_between_changes_no_step(path: str, integrator: str) -> None:
    m = limb(path, integrator)
    plain, looked = mujoco.MjData(m), mujoco.MjData(m)
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    kept = np.empty(mujoco.mj_stateSize(m, kind))
    for control in drive(60):
        plain.ctrl[:2] = looked.ctrl[:2] = control
        mujoco.mj_step(m, plain)
        mujoco.mj_step(m, looked)
        mujoco.mj_getState(m, looked, kept, kind)
        looked.qpos[:] += 0.3
        mujoco.mj_forward(m, looked)
        mujoco.mj_setState(m, looked, kept, kind)
    assert np.array_equal(plain.qpos, looked.qpos)
    assert np.array_equal(plain.plugin_state, looked.plugin_state)
    mujoco.mj_forward(m, plain)
    before = plain.qfrc_passive.copy()
    mujoco.mj_forward(m, plain)
    assert np.array_equal(plain.qfrc_passive, before)


def test_actuators_alone_evaluated_again_pull_once(path: str) -> None:
    """Finite differences evaluate them this way, with the skip of earlier stages."""
    m = limb(path)
    d = mujoco.MjData(m)
    run(m, d, drive(100))
    mujoco.mj_forward(m, d)
    before = d.qfrc_passive.copy()
    for _ in range(3):
        mujoco.mj_forwardSkip(m, d, mujoco.mjtStage.mjSTAGE_VEL, 0)
    assert d.qfrc_passive == pytest.approx(before, rel=1e-12, abs=1e-12)
    assert np.abs(before).max() > 0.0


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("step", [5e-4, 4e-3], ids=["explicit", "implicit"])
def test_inverse_dynamics_know_the_pull_of_the_pieces(
    path: str, integrator: str, step: float
) -> None:
    m = limb(path, integrator)
    m.opt.timestep = step
    d, fresh = mujoco.MjData(m), mujoco.MjData(m)
    run(m, d, drive(100))
    mujoco.mj_forward(m, d)
    pulled = np.abs(d.qfrc_passive - d.qfrc_spring - d.qfrc_damper).max()
    applied = d.qfrc_applied + d.qfrc_actuator
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.empty(mujoco.mj_stateSize(m, kind))
    mujoco.mj_getState(m, d, state, kind)
    mujoco.mj_setState(m, fresh, state, kind)
    fresh.qacc[:] = d.qacc
    for data, tolerance in ((d, 1e-9), (fresh, 0.02)):
        mujoco.mj_inverse(m, data)
        assert data.qfrc_inverse == pytest.approx(applied, abs=tolerance * pulled)
    assert pulled > 0.1


def test_a_rollout_steps_as_mujoco_does(path: str) -> None:
    m = limb(path)
    controls = np.zeros((3, 40, m.nu))
    for i in range(3):
        controls[i, :, :2] = drive(40, seed=i)
    d = mujoco.MjData(m)
    start = np.empty(mujoco.mj_stateSize(m, FULL))
    mujoco.mj_getState(m, d, start, FULL)
    rolled, _ = mujoco.rollout.rollout(
        m, [mujoco.MjData(m) for _ in range(2)], np.tile(start, (3, 1)), controls
    )
    for i in range(3):
        mujoco.mj_resetData(m, d)
        assert np.array_equal(run(m, d, controls[i, :, :2]), rolled[i])


def test_attached_twice_each_cable_finds_its_own_tendon_and_mouth() -> None:
    text = LIMB.format(integrator="Euler", more=MIXED)
    parent = mujoco.MjSpec()
    parent.option.timestep = 5e-4
    for place, side in enumerate(("left_", "right_")):
        child = mujoco.MjSpec.from_string(text)
        frame = parent.worldbody.add_frame(pos=[0, 3 * place, 0])
        parent.attach(child, prefix=side, frame=frame)
    m = parent.compile()
    d = mujoco.MjData(m)
    alone = limb(MIXED)
    e = mujoco.MjData(alone)
    assert cables(m) == ("left_bowden", "right_bowden")
    for control in drive(12):
        d.ctrl[:2], e.ctrl[:2] = control, control
        mujoco.mj_step(m, d)
        mujoco.mj_step(alone, e)
    one, same = read(m, d, "left_bowden"), read(alone, e, "bowden")
    assert one.tension == pytest.approx(same.tension, rel=1e-9)
    assert not np.allclose(read(m, d, "right_bowden").tension, one.tension)


def test_settled_in_another_pose_nothing_pulls_but_the_pretension(path: str) -> None:
    m = limb(path)
    d = mujoco.MjData(m)
    d.qpos[:] = [0.3, 0.5, -0.4]
    settle(m, d)
    assert read(m, d, "bowden").tension == pytest.approx(20.0)
    mujoco.mj_step(m, d)
    assert read(m, d, "bowden").tension == pytest.approx(20.0, rel=1e-9)


def test_without_friction_an_open_tendon_pulls_with_mujocos_moment_arms() -> None:
    text = LIMB.format(integrator="Euler", more=OPEN)
    length = tendon_length(text.replace(OPEN, ""))
    text = text.replace('"0.9:1"', f'"{length}:1"')
    text = text.replace('key="friction" value="0.2"', 'key="friction" value="0"')
    m = mujoco.MjModel.from_xml_string(text)
    d = mujoco.MjData(m)
    run(m, d, drive(200))
    mujoco.mj_forward(m, d)
    arms = np.zeros((1, m.nv))
    mujoco.mju_sparse2dense(
        arms, d.ten_J.ravel(), m.ten_J_rownnz, m.ten_J_rowadr, m.ten_J_colind.ravel()
    )
    pulled = d.qfrc_passive - d.qfrc_spring - d.qfrc_damper
    tension = d.actuator("near").force[0]
    assert tension > 1.0
    assert pulled == pytest.approx(-tension * arms[0], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("segments", 2), "key `segments` is too small: its path needs at least 5"),
        (("conduit", "0.5:inf"), "key `conduit` has the wrong length: the path of its"),
        (("mouth", "a"), "key `mouth` is 'a'; it must be with `path` = `mixed`, and"),
        (("path", "free"), "key `path` is 'free'; it must be `guided`"),
        (("seal_distal", "1"), "key `seal_distal` is '1'; it must be"),
        (("clamp_creep_distal", "1"), "key `clamp_creep_distal` is '1'; it must be"),
    ],
)
def test_what_cannot_be_is_refused_in_one_sentence(
    change: tuple[str, object], said: str
) -> None:
    with pytest.raises(ValueError, match=said):
        winch(0.1, 1.0, **dict([change]))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('gear="-0.05"', 'gear="1"', "has a pulley of 1 m radius or more"),
        ('gear="-0.05"', 'gear="-50"', "has a pulley of 1 m radius or more"),
        ('gear="-0.05"', 'gear="-0.05" forcerange="-9 9"', "has a `forcerange`"),
    ],
)
def test_an_end_that_makes_no_sense_is_refused(old: str, new: str, said: str) -> None:
    text = LIMB.format(integrator="Euler", more="")
    assert old in text
    text = text.replace("<actuator>", '<compiler autolimits="true"/><actuator>')
    with pytest.raises(ValueError, match=said):
        mujoco.MjModel.from_xml_string(text.replace(old, new))


@pytest.mark.parametrize("first", [-2, -0.99])
def test_an_end_tied_by_a_gear_that_would_scale_its_pull_is_refused(
    first: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    wrong = end("tendon", "rope", first) + end("tendon", "rope", 1)
    monkeypatch.setattr("plugin.open_scenes.TIED", wrong)
    with pytest.raises(ValueError, match="to its own tendon; its gear must be 1"):
        atwood(0.1, (1.0, 1.0), 0.01)


def test_without_passive_forces_it_says_so_and_does_not_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # for the log of MuJoCo's warnings
    m = winch(0.1, 1.0)
    d = mujoco.MjData(m)
    mujoco.mj_step(m, d)
    off = mujoco.mjtDisableBit
    m.opt.disableflags |= int(off.mjDSBL_SPRING) | int(off.mjDSBL_DAMPER)
    mujoco.mj_forward(m, d)
    assert np.isnan(d.actuator_force[1:]).all()


def test_a_changed_drawing_counts_from_the_next_reset_on() -> None:
    m = winch(0.1, 1.0)
    d = mujoco.MjData(m)
    mujoco.mj_step(m, d)
    m.site("out").pos[2] += 0.01
    mujoco.mj_setConst(m, mujoco.MjData(m))
    mujoco.mj_resetData(m, d)
    mujoco.mj_forward(m, d)
    mujoco.mj_step(m, d)
    assert read(m, d, "rope").tension == pytest.approx(9.81, rel=1e-3)


@pytest.mark.parametrize("step", [0.0005, 0.003])
def test_a_batch_steps_as_mujoco_does(path: str, step: float) -> None:
    """The motor's end may be explicit or implicit."""
    m = limb(path)
    m.opt.timestep = step
    controls = np.stack([drive(40, seed=i) for i in range(5)])
    batch = mujoco.batch.Batch(m, 5, nthread=2)
    state, ctrl = batch.bind("plugin_state"), batch.bind("ctrl")
    for i in range(40):
        ctrl[:, :2] = controls[:, i]
        batch.step()
    for row, control in zip(state, controls, strict=True):
        d = mujoco.MjData(m)
        run(m, d, control)
        assert np.array_equal(row, d.plugin_state)
        assert np.all(np.isfinite(row))
