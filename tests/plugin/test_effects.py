"""Every effect in a simulation: the plugin is the kernel, and its state is all."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import fit_soft_end, replay
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


FORCES = np.linspace(0.0, 200.0, 21)


def loading_curve(extension: np.ndarray) -> str:
    pairs = zip(extension.tolist(), FORCES.tolist(), strict=True)
    return " ".join(f"{x!r}:{force!r}" for x, force in pairs)


def pulled(config: dict[str, str]) -> np.ndarray:
    """Return how far the distal end of a stiff rope yields to the forces [m]."""
    stiff = config | {"axial_stiffness": "1e9", "pretension": "0", "friction": "0"}
    cable, still = from_mjcf(pull_pull(stiff))["flexor"], np.zeros(FORCES.size)
    moved = replay(cable, 1e-3, u_proximal=still, tension_distal=FORCES).u_distal
    return moved - FORCES * cable.length / cable.axial_stiffness


@pytest.mark.parametrize(("end", "loss"), [("end", "0.3"), ("proximal", "0")])
def test_a_loading_curve_of_the_law_is_its_spring(end: str, loss: str) -> None:
    hardening = 0.02
    law = 3e-4 * np.log1p(hardening * FORCES) / hardening
    config = CONFIG | {f"{end}_compliance": loading_curve(0.01 + law)}
    config[f"{end}_loss"] = loss
    assert pulled(config) == pytest.approx(law, rel=1e-5, abs=1e-9)
    m, d = build(pull_pull(config))
    cable = from_mjcf(m)["flexor"]
    assert getattr(cable, f"{end}_compliance") == pytest.approx(3e-4, rel=1e-9)
    assert getattr(cable, f"{end}_hardening") == pytest.approx(hardening, rel=1e-9)
    same = build(pull_pull(cable.to_config()))
    torque = excitation(300)
    for found, wanted in zip(run(m, d, torque), run(*same, torque), strict=True):
        np.testing.assert_array_equal(found, wanted)
    hard = loading_curve(np.log1p(20.0 * FORCES))  # 20 /N; at most 10 are allowed
    for more in {f"{end}_hardening": "0.02"}, {f"{end}_compliance": hard}:
        for read in build, from_mjcf:
            with pytest.raises(ValueError, match=f"`{end}_hardening`"):
                read(pull_pull(config | more))


def test_a_curve_that_the_spring_does_not_follow_is_a_warning(
    capfd: pytest.CaptureFixture[str],
) -> None:
    """Woven webbing: crimp that straightens within newtons, then nearly a line."""
    webbing = 5e-3 * (1.0 - np.exp(-FORCES / 8.0)) + 1e-4 * FORCES
    config = CONFIG | {"end_compliance": loading_curve(webbing)}
    off = np.abs(pulled(config) - webbing).max() / webbing[-1]
    spec = mujoco.MjSpec.from_string(pull_pull(config))
    with pytest.warns(UserWarning, match=r"C ln.* 7\.10. % of") as caught:
        model = spec.compile()
    assert [str(each.message).split("'")[1] for each in caught] == [
        "flexor",
        "extensor",
    ]
    mujoco.mj_step(model, mujoco.MjData(model))
    assert "ln" not in capfd.readouterr().err
    assert off == pytest.approx(0.0711, abs=1e-4)
    extension, force = webbing[4:] - webbing[4], FORCES[4:]
    assert fit_soft_end(extension, force).residual < 0.01  # without the crimp
