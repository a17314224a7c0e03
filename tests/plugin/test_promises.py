"""Operations of MuJoCo on simulations with cables."""

from __future__ import annotations

import copy

import mujoco
import mujoco.batch
import mujoco.rollout
import numpy as np
import pytest

from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import replay
from cc_mujoco.plugin import cables, from_mjcf, read
from plugin.scenes import (
    CONFIG,
    RATES,
    build,
    end,
    excitation,
    instance,
    model,
    pull_pull,
    run,
)

INTEGRATORS = ("Euler", "RK4", "implicit", "implicitfast", "discrete")
FULL = mujoco.mjtState.mjSTATE_FULLPHYSICS
INTEGRATION = mujoco.mjtState.mjSTATE_INTEGRATION


def state(m: mujoco.MjModel, d: mujoco.MjData, kind: int = INTEGRATION) -> np.ndarray:
    out = np.empty(mujoco.mj_stateSize(m, kind))
    mujoco.mj_getState(m, d, out, kind)
    return out


LONG = 0.004
"""Time step at which the ends of `pull_pull` are implicit [s]."""


@pytest.fixture(
    params=[(integrator, 0.0005) for integrator in INTEGRATORS]
    + [(integrator, LONG) for integrator in ("Euler", "RK4", "implicitfast")],
    ids=lambda given: f"{given[0]}-{1e3 * given[1]:g}ms",
)
def any_model(request: pytest.FixtureRequest) -> mujoco.MjModel:
    integrator, step = request.param
    text = pull_pull(CONFIG | RATES, f'integrator="{integrator}"', timestep=step)
    return mujoco.MjModel.from_xml_string(text)


def test_forward_twice_changes_nothing(any_model: mujoco.MjModel) -> None:
    d = mujoco.MjData(any_model)
    run(any_model, d, excitation(200))
    mujoco.mj_forward(any_model, d)
    before, force = state(any_model, d), d.actuator_force.copy()
    mujoco.mj_forward(any_model, d)
    assert np.array_equal(state(any_model, d), before)
    assert np.array_equal(d.actuator_force, force)
    assert np.any(force[1:] > 0.0)


def test_forward_in_between_changes_no_step(any_model: mujoco.MjModel) -> None:
    plain, looked = mujoco.MjData(any_model), mujoco.MjData(any_model)
    other = mujoco.MjData(any_model)
    for torque in excitation(100):
        plain.ctrl[0] = looked.ctrl[0] = torque
        mujoco.mj_step(any_model, plain)
        mujoco.mj_step(any_model, looked)
        other.qpos[:] = looked.qpos + 0.1
        kept = state(any_model, looked)
        looked.qpos[:] = other.qpos
        mujoco.mj_forward(any_model, looked)
        mujoco.mj_setState(any_model, looked, kept, INTEGRATION)
    assert np.array_equal(state(any_model, plain), state(any_model, looked))


def test_reset_leaves_no_trace(any_model: mujoco.MjModel) -> None:
    used, fresh = mujoco.MjData(any_model), mujoco.MjData(any_model)
    run(any_model, used, excitation(200, seed=1))
    mujoco.mj_resetData(any_model, used)
    assert np.array_equal(state(any_model, used), state(any_model, fresh))
    again = run(any_model, used, excitation(200))
    first = run(any_model, fresh, excitation(200))
    assert np.array_equal(again[0], first[0])
    assert np.array_equal(again[1], first[1])


@pytest.mark.parametrize("how", ["copy", "mj_copyData"])
def test_copy_continues_identically(any_model: mujoco.MjModel, how: str) -> None:
    d = mujoco.MjData(any_model)
    run(any_model, d, excitation(150))
    if how == "copy":
        twin = copy.copy(d)
    else:
        twin = mujoco.MjData(any_model)
        run(any_model, twin, excitation(50, seed=2))
        mujoco.mj_copyData(twin, any_model, d)
    torque = excitation(150, seed=3)
    ours, theirs = run(any_model, d, torque), run(any_model, twin, torque)
    assert np.array_equal(ours[0], theirs[0])
    assert np.array_equal(ours[1], theirs[1])


@pytest.mark.parametrize("kind", [FULL, INTEGRATION])
def test_state_branches_identically(any_model: mujoco.MjModel, kind: int) -> None:
    d, branch = mujoco.MjData(any_model), mujoco.MjData(any_model)
    run(any_model, d, excitation(150))
    run(any_model, branch, excitation(60, seed=4))
    if kind == FULL:
        branch.qacc_warmstart[:] = d.qacc_warmstart  # the rest of the integration state
    mujoco.mj_setState(any_model, branch, state(any_model, d, kind), kind)
    torque = excitation(150, seed=5)
    ours, theirs = run(any_model, d, torque), run(any_model, branch, torque)
    assert np.array_equal(ours[0], theirs[0])
    assert np.array_equal(ours[1], theirs[1])


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_batch_equals_a_plain_loop(any_model: mujoco.MjModel, threads: int) -> None:
    m = any_model
    count, steps = 7, 60
    batch = mujoco.batch.Batch(m, count, nthread=threads)
    batched_state, ctrl = batch.bind("plugin_state"), batch.bind("ctrl")
    qpos = batch.bind("qpos")
    loop = [mujoco.MjData(m) for _ in range(count)]
    torque = np.stack([excitation(steps, seed) for seed in range(count)])
    for i in range(steps):
        ctrl[:, 0] = torque[:, i]
        batch.step()
        for data, value in zip(loop, torque[:, i], strict=True):
            data.ctrl[0] = value
            mujoco.mj_step(m, data)
    assert np.array_equal(batched_state, np.stack([d.plugin_state for d in loop]))
    assert np.array_equal(qpos, np.stack([d.qpos for d in loop]))
    assert len(np.unique(qpos[:, 0])) == count


def test_rollout_equals_a_plain_loop(any_model: mujoco.MjModel) -> None:
    m = any_model
    d = mujoco.MjData(m)
    run(m, d, excitation(50))
    start = state(m, d, FULL)
    control = np.zeros((3, 80, m.nu))
    control[:, :, 0] = [excitation(80, seed) for seed in range(3)]
    workers = [mujoco.MjData(m) for _ in range(2)]
    states, _ = mujoco.rollout.rollout(m, workers, np.tile(start, (3, 1)), control)
    for i in range(3):
        twin = mujoco.MjData(m)
        mujoco.mj_setState(m, twin, start, FULL)
        for j in range(80):
            twin.ctrl[:] = control[i, j]
            mujoco.mj_step(m, twin)
            assert np.array_equal(states[i, j], state(m, twin, FULL))


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_engine_with_explicit_ends_is_the_kernel(integrator: str) -> None:
    """The committed states equal those of the kernel for the motion of both ends."""
    m, d = build(pull_pull(CONFIG | RATES, f'integrator="{integrator}"'))
    start = d.qpos.copy()
    positions, states = run(m, d, excitation(300))
    begun = np.vstack([start, positions[:-1]])  # where each step began
    motor, wrist = begun[:, m.joint("motor").id], begun[:, m.joint("wrist").id]
    motion = replay(
        from_mjcf(m)["extensor"],
        dt=m.opt.timestep,
        u_proximal=0.02 * motor,
        u_distal=0.05 * wrist,
    )
    first = m.plugin_stateadr[1] + kernel.STATE_HEADER
    n = 10
    assert np.array_equal(motion.tension_proximal, np.maximum(states[:, first], 0.0))
    assert np.array_equal(motion.tension_distal, np.maximum(states[:, first + n], 0.0))


def test_integrators_agree() -> None:
    """Rate-dependent terms see the same elapsed time under every integrator."""
    torque = 0.6 * np.sin(np.linspace(0.0, 6.0, 4000))
    friction = CONFIG | {"viscous_friction": "300"}
    results, lost = {}, {}
    for integrator in INTEGRATORS:
        m, d = build(pull_pull(friction, f'integrator="{integrator}"'))
        results[integrator] = run(m, d, torque)[0][:, :2]
        lost[integrator] = read(m, d, "flexor").dissipated
    for integrator in INTEGRATORS:
        error = np.abs(results[integrator] - results["Euler"]).max()
        assert error < 0.02 * np.abs(results["Euler"]).max(), integrator
        assert lost[integrator] == pytest.approx(lost["Euler"], rel=0.02)


def test_ideal_limit_is_an_ideal_transmission() -> None:
    """Without friction and with little stretch, both pulleys turn as one."""
    ideal = CONFIG | {"friction": "0", "axial_stiffness": "1e6", "segments": "2"}
    m, d = build(pull_pull(ideal, 'integrator="implicitfast"', timestep=2e-5))
    steps = 20000
    positions, _ = run(m, d, 0.05 * np.sin(np.linspace(0.0, 9.0, steps)))
    motor, wrist = positions[:, 0], positions[:, 1]
    assert np.abs(wrist).max() > 0.05
    assert np.allclose(0.02 * motor, 0.05 * wrist, atol=2e-5)
    flexor = read(m, d, "flexor")
    assert flexor.tension_proximal == pytest.approx(flexor.tension_distal, abs=0.3)
    assert flexor.dissipated == pytest.approx(0.0, abs=1e-12)


def test_tendon_and_slide_ends() -> None:
    """A cable between a slide joint and a spatial tendon pulls them together."""
    m, d = build(
        model(
            instance("bowden"),
            end("near", "bowden", 'joint="sledge"', -1)
            + end("far", "bowden", 'tendon="path"', 1),
        )
    )
    proximal, distal = m.actuator("near").id, m.actuator("far").id
    length0 = m.actuator_length0.copy()
    d.qpos[m.joint("sledge").qposadr[0]] = 0.01
    mujoco.mj_forward(m, d)
    moved = d.actuator_length - length0
    assert moved[proximal] == pytest.approx(-0.01)
    assert moved[distal] > 0.001
    motion = replay(
        from_mjcf(m)["bowden"],
        dt=m.opt.timestep,
        u_proximal=[0.0, moved[proximal]],
        u_distal=[0.0, moved[distal]],
    )
    assert d.actuator_force[proximal] == pytest.approx(motion.tension_proximal[1])
    assert d.actuator_force[distal] == pytest.approx(-motion.tension_distal[1])
    assert read(m, d, "bowden").tension_proximal == 10.0  # nothing is committed yet
    mujoco.mj_step(m, d)
    assert read(m, d, "bowden").tension_proximal == d.actuator_force[proximal] > 10.0


def test_reference_pose_is_that_of_qpos0() -> None:
    m, d = build(pull_pull())
    assert cables(m) == ("flexor", "extensor")
    mujoco.mj_forward(m, d)
    assert np.array_equal(d.actuator_force[1:], [10.0, -10.0, 10.0, -10.0])
    xml = pull_pull().replace('name="wrist" axis', 'name="wrist" ref="0.7" axis')
    m, d = build(xml)
    mujoco.mj_forward(m, d)
    assert np.allclose(d.actuator_force[1:], [10.0, -10.0, 10.0, -10.0], rtol=1e-9)


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
def test_actuation_can_be_disabled(integrator: str) -> None:
    m, d = build(pull_pull(option=f'integrator="{integrator}"'))
    run(m, d, excitation(50))
    m.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
    run(m, d, excitation(50))
    reading = read(m, d, "flexor")
    assert np.isfinite(reading.tension).all()


def test_without_actuation_a_step_takes_the_configuration_of_its_model() -> None:
    """Not that of an evaluation before, whatever the cable kept of it."""
    states = []
    for is_evaluated in (False, True):
        m, d = build(pull_pull())
        if is_evaluated:
            mujoco.mj_forward(m, d)
        stiffer = mujoco.MjModel.from_xml_string(
            pull_pull(CONFIG | {"axial_stiffness": "8000"})
        )
        m.plugin_attr[:] = stiffer.plugin_attr
        m.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
        d.qpos[0] += 0.01
        mujoco.mj_step(m, d)
        states.append(d.plugin_state.copy())
    assert np.array_equal(*states)


def test_batch_may_give_each_simulation_its_own_model() -> None:
    """Parameters follow the model that a step is made with."""
    models = [
        mujoco.MjModel.from_xml_string(pull_pull(CONFIG | {"friction": friction}))
        for friction in ("0.15", "0.35", "0.05")
    ]
    d = mujoco.MjData(models[0])
    for m in models:
        mujoco.mj_resetData(m, d)
        mixed = run(m, d, excitation(100))
        own = run(m, mujoco.MjData(m), excitation(100))
        assert np.array_equal(mixed[0], own[0])
        assert np.array_equal(mixed[1], own[1])


def test_a_hundred_thousand_steps_of_random_excitation_stay_finite() -> None:
    m = mujoco.MjModel.from_xml_string(
        model(
            instance("flexor", CONFIG | {"segments": "5"}),
            end("one", "flexor", 'joint="motor"', -0.02)
            + end("two", "flexor", 'joint="wrist"', -0.05),
        )
    )
    count, chunk = 2, 1000
    batch = mujoco.batch.Batch(m, count, nthread=2)
    plugin_state, ctrl = batch.bind("plugin_state"), batch.bind("ctrl")
    qpos = batch.bind("qpos")
    rng = np.random.default_rng(0)
    largest = 0.0
    for _ in range(100_000 // count // chunk):
        ctrl[:, 0] = rng.uniform(-3.0, 3.0, count)
        batch.step(nstep=chunk)
        assert np.isfinite(plugin_state).all()
        assert np.isfinite(qpos).all()
        largest = max(largest, float(plugin_state[:, 6:12].max()))
    assert not np.any(batch.warning)
    assert largest > 10.0
