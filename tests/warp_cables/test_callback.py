"""The callback by itself: lengths and times given by hand, without a step of MuJoCo."""

from __future__ import annotations

import subprocess
import sys

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp

import cc_mujoco
from cc_mujoco.assets import scene_path
from cc_mujoco.cable import Cable, Section
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _layout as at
from cc_mujoco.cable._conduit import packed_parameters
from cc_mujoco.errors import CableError
from cc_mujoco.warp import HeldCable, add_end, attach, without_plugin

CABLE = Cable(friction=0.2, static_friction=0.3, conduit=(Section(1.0, 0.3),))
SHORT = CABLE.replace(segments=8)
WORLDS, DT = 3, 2e-3


def scene(*cables: Cable, integrator: str = "Euler") -> mujoco.MjSpec:
    spec = mujoco.MjSpec.from_string(
        f"<mujoco><option timestep='{DT}' integrator='{integrator}'/></mujoco>"
    )
    for name in ("motor", "wrist"):
        body = spec.worldbody.add_body(mass=50.0, inertia=[9.0, 9.0, 9.0])
        body.add_joint(name=name)
    for i, cable in enumerate(cables):
        ends = ("motor", (-1) ** i * -0.02), ("wrist", (-1) ** i * -0.05)
        cc_mujoco.plugin.to_mjcf(spec, f"cable{i}", cable, *ends)
    return spec


class Rig:
    """Cables in three worlds whose ends a test moves."""

    def __init__(self, *cables: Cable, **options) -> None:
        self.spec = scene(*cables)
        plain = without_plugin(self.spec).compile()
        self.m = mjw.put_model(plain)
        self.d = mjw.make_data(plain, nworld=WORLDS)
        self.cables = attach(self.m, self.d, self.spec, **options)

    def evaluate(self, step: int, lengths: np.ndarray, calls: int = 1) -> np.ndarray:
        """Return the end tensions (worlds, cables, 2) at lengths (worlds, ends)."""
        self.d.time.fill_(step * DT)
        self.d.actuator_length.assign(lengths.astype(np.float32))
        for _ in range(calls):
            self.m.callback.act_bias(self.m, self.d)
        return self.cables.tensions.numpy().copy()  # else that of the next call


def lengths(steps: int, ends: int) -> np.ndarray:
    """Lengths of actuators (steps, worlds, ends) [m], in single precision."""
    time = np.arange(steps)[:, None, None] * DT
    rate = np.arange(8.0, 8.0 + WORLDS * ends).reshape(WORLDS, ends)
    return (4e-3 * np.sin(rate * time)).astype(np.float32).astype(float)


def reference(cable: Cable, moved: np.ndarray) -> np.ndarray:
    """End tensions (steps, 2) [N] of a cable whose ends move (steps, 2) from rest."""
    n, prm = cable.segments, packed_parameters(cable)
    state, work = np.zeros(kernel.state_size(n)), np.zeros(kernel.work_size(n))
    after, found = state.copy(), np.zeros_like(moved)
    kernel.initialize(prm, n, 0.0, 0.0, state)
    for k, (u, v) in enumerate(moved):
        kernel.advance(prm, n, state, u, v, DT, after, work)
        state, after = after, state
        found[k] = at.tensions(state, n)[[0, n]]
    return np.maximum(found, 0.0)


@pytest.fixture
def rig() -> Rig:
    return Rig(CABLE, SHORT)


def test_tensions_are_those_of_the_kernel_however_often_it_is_asked(rig):
    moved = lengths(150, 4)
    found = np.array([rig.evaluate(k, u, 1 + k % 3) for k, u in enumerate(moved)])
    for world in range(WORLDS):
        for i, cable in enumerate((CABLE, SHORT)):
            right = reference(cable, moved[:, world, 2 * i : 2 * i + 2])
            np.testing.assert_allclose(
                found[:, world, i], right, rtol=0, atol=2e-5 * right.max()
            )
    pulls = rig.d.actuator_force.numpy().reshape(WORLDS, 2, 2)
    np.testing.assert_array_equal(pulls, found[-1] * [1, -1])
    reading = rig.cables.read("cable1")
    assert reading.tension.shape == (WORLDS, SHORT.segments + 1)
    np.testing.assert_array_equal(reading.tension_distal, found[-1, :, 1, 1])


def test_the_reset_of_one_world_leaves_the_others(rig):
    other, moved = Rig(CABLE, SHORT), lengths(60, 4)
    for k in range(30):
        rig.evaluate(k, moved[k]), other.evaluate(k, moved[k])
    time = np.array([30, 0, 30], np.float32) * DT
    anew = []
    for k in range(30, 60):
        whole = other.evaluate(k, moved[k])
        rig.d.time.assign(time + (k - 30) * DT)
        part = moved[k].copy()
        part[1] = moved[k - 30, 1]
        rig.d.actuator_length.assign(part.astype(np.float32))
        rig.m.callback.act_bias(rig.m, rig.d)
        found = rig.cables.tensions.numpy().copy()
        np.testing.assert_array_equal(found[[0, 2]], whole[[0, 2]])
        anew.append(found[1, 0])
    np.testing.assert_allclose(anew, reference(CABLE, moved[:30, 1, :2]), atol=1e-3)


def test_a_reset_at_the_same_time_is_a_call(rig):
    moved = lengths(20, 4)
    for k in range(20):
        rig.evaluate(k, moved[k])
    for flags in ([False, True, False], wp.array([False, True, False], dtype=wp.bool)):
        rig.cables.reset(flags)
        found = rig.evaluate(19, 0.0 * moved[0])
        assert (found[1] == 10.0).all() and (found[0] != 10.0).all()
        rig.evaluate(19, moved[19])


def test_cables_by_name_need_no_plugin(rig):
    spec = mujoco.MjSpec.from_string(f"<mujoco><option timestep='{DT}'/></mujoco>")
    for name in ("motor", "wrist"):
        body = spec.worldbody.add_body(mass=50.0, inertia=[9.0, 9.0, 9.0])
        body.add_joint(name=name)
    held = {}
    for i, cable in enumerate((CABLE, SHORT)):
        for joint, radius in (("motor", -0.02), ("wrist", -0.05)):
            add_end(spec, f"{joint}{i}", (-1) ** i * radius, joint=joint)
        held[f"cable{i}"] = HeldCable(cable, f"motor{i}", 2 * i + 1)
    model = spec.compile()
    other = object.__new__(Rig)
    other.m, other.d = mjw.put_model(model), mjw.make_data(model, nworld=WORLDS)
    other.cables = attach(other.m, other.d, model, cables=held)
    for k, u in enumerate(lengths(30, 4)):
        np.testing.assert_array_equal(other.evaluate(k, u), rig.evaluate(k, u))
    with pytest.raises(CableError, match=r"actuator 'motor2'.*motor1"):
        wrong = {"cable0": HeldCable(CABLE, "motor2", "wrist0")}
        attach(other.m, other.d, model, cables=wrong)
    with pytest.raises(CableError, match="an MjModel, not MjSpec"):
        attach(other.m, other.d, spec, cables=held)


@pytest.mark.parametrize(
    ("target", "what"),
    [
        ({"joint": "moter"}, "motor"),
        ({"tendon": "cord"}, "tendon"),
        ({}, "either a joint or a tendon"),
        ({"joint": "motor", "tendon": "cord"}, "either a joint or a tendon"),
    ],
)
def test_ends_that_cannot_be_are_refused(target, what):
    with pytest.raises(CableError, match=what):
        add_end(scene(), "end", 0.02, **target)
    with pytest.raises(CableError, match="not 0"):
        add_end(scene(), "end", 0.0, joint="motor")


def test_every_world_has_parameters_of_its_own(rig):
    friction = np.array([0.05, 0.2, 0.25])
    rig.cables.vary("cable0", friction=friction, axial_stiffness=3000.0)
    moved = lengths(60, 4)
    found = np.array([rig.evaluate(k, u) for k, u in enumerate(moved)])
    for world in range(WORLDS):
        own = CABLE.replace(friction=friction[world], axial_stiffness=3000.0)
        right = reference(own, moved[:, world, :2])
        np.testing.assert_allclose(
            found[:, world, 0], right, rtol=0, atol=2e-5 * right.max()
        )


def test_the_layout_of_a_gpu_gives_the_same_bits(rig, monkeypatch):
    monkeypatch.setattr("cc_mujoco.warp._cables._is_interleaved", lambda device: True)
    other, moved = Rig(CABLE, SHORT), lengths(40, 4)
    for k in range(40):
        np.testing.assert_array_equal(
            other.evaluate(k, moved[k]), rig.evaluate(k, moved[k])
        )
    np.testing.assert_array_equal(
        other.cables.read("cable1").tension, rig.cables.read("cable1").tension
    )
    launched, launch = [], wp.launch
    monkeypatch.setattr(
        wp, "launch", lambda k, *a, **b: launched.append(k) or launch(k, *a, **b)
    )
    other.m.callback.act_bias(other.m, other.d)
    assert launched == list(other.cables.kernels.values())


def test_rest_in_the_pose_of_the_world():
    rig = Rig(CABLE, rest_in_pose=True)
    assert (rig.evaluate(0, lengths(40, 2)[-1]) == CABLE.pretension).all()


@pytest.mark.parametrize(
    ("wanted", "what"),
    [
        ({"friction": [0.1, 0.2, 9.0]}, r"friction.* 9.0.*\[0, 5\]"),
        ({"static_friction": 0.1}, "static_friction.*at least"),
        ({"viscous_friction": 2.0}, r"terms=\('viscous_friction',\)"),
        ({"frictoin": 0.1}, "friction"),
        ({"clearance": "abc"}, "cable 'cable0': clearance must be numbers, not 'abc'"),
        ({"clearance": None}, "cable 'cable0': clearance must be numbers, not None"),
        ({"friction": 5.1}, "`friction` is 5.1; it must be"),
    ],
)
def test_parameters_that_cannot_be_are_refused(rig, wanted, what):
    with pytest.raises(CableError, match=what):
        rig.cables.vary("cable0", **wanted)


@pytest.mark.parametrize("world", [WORLDS, -1, 1.7, True, "a", 99999999999])
def test_a_world_that_is_none_of_the_data_is_refused(rig, world):
    before = rig.cables.values.numpy()
    with pytest.raises(CableError, match="is not one of 0 to 2"):
        rig.cables.assign("cable0", {0: CABLE.replace(friction=0.1), world: CABLE})
    np.testing.assert_array_equal(rig.cables.values.numpy(), before)


def test_what_is_no_cable_or_flag_is_refused(rig):
    with pytest.raises(CableError, match="world 0 must be a Cable, not 'x'"):
        rig.cables.assign("cable0", {0: "x"})
    with pytest.raises(CableError, match="a cable by world, not 'x'"):
        rig.cables.assign("cable0", "x")
    for worlds in ("x", [0, 1, 2], [[True], [True, False]]):
        with pytest.raises(CableError, match="true or false for each of the 3"):
            rig.cables.reset(worlds)


def test_a_scene_without_its_plugin_has_no_cables():
    own = scene(CABLE)
    plain = without_plugin(own)
    assert cc_mujoco.from_mjcf(plain) == {}
    assert len(without_plugin(plain).actuators) == len(own.actuators)
    model = plain.compile()
    m, d = mjw.put_model(model), mjw.make_data(model, nworld=1)
    with pytest.raises(CableError, match="that you gave to `without_plugin`"):
        attach(m, d, plain)
    with pytest.raises(CableError, match="terms must be a list of texts"):
        attach(m, d, own, terms="clearance")
    with pytest.raises(CableError, match="'cable0' must be a HeldCable"):
        attach(m, d, model, cables={"cable0": CABLE})


def test_a_written_scene_is_one_with_cables():
    own = mujoco.MjSpec.from_file(str(scene_path("wrist")))
    own.compile()
    again = mujoco.MjSpec.from_string(own.to_xml())
    assert without_plugin(again).compile().nplugin == 0


def test_what_is_not_supported_is_refused_in_one_sentence():
    plain = without_plugin(scene(CABLE)).compile()
    m, d = mjw.put_model(plain), mjw.make_data(plain, nworld=1)
    for source, what in (
        (scene(), "no cable"),
        (scene(CABLE, SHORT), "not of the scene with its cables"),
    ):
        with pytest.raises(CableError, match=what):
            attach(m, d, source)
    for key, other in (("bend", "route"), ("path", "open")):
        led = HeldCable(CABLE.replace(**{key: other, "route": "cord"}), 0, 1)
        with pytest.raises(CableError, match=f"{key}='{other}' needs the tendon"):
            attach(m, d, plain, cables={"cable0": led})
    with pytest.raises(CableError, match="not RK4"):
        without_plugin(scene(CABLE, integrator="RK4"))
    m.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    with pytest.raises(CableError, match="not RK4"):
        attach(m, d, scene(CABLE))
    assert m.callback.act_bias is None


def test_a_missing_package_is_named(monkeypatch):
    for name in list(sys.modules):
        if name.startswith("cc_mujoco.warp"):
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "mujoco_warp", None)
    with pytest.raises(ImportError, match=r"pip install 'cc_mujoco\[warp\]'"):
        __import__("cc_mujoco.warp")


@pytest.mark.study
def test_cables_attached_by_name_need_no_plugin():
    # mjlab needs MuJoCo 3.11, on which the plugin does not load.
    program = """
import sys, mujoco, cc_mujoco
names = [name for name in sys.modules if name.startswith("cc_mujoco.plugin")]
sys.modules.update(dict.fromkeys(names))
from cc_mujoco.warp import AttachedCables, HeldCable, attach
"""
    assert subprocess.run([sys.executable, "-P", "-c", program]).returncode == 0
