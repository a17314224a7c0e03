"""Models without what only draws move as the whole ones."""

from __future__ import annotations

from pathlib import Path

import gymnasium
import mujoco
import numpy as np
import pytest

from cc_mujoco import assets, plugin
from cc_mujoco.device._strip_visuals import (
    remaining_cable,
    route_tendons,
    strip,
)
from shared_folder import SHARED

ASSETS = Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets"
CASES = SHARED / "cases" / "device"
STEPS = 200
BUILT_IN = Path(assets.__file__).parent
SCENES = sorted(path.name for path in BUILT_IN.glob("*.xml"))

ROOMY = """<mujoco model="roomy">
  <compiler angle="degree" {compiler}/>
  <option timestep=".002" {option}><flag {flag}/></option>
  <size memory="1M"/>
  <asset>
    <texture name="t" type="2d" builtin="flat" width="8" height="8"/>
    <material name="painted" texture="t"/>
    <mesh name="wedge" vertex="0 0 0 .2 0 0 0 .1 0 0 0 .15 .1 .1 .1"/>
    <mesh name="picture" vertex="0 0 0 .1 0 0 0 .1 0 0 0 .1"/>
    <hfield name="hills" nrow="2" ncol="2" size="3 3 .1 .1" elevation="0 1 1 0"/>
  </asset>
  <default>
    <geom material="painted"/>
    <default class="limb"><geom type="capsule" size=".04" density="900"/>
      <joint damping=".2" armature=".001"/></default>
    <default class="drawn"><geom contype="0" conaffinity="0" group="1"/></default>
  </default>
  <worldbody>
    <light pos="0 0 3"/><camera name="eye" pos="0 -3 1"/>
    <geom name="ground" type="hfield" hfield="hills"/>
    <site name="anchor" pos="0 0 1.5"/><site name="decoration" pos="0 0 2"/>
    <body name="aim" mocap="true" pos="1 1 1"/>
    <frame euler="0 20 0" pos="0 0 .4">
      <body name="trunk"><freejoint name="root"/>
        <geom type="mesh" mesh="wedge" pos=".05 0 0" euler="10 20 30"/>
        <geom class="drawn" type="mesh" mesh="picture" pos=".1 .2 0"/>
        <geom class="drawn" type="box" size=".1 .05 .2" pos="0 .1 .1" mass="2"/>
        <body name="head" pos="0 0 .3"><geom class="drawn" size=".08" pos="0 .02 .1"/>
          <body name="tip" pos="0 0 .1"/></body>
        <body name="upper" pos=".1 0 -.1" childclass="limb"><joint name="shoulder"
            axis="0 1 0" range="-60 60"/>
          <geom fromto="0 0 0 .3 0 0"/>
          <geom name="bone" class="drawn" type="cylinder" size=".05 .1" pos=".15 0 0"/>
          <site name="elbow_in" pos=".25 .06 0"/>
          <body name="lower" pos=".3 0 0"><joint name="elbow" axis="0 1 0"
              range="0 120" stiffness="2" springref="30"/>
            <geom fromto="0 0 0 .2 0 0" contype="0" conaffinity="0"/>
            <geom class="drawn" type="ellipsoid" size=".1 .05 .05"
              fluidshape="ellipsoid" mass=".3"/>
            <site name="hand" pos=".2 0 0"/><site name="side" pos=".1 .1 0"/>
          </body></body>
        <body name="stated" pos="-.2 0 0"><inertial pos="0 .05 0" mass="1"
            fullinertia=".02 .03 .04 .001 .002 .003"/>
          <joint name="tail" axis="0 0 1"/><geom class="drawn" size=".05"/></body>
      </body>
    </frame>
  </worldbody>
  <contact><exclude body1="trunk" body2="upper"/><exclude body1="trunk" body2="tip"/>
  </contact>
  <tendon>
    <spatial name="strap" stiffness="40" springlength=".5" material="painted">
      <site site="anchor"/><geom geom="bone" sidesite="side"/><site site="hand"/>
    </spatial>
    <spatial name="drawing"><site site="anchor"/><site site="elbow_in"/></spatial>
    <fixed name="sum" range="-80 80"><joint joint="elbow" coef="1"/>
      <joint joint="shoulder" coef="-1"/></fixed>
    <spatial name="muscle"><site site="elbow_in"/><site site="hand"/></spatial>
  </tendon>
  <equality><connect site1="hand" site2="anchor" active="false"/>
    <weld body1="aim" body2="trunk" active="false"/>
    <joint joint1="tail" joint2="elbow" polycoef="0 .5 0 0 0"/></equality>
  <actuator>
    <motor name="push" site="hand" refsite="elbow_in" gear="0 0 3 0 0 0"/>
    <muscle name="flexor" tendon="muscle" force="20" {muscle}/>
    <position name="servo" jointinparent="shoulder" kp="20"/>
  </actuator>
  <sensor><framepos objtype="site" objname="decoration"/><jointpos joint="elbow"/>
  </sensor>
  <custom><tuple name="group"><element objtype="geom" objname="ground"/></tuple>
  </custom>
  <keyframe><key name="low" mpos="1 2 3"/></keyframe>
</mujoco>"""
VARIANTS = {
    "contacts": {},
    "no contacts": {"flag": 'contact="disable"'},
    "in water": {"option": 'density="1000" viscosity="1e-3"'},
    "inferred": {
        "compiler": 'inertiafromgeom="true"',
        "muscle": 'lengthrange=".1 .4"',
    },
    "bounded": {"compiler": 'boundmass=".5" boundinertia=".01" balanceinertia="true"'},
    "groups": {"compiler": 'inertiagrouprange="0 0" boundmass=".1" boundinertia=".01"'},
    "fused": {"compiler": 'fusestatic="true"'},
    "discarded": {"compiler": 'discardvisual="true"'},
    "aligned": {"compiler": 'alignfree="true"'},
}


def roomy(variant: str) -> mujoco.MjSpec:
    blank = dict.fromkeys(("compiler", "option", "flag", "muscle"), "")
    return mujoco.MjSpec.from_string(ROOMY.format(**blank | VARIANTS[variant]))


def bare(whole: mujoco.MjSpec) -> mujoco.MjSpec:
    """Return the stripped scene, with its cables."""
    cables = plugin.from_mjcf(whole)
    spec = strip(whole, route_tendons(cables.values()))
    for name, cable in cables.items():
        plugin.to_mjcf(spec, name, remaining_cable(spec, cable))
    return spec


def motion(spec: mujoco.MjSpec) -> np.ndarray:
    """Return positions and velocities over a driven motion, (steps, nq + nv)."""
    model = spec.copy().compile()
    data = mujoco.MjData(model)
    data.qvel[:] = 0.3 * np.random.default_rng(0).standard_normal(model.nv)
    rows = []
    for step in range(STEPS):
        data.ctrl[:] = 0.2 * np.sin(step / 30.0 + np.arange(model.nu))
        mujoco.mj_step(model, data)
        rows.append([*data.qpos, *data.qvel])
    return np.array(rows)


def require_same_motion(whole: mujoco.MjSpec) -> mujoco.MjModel:
    expected = motion(whole)
    stripped = bare(whole)
    assert np.abs(motion(stripped) - expected).max() < 1e-12 * np.abs(expected).max()
    return stripped.compile()


@pytest.mark.parametrize("scene", SCENES)
def test_scenes_with_stated_inertias_move_bit_for_bit(scene: str) -> None:
    whole = mujoco.MjSpec.from_file(str(BUILT_IN / scene))
    stripped = bare(whole)
    assert motion(stripped).tobytes() == motion(whole).tobytes()
    assert 1 << 16 <= stripped.compile().narena < 20 << 16


@pytest.mark.parametrize(
    "file", ["humanoid", "ant", "walker2d", "hopper", "half_cheetah", "swimmer"]
)
@pytest.mark.filterwarnings("ignore:.*settotalmass:UserWarning")
def test_models_of_gymnasium_move_as_the_whole_ones(file: str) -> None:
    whole = mujoco.MjSpec.from_file(str(ASSETS / f"{file}.xml"))
    model = require_same_motion(whole)
    if model.ngeom:
        assert model.narena == whole.copy().compile().narena
    assert model.ncam == model.nlight == model.nmat == 0


@pytest.mark.parametrize("variant", VARIANTS)
def test_a_scene_with_everything_moves_as_the_whole_one(variant: str) -> None:
    model = require_same_motion(roomy(variant))
    assert [model.tendon(i).name for i in range(model.ntendon)] == [
        "strap",
        "sum",
        "muscle",
    ]
    assert model.nsensor == model.ntuple == model.nmat == 0
    assert {model.site(i).name for i in range(model.nsite)} == {
        "anchor",
        "elbow_in",
        "hand",
        "side",
    }


def test_only_what_can_collide_keeps_its_shape() -> None:
    touching, apart = (bare(roomy(v)).compile() for v in ("contacts", "no contacts"))
    assert [touching.mesh(i).name for i in range(touching.nmesh)] == ["wedge"]
    assert touching.nhfield == 1
    assert (apart.nmesh, apart.nhfield) == (0, 0)
    # The wrapping geom of a tendon.
    assert [apart.geom(i).name for i in range(apart.ngeom)] == ["bone"]


@pytest.mark.parametrize("own", ["true", "auto"])
def test_an_attached_part_keeps_its_way_of_finding_inertias(own: str) -> None:
    part = mujoco.MjSpec.from_string(
        f"""<mujoco><compiler inertiafromgeom="{own}"/><worldbody><body name="arm">
        <inertial pos="0 0 0" mass="9" diaginertia="1 1 1"/><joint axis="0 1 0"/>
        <geom size=".1" pos=".2 0 0"/><geom size=".1" contype="0" conaffinity="0"/>
        </body></worldbody></mujoco>"""
    )
    whole = mujoco.MjSpec.from_string(
        '<mujoco><worldbody><geom type="plane" size="1 1 1" pos="0 0 -.5"/>'
        "</worldbody></mujoco>"
    )
    whole.attach(part, prefix="p_", frame=whole.worldbody.add_frame(pos=[0, 0, 0.1]))
    require_same_motion(whole)


def test_included_files_are_found(tmp_path: Path) -> None:
    (tmp_path / "part.xml").write_text(
        '<mujoco><worldbody><body><joint axis="0 1 0"/><geom type="mesh" mesh="tetra"/>'
        "</body></worldbody></mujoco>"
    )
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "tetra.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    )
    (tmp_path / "scene.xml").write_text(
        '<mujoco><compiler meshdir="meshes"/><option><flag contact="disable"/></option>'
        '<asset><mesh name="tetra" file="tetra.obj"/></asset>'
        '<include file="part.xml"/></mujoco>'
    )
    model = require_same_motion(mujoco.MjSpec.from_file(str(tmp_path / "scene.xml")))
    assert model.ngeom == model.nmesh == 0


CLOTH = """<mujoco><option timestep="1e-3"/><worldbody>
  <geom size=".1" pos="0 0 -.15"/><geom size=".1" contype="0" conaffinity="0"/>
  <flexcomp name="cloth" type="grid" count="4 4 1" spacing=".05 .05 .05" radius=".01"
    mass=".1" dim="2"><edge equality="true"/><pin id="0"/></flexcomp>
</worldbody></mujoco>"""


def test_a_cloth_moves_as_in_the_whole_scene() -> None:
    require_same_motion(mujoco.MjSpec.from_string(CLOTH))


@pytest.mark.shared
@pytest.mark.parametrize("case", ["elbow", "knee_exo", "knee_mid", "knee4"])
def test_devices_without_stated_inertias_move_as_the_whole_ones(case: str) -> None:
    require_same_motion(mujoco.MjSpec.from_file(str(CASES / f"{case}.xml")))
