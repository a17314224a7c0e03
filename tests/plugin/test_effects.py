"""Every effect in a simulation: the plugin is the kernel, and its state is all."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import replay
from cc_mujoco.plugin import from_mjcf
from plugin.scenes import CONFIG, build, excitation, pull_pull, run

EFFECTS = {
    "asymmetric": {"friction_asymmetry": "0.3"},
    "end spring": {"end_compliance": "2e-4"},
    "proximal spring": {"proximal_compliance": "1e-4"},
    "soft anchors": {
        "end_compliance": "2e-4",
        "end_hardening": "0.03",
        "end_loss": "0.3",
        "proximal_compliance": "1e-4",
        "proximal_hardening": "0.02",
        "proximal_loss": "0.2",
    },
    "bristles": {"bristle_length": "1e-4"},
    "tension": {"tension_exponent": "-0.2"},
    "ageing": {"ageing_friction": "0.05", "critical_slip_distance": "1e-4"},
    "wrap": {"wrap_growth": "-8"},
    "drift": {"friction_drift": "2"},
    "heating": {"friction_heating": "5", "cooling_time": "0.2"},
    "bedding_strain": {"bedding_strain": "0.005"},
    "clearance": {"clearance": "0.002", "seating_tension": "4"},
    "stress_relaxation": {"stress_relaxation": "0.5", "relaxation_time": "0.1"},
    "clamps": {
        "clamp_creep_proximal": "1e-4",
        "clamp_creep_distal": "2e-4",
        "clamp_force": "12",
    },
    "grease": {"grease_drag": "4", "grease_exponent": "0.4"},
    "seals": {"seal_proximal": "1", "seal_distal": "0.5"},
    "wrap near the joint": {"wrap_growth": "-8", "wrap_reach": "0.3"},
    "eccentric": {"eccentricity": "2e-3", "eccentricity_phase": "0.6"},
    "oval": {"ovality": "1e-3", "ovality_phase": "-0.3"},
}
EVERY = {key: value for effect in EFFECTS.values() for key, value in effect.items()}
CASES = EFFECTS | {"every": EVERY}


def wound(config: dict[str, str], gear: float, angle: np.ndarray) -> np.ndarray:
    """Displacement of the proximal end on its pulley."""
    e = float(config.get("eccentricity", 0.0))
    phase = float(config.get("eccentricity_phase", 0.0))
    o, second = float(config.get("ovality", 0)), float(config.get("ovality_phase", 0))
    swing = e * (np.sin(angle - phase) + np.sin(phase))
    swing += 0.5 * o * (np.sin(2.0 * angle - second) + np.sin(second))
    return gear * angle + np.sign(gear) * swing


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
@pytest.mark.parametrize("effect", CASES)
def test_the_plugin_is_the_kernel_on_the_motion_of_the_ends(
    effect: str, integrator: str
) -> None:
    config = CONFIG | CASES[effect]
    m, d = build(pull_pull(config, f'integrator="{integrator}"'))
    start = d.qpos.copy()
    positions, states = run(m, d, excitation(200))
    begun = np.vstack([start, positions[:-1]])
    motor, wrist = begun[:, m.joint("motor").id], begun[:, m.joint("wrist").id]
    cable = from_mjcf(m)["flexor"]
    motion = replay(
        cable,
        dt=m.opt.timestep,
        u_proximal=wound(config, -0.02, motor),
        u_distal=-0.05 * wrist,
        profile=True,
    )
    first = int(m.plugin_stateadr[0]) + kernel.STATE_HEADER
    tension = np.maximum(states[:, first : first + cable.segments + 1], 0.0)
    assert tension == pytest.approx(motion.tension, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("effect", CASES)
def test_a_saved_state_continues_alike(effect: str) -> None:
    m, d = build(pull_pull(CONFIG | CASES[effect]))
    run(m, d, excitation(150))
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    saved = np.empty(mujoco.mj_stateSize(m, kind))
    mujoco.mj_getState(m, d, saved, kind)
    twin = mujoco.MjData(m)
    run(m, twin, excitation(40, seed=2))
    mujoco.mj_setState(m, twin, saved, kind)
    ours, theirs = run(m, d, excitation(100)), run(m, twin, excitation(100))
    assert np.array_equal(ours[0], theirs[0])
    assert np.array_equal(ours[1], theirs[1])


def test_tension_acts_on_the_motor_with_the_lever_of_the_moment() -> None:
    m, d = build(pull_pull(CONFIG | EFFECTS["eccentric"]))
    out = m.actuator("extensor_proximal").id
    for angle in (-1.0, 0.0, 0.6, 2.0):
        mujoco.mj_resetData(m, d)
        d.qpos[m.joint("motor").qposadr[0]] = angle
        mujoco.mj_forward(m, d)
        motion = replay(
            from_mjcf(m)["extensor"],
            dt=m.opt.timestep,
            u_proximal=[0.0, wound(EFFECTS["eccentric"], 0.02, np.array(angle))],
            u_distal=[0.0, 0.0],
        )
        lever = 1.0 + 0.1 * np.cos(angle - 0.6)
        wanted = motion.tension_proximal[1] * lever
        assert d.actuator_force[out] == pytest.approx(wanted, rel=1e-12)


def test_an_eccentricity_that_is_no_pulley_is_refused() -> None:
    with pytest.raises(ValueError, match=r"`eccentricity` is '0\.02'; .*`gear`"):
        build(pull_pull(CONFIG | {"eccentricity": "0.02"}))
    with pytest.raises(ValueError, match=r"`ovality` is '0\.006'; .*`eccentricity`"):
        build(pull_pull(CONFIG | {"eccentricity": "0.014", "ovality": "0.006"}))


def test_friction_that_depends_on_tension_needs_a_pretension() -> None:
    config = CONFIG | {"pretension": "0", "tension_exponent": "0.2"}
    with pytest.raises(ValueError, match=r"`tension_exponent` is '0\.2'; .*pretension"):
        build(pull_pull(config))


@pytest.mark.parametrize("end", ["end", "proximal"])
@pytest.mark.parametrize("name", ["hardening", "loss"])
def test_a_soft_end_needs_a_compliance(end: str, name: str) -> None:
    config = CONFIG | {f"{end}_{name}": "0.1"}
    with pytest.raises(ValueError, match=rf"`{end}_{name}` is '0\.1'; .*{end}_compli"):
        build(pull_pull(config))
