"""A conduit that follows its route: friction, energy and what MuJoCo may do with it."""

from __future__ import annotations

import copy
import math

import mujoco
import mujoco.batch
import numpy as np
import pytest

from cc_mujoco.cable import Section, packed_parameters
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.plugin import (
    from_mjcf,
    read,
    route_wrap,
    segment_wrap,
    settle,
    to_mjcf,
)
from plugin.test_path import scene, sites

FULL = mujoco.mjtState.mjSTATE_FULLPHYSICS
INTEGRATORS = ("Euler", "RK4", "implicit", "implicitfast", "discrete")

LIMB = """
<mujoco>
  <option timestep="0.0005" integrator="{integrator}"/>
  <extension><plugin plugin="cc_mujoco.cable"><instance name="bowden">
    <config key="conduit" value="0.9:1"/>
    <config key="axial_stiffness" value="4000"/>
    <config key="pretension" value="20"/>
    <config key="friction" value="0.2"/>
    <config key="segments" value="16"/>
    <config key="route" value="path"/>
    <config key="bend" value="route"/>{more}
  </instance></plugin></extension>
  <worldbody>
    <site name="a" pos="-0.5 0.1 0"/><site name="b" pos="-0.3 0.2 0.1"/>
    <geom name="post" type="cylinder" size="0.05 0.1" contype="0"
      conaffinity="0"/>
    <site name="side" pos="0.14 0.14 0"/>
    <body name="motor" pos="-0.5 0 0">
      <joint name="motor" axis="0 0 1" armature="1e-4" damping="1e-3"/>
      <geom size="0.02" mass="0.05"/>
    </body>
    <body name="limb">
      <joint name="elbow" axis="0 0 1" damping="2"/>
      <geom type="capsule" size="0.02" fromto="0 0 0 0.3 0 0" mass="0.5"/>
      <site name="c" pos="0.2 0.03 0"/><site name="d" pos="0.3 0.06 0.03"/>
      <body name="hand" pos="0.3 0 0">
        <joint name="wrist" axis="0 0 1" damping="0.02" stiffness="0.5"/>
        <geom size="0.03" mass="0.2" pos="0.05 0 0"/>
      </body>
    </body>
  </worldbody>
  <tendon><spatial name="path">
    <site site="a"/><site site="b"/><geom geom="post" sidesite="side"/>
    <site site="c"/><site site="d"/>
  </spatial></tendon>
  <actuator>
    <motor name="drive" joint="motor"/>
    <position name="arm" joint="elbow" kp="20"/>
    <plugin name="near" instance="bowden" joint="motor" gear="-0.02"/>
    <plugin name="far" instance="bowden" joint="wrist" gear="-0.05"/>
  </actuator>
</mujoco>"""


def limb(integrator: str = "Euler", more: str = "") -> mujoco.MjModel:
    """Return a cable that passes an elbow to the wrist behind it."""
    return mujoco.MjModel.from_xml_string(LIMB.format(integrator=integrator, more=more))


RATES = "".join(
    f'<config key="{key}" value="{value}"/>'
    for key, value in {
        "static_friction": 0.3,
        "critical_slip_distance": 1e-4,
        "viscous_friction": 20,
        "stribeck_friction": 0.05,
    }.items()
)


@pytest.fixture(params=INTEGRATORS)
def any_limb(request: pytest.FixtureRequest) -> mujoco.MjModel:
    return limb(request.param, RATES)


def drive(steps: int, seed: int = 0) -> np.ndarray:
    """Return random controls (steps, 2): the motor torque and the elbow angle."""
    rng = np.random.default_rng(seed)
    walk = np.cumsum(rng.normal(scale=0.05, size=(steps, 2)), axis=0)
    return np.sin(walk) * [0.6, 0.8] + [0.5, -0.3]


def run(m: mujoco.MjModel, d: mujoco.MjData, controls: np.ndarray) -> np.ndarray:
    """Step; the full state after every step."""
    out = np.empty((len(controls), mujoco.mj_stateSize(m, FULL)))
    for row, control in zip(out, controls, strict=True):
        d.ctrl[:2] = control
        mujoco.mj_step(m, d)
        mujoco.mj_getState(m, d, row, FULL)
    return out


def test_static_route_is_the_conduit_of_fixed_curvature() -> None:
    """An arc drawn with sites, against one section of its curvature."""
    turn, chords = 0.15, 20
    heading = turn * np.arange(chords)
    steps = 0.05 * np.stack([np.cos(heading), np.sin(heading), 0 * heading], axis=1)
    world, tendon = sites(np.vstack([np.zeros(3), np.cumsum(steps, axis=0)]))
    radius = 0.05 / turn
    conduit = f"0.025:inf 0.95:{radius!r} 0.025:inf"
    models = [
        mujoco.MjModel.from_xml_string(
            scene(world, tendon, segments=40, conduit=conduit, bend=bend)
        )
        for bend in ("route", "fixed")
    ]
    tensions = []
    for m in models:
        d = mujoco.MjData(m)
        seen = []
        for at in np.linspace(0.0, 9.0, 600):
            # Both ends move, together and apart; the near one also slackens the cable.
            d.qpos[:] = [0.06 * math.sin(at), 0.04 * math.sin(1.7 * at)]
            d.qvel[:] = 0.0
            mujoco.mj_step(m, d)
            seen.append(read(m, d, "bowden").tension)
        tensions.append(np.array(seen))
    follows, fixed = tensions
    assert fixed.min() == 0.0
    assert fixed.max() > 40.0
    assert follows == pytest.approx(fixed, rel=1e-8, abs=1e-8)


def held(m: mujoco.MjModel, d: mujoco.MjData, motor: float, elbow: float) -> None:
    """One step at given angles, the wrist at rest."""
    d.qpos[:] = [motor, elbow, 0.0]
    d.qvel[:] = 0.0
    mujoco.mj_step(m, d)


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
@pytest.mark.parametrize("more", ["", '<config key="static_friction" value="0.3"/>'])
def test_bending_a_loaded_stuck_cable_stays_in_the_cone_and_makes_no_energy(
    more: str, integrator: str
) -> None:
    m = limb(integrator, more)
    d = mujoco.MjData(m)
    for part in np.linspace(0.0, 1.0, 200):  # the motor winds 10 mm, the elbow rests
        held(m, d, 0.5 * part, -0.9)
    cable = from_mjcf(m)["bowden"]
    stiffness = kernel.node_stiffness(packed_parameters(cable), cable.segments)
    coefficient = max(cable.friction, cable.static_friction)
    before = read(m, d, "bowden")
    stored = float((0.5 * before.tension**2 / stiffness).sum())
    stretch = float((before.tension / stiffness).sum())
    wraps, moved = [], 0
    angles = np.linspace(0.0, 4.0 * math.pi, 800)  # bends and straightens, twice
    for at in [*angles, *10 * [angles[-1]]]:  # and rests
        held(m, d, 0.5, -0.9 + 0.9 * math.sin(at))
        if integrator == "RK4":
            held(m, d, 0.5, -0.9 + 0.9 * math.sin(at))  # the path of the last stage
        now = read(m, d, "bowden")
        low, high = np.sort([now.tension[1:], now.tension[:-1]], axis=0)
        wrap = segment_wrap(m, d, "bowden")
        wraps.append(wrap.sum())
        if integrator == "Euler":
            assert np.all(high <= low * np.exp(coefficient * wrap) * (1.0 + 1e-9))
        energy = float((0.5 * now.tension**2 / stiffness).sum())
        # The ends stand still: what the cable stores can only become heat.
        assert energy <= stored + 1e-12
        assert now.dissipated >= before.dissipated
        assert (now.tension / stiffness).sum() == pytest.approx(stretch, rel=1e-9)
        lost = now.dissipated - before.dissipated
        assert stored - energy >= lost * (1.0 - 1e-9) - 1e-12
        moved += energy < stored
        stored, before = energy, now
    assert max(wraps) > 1.5 * min(wraps)
    assert 3 < moved <= angles.size  # it slips, and is stuck at rest
    assert before.moving_fraction == 0.0


def test_route_that_straightens_lets_a_stuck_cable_slip_inside() -> None:
    m = limb()
    d = mujoco.MjData(m)
    for part in np.linspace(0.0, 1.0, 200):
        held(m, d, 0.05 * part, -1.5)
    before = read(m, d, "bowden")
    assert before.slip[0] == -1
    assert before.slip[-1] == 0
    held(m, d, 0.05, -1.5)
    assert np.all(read(m, d, "bowden").slip == 0)
    held(m, d, 0.05, -1.1)
    after = read(m, d, "bowden")
    assert 0.3 < after.moving_fraction < 1.0
    assert after.tension_proximal < before.tension_proximal
    assert after.dissipated > before.dissipated


def test_friction_follows_the_pose() -> None:
    """The whole cable slides at the ratio of the wrap of the moment."""
    for elbow in (-1.5, -0.5, 0.3):
        m = limb()
        d = mujoco.MjData(m)
        for part in np.linspace(0.0, 1.0, 400):
            held(m, d, 2.0 * part, elbow)
        now = read(m, d, "bowden")
        assert now.moving_fraction == 1.0
        ratio = now.tension_proximal / now.tension_distal
        wrap = route_wrap(m, d, "bowden")
        assert ratio == pytest.approx(math.exp(0.2 * wrap), rel=1e-9)


def test_forward_twice_changes_nothing(any_limb: mujoco.MjModel) -> None:
    d = mujoco.MjData(any_limb)
    run(any_limb, d, drive(200))
    mujoco.mj_forward(any_limb, d)
    kept, force = d.plugin_state.copy(), d.actuator_force.copy()
    d.qpos[1] += 0.3
    mujoco.mj_forward(any_limb, d)
    assert not np.array_equal(d.actuator_force, force)
    d.qpos[1] -= 0.3
    mujoco.mj_forward(any_limb, d)
    assert np.array_equal(d.plugin_state, kept)
    assert d.actuator_force == pytest.approx(force, rel=1e-6)


def test_reset_and_copy_continue_identically(any_limb: mujoco.MjModel) -> None:
    d, fresh = mujoco.MjData(any_limb), mujoco.MjData(any_limb)
    run(any_limb, d, drive(150, seed=1))
    mujoco.mj_resetData(any_limb, d)
    assert np.array_equal(
        run(any_limb, d, drive(150)), run(any_limb, fresh, drive(150))
    )
    twin = copy.copy(d)
    more = drive(100, seed=2)
    assert np.array_equal(run(any_limb, d, more), run(any_limb, twin, more))


def test_saved_state_branches_identically(any_limb: mujoco.MjModel) -> None:
    d, branch = mujoco.MjData(any_limb), mujoco.MjData(any_limb)
    saved = run(any_limb, d, drive(150))[-1]
    run(any_limb, branch, drive(60, seed=4))
    branch.qacc_warmstart[:] = d.qacc_warmstart
    mujoco.mj_setState(any_limb, branch, saved, FULL)
    more = drive(150, seed=5)
    assert np.array_equal(run(any_limb, d, more), run(any_limb, branch, more))


@pytest.mark.parametrize("threads", [1, 2])
def test_batch_equals_a_plain_loop(any_limb: mujoco.MjModel, threads: int) -> None:
    count, steps = 5, 80
    batch = mujoco.batch.Batch(any_limb, count, nthread=threads)
    state, ctrl = batch.bind("plugin_state"), batch.bind("ctrl")
    loop = [mujoco.MjData(any_limb) for _ in range(count)]
    controls = np.stack([drive(steps, seed) for seed in range(count)])
    for i in range(steps):
        ctrl[:, :2] = controls[:, i]
        batch.step()
        for data, control in zip(loop, controls[:, i], strict=True):
            data.ctrl[:2] = control
            mujoco.mj_step(any_limb, data)
    assert np.array_equal(state, np.stack([d.plugin_state for d in loop]))


def test_integrators_agree() -> None:
    # With stiction they agree to first order in the step only.
    time, step = np.linspace(0.0, 0.5, 6000), 1.25e-4
    controls = np.stack([0.8 - 0.4 * np.cos(9.0 * time), -1.2 * time], axis=1)
    found = {}
    for integrator in INTEGRATORS:
        m = limb(integrator, RATES.replace('"20"', '"300"'))
        m.opt.timestep = step
        d = mujoco.MjData(m)
        found[integrator] = run(m, d, controls)[:, 1:4]
        lost = read(m, d, "bowden").dissipated
        found.setdefault("lost", lost)
        assert lost == pytest.approx(found["lost"], rel=1e-3), integrator
        error = np.abs(found[integrator] - found["Euler"]).max()
        assert error < 1e-3 * np.abs(found["Euler"]).max(), integrator


def test_actuation_can_be_disabled(any_limb: mujoco.MjModel) -> None:
    d = mujoco.MjData(any_limb)
    run(any_limb, d, drive(50))
    any_limb.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
    run(any_limb, d, drive(50))
    assert np.isfinite(read(any_limb, d, "bowden").tension).all()


def test_simulations_of_a_batch_may_differ_in_who_bends_the_conduit() -> None:
    """The packed parameters follow the model of each step, there and back."""
    moving = limb()
    spec = mujoco.MjSpec.from_string(LIMB.format(integrator="Euler", more=""))
    cable = from_mjcf(spec)["bowden"]
    to_mjcf(spec, "bowden", cable.replace(bend="fixed", conduit=(Section(0.9, 0.4),)))
    still = spec.compile()
    d = mujoco.MjData(moving)
    for m in (moving, still, moving):
        mujoco.mj_resetData(m, d)
        assert np.array_equal(run(m, d, drive(80)), run(m, mujoco.MjData(m), drive(80)))


def test_attached_cables_follow_their_own_routes() -> None:
    parent = mujoco.MjSpec()
    parent.option.timestep = 0.0005
    for x, prefix in enumerate(["left_", "right_"]):
        child = mujoco.MjSpec.from_string(LIMB.format(integrator="Euler", more=""))
        frame = parent.worldbody.add_frame(pos=[x + 1, 0, 0])
        parent.attach(child, frame=frame, prefix=prefix)
    m = parent.compile()
    d = mujoco.MjData(m)
    d.joint("left_elbow").qpos = -1.2
    mujoco.mj_forward(m, d)
    wrap = {side: segment_wrap(m, d, f"{side}_bowden").sum() for side in
            ("left", "right")}  # fmt: skip
    assert wrap["left"] > wrap["right"] + 0.5


def test_route_that_is_no_spatial_tendon_is_refused() -> None:
    xml = LIMB.format(integrator="Euler", more="").replace('value="path"', 'value="p"')
    with pytest.raises(ValueError, match="`route` is 'p'"):
        mujoco.MjModel.from_xml_string(xml)


WIDE = '<config key="clearance" value="2e-3"/>'


def wide_stretch(m: mujoco.MjModel, d: mujoco.MjData, tension: float) -> float:
    """Stretch of the cable of `limb` with 2 mm of clearance in its pose [m]."""
    seated = tension / (tension + 5.0)
    return 0.9 * tension / 4000.0 + 2e-3 * route_wrap(m, d, "bowden") * seated


def loose_limb(integrator: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return a limb whose cable has clearance and no friction, in `qpos0`."""
    xml = LIMB.format(integrator=integrator, more=WIDE).replace(
        '"friction" value="0.2"', '"friction" value="0"'
    )
    m = mujoco.MjModel.from_xml_string(xml)
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    return m, d


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_clearance_takes_what_the_bends_of_the_route_need(integrator: str) -> None:
    m, d = loose_limb(integrator)
    near, far = m.actuator("near").id, m.actuator("far").id
    rest = wide_stretch(m, d, 20.0) - d.actuator_length[far] + d.actuator_length[near]
    before = route_wrap(m, d, "bowden")
    for elbow in (0.9, 0.3):
        d.ctrl[:2] = 0.3, elbow
        mujoco.mj_step(m, d, 2000)
        assert abs(route_wrap(m, d, "bowden") - before) > 0.04
        before = route_wrap(m, d, "bowden")
        stretch = rest + d.actuator_length[far] - d.actuator_length[near]
        taut = read(m, d, "bowden").tension.mean()
        assert wide_stretch(m, d, taut) == pytest.approx(stretch, abs=1e-6)


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
def test_clearance_of_a_mixed_path_takes_what_its_conduit_needs(
    integrator: str,
) -> None:
    """Both ends are tied, so only the bends of the conduit change the tension."""
    mixed = WIDE + '<config key="path" value="mixed"/><config key="mouth" value="c"/>'
    xml = LIMB.format(integrator=integrator, more=mixed)
    for kept, other in (
        ('"friction" value="0.2"', '"friction" value="0"'),
        ('joint="motor" gear="-0.02"', 'tendon="path" gear="-1"'),
        ('joint="wrist" gear="-0.05"', 'tendon="path" gear="1"'),
    ):
        assert kept in xml
        xml = xml.replace(kept, other)
    m = mujoco.MjModel.from_xml_string(xml)
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)

    def rope(tension: float) -> float:
        """Return the unstretched length, of a path 0.9 m and from c to d long [m]."""
        wrap = segment_wrap(m, d, "bowden")[:-1].sum()  # without the corner at c
        path = 0.9 + np.linalg.norm(d.site("d").xpos - d.site("c").xpos)
        play = 2e-3 * wrap * tension / (tension + 5.0)
        return float((path - play) / (1.0 + tension / 4000.0))

    mounted, seen = rope(20.0), [20.0]
    for elbow in (0.9, -0.4, 0.3):
        d.ctrl[1] = elbow
        mujoco.mj_step(m, d, 2000)
        tension = read(m, d, "bowden").tension
        assert np.ptp(tension) < 1e-4 * tension.max()
        seen.append(tension.mean())
        assert abs(seen[-1] - seen[-2]) > 0.5
        assert rope(seen[-1]) == pytest.approx(mounted, abs=1e-9)
    settle(m, d, rope="keep")
    mujoco.mj_forward(m, d)
    assert read(m, d, "bowden").tension == pytest.approx(seen[-1], rel=1e-4)


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
def test_clearance_of_a_mixed_path_forgets_other_poses(integrator: str) -> None:
    """A step depends on state and pose, not on what was evaluated before."""
    mixed = WIDE + '<config key="path" value="mixed"/><config key="mouth" value="c"/>'
    m = limb(integrator, mixed)
    d = mujoco.MjData(m)
    d.ctrl[:2] = 0.3, 0.4
    mujoco.mj_step(m, d, 200)
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    kept = np.empty(mujoco.mj_stateSize(m, kind))
    mujoco.mj_getState(m, d, kept, kind)
    seen = []
    for elbow in (0.0, 0.8):
        other = mujoco.MjData(m)
        other.qpos[m.joint("elbow").qposadr[0]] = elbow
        mujoco.mj_forward(m, other)
        mujoco.mj_setState(m, other, kept, kind)
        mujoco.mj_step(m, other, 3)
        seen.append(read(m, other, "bowden").tension)
    assert seen[0].max() > 10.0
    np.testing.assert_array_equal(*seen)


def test_a_cable_with_clearance_is_mounted_in_the_bends_of_its_pose() -> None:
    m, d = loose_limb("Euler")
    straight = route_wrap(m, d, "bowden")
    mounted = wide_stretch(m, d, 20.0)
    lengths = d.actuator_length.copy()
    d.qpos[m.joint("elbow").qposadr[0]] = 0.9
    mujoco.mj_forward(m, d)
    assert abs(route_wrap(m, d, "bowden") - straight) > 0.1
    settle(m, d, rope="keep")
    mujoco.mj_forward(m, d)
    tension = read(m, d, "bowden").tension
    assert np.ptp(tension) < 1e-9
    moved = d.actuator_length - lengths
    stretch = mounted + moved[m.actuator("far").id] - moved[m.actuator("near").id]
    assert wide_stretch(m, d, tension[0]) == pytest.approx(stretch, abs=1e-9)
    settle(m, d, rope="remount")
    for _ in range(2):
        mujoco.mj_forward(m, d)
        assert read(m, d, "bowden").tension == pytest.approx(20.0, rel=1e-9)
