"""Places of a path from a body close to it, against MuJoCo's kinematics."""

from __future__ import annotations

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp

from cc_mujoco.cable import _path_geometry as geometry
from cc_mujoco.warp._paths import Views, links_of
from cc_mujoco.warp._place_kernels import Links, Pose, read_places

ARM = """
<mujoco>
  <worldbody>
    <body name="aside"><freejoint/><geom size="0.1"/> <site name="tether"/></body>
    <body name="base" pos="80 -60 0.3">
      {joint} <geom size="0.1"/>
      <site name="root" pos="0.1 0.2 0.3"/>
      <body name="upper" pos="0.3 0.1 0.2" euler="10 20 30">
        <joint type="slide" axis="1 1 0"/>
        <joint axis="0 1 1" pos="0.05 0.1 -0.02"/>
        <joint axis="1 0 0.2" pos="-0.03 0.02 0.1" ref="0.3"/>
        <geom size="0.05"/>
        <body pos="0.1 0 0.2"> <site name="fixed" pos="0.01 0.02 0.03"/>
          <geom size="0.01"/>
          <body name="lower" pos="0 0.1 0.2" euler="0 40 0">
            <joint type="ball" pos="0.03 0 0.02"/>
            <geom name="drum" type="cylinder" size="0.07 0.2" euler="20 0 0"
              pos="0.26 -0.015 -0.06"/>
            <geom name="ball" size="0.1" pos="0.2 0 0"/>
            <body pos="0.3 0 0"> <joint axis="0 0 1"/> <geom size="0.01"/>
              <site name="tip" pos="0.1 0.05 0"/>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon>
    <spatial> <site site="tether"/> <site site="root"/> </spatial>
    <spatial>
      <site site="{first}"/> <site site="fixed"/> <geom geom="drum"/>
      <site site="tip"/> <geom geom="ball"/> <site site="fixed"/>
    </spatial>
  </tendon>
</mujoco>
"""
KINDS = {4: geometry.SPHERE, 5: geometry.CYLINDER}


@wp.kernel(module="unique", enable_backward=False)
def _read(
    links: Links, pose: Pose, start: int, number: int, kinds: wp.array(dtype=float),
    objects: wp.array(dtype=int), near: wp.array2d(dtype=float),
    places: wp.array2d(dtype=float),
):  # fmt: skip
    world = wp.tid()
    read_places(
        links, pose, 1, world, start, number, kinds, objects, near[world], places[world]
    )


@pytest.mark.parametrize("first", ["root", "tether"])
@pytest.mark.parametrize("joint", ["<freejoint/>", '<joint axis="0 0 1"/>', ""])
def test_distances_in_a_path_are_right_100_m_from_the_origin(first, joint):
    model = mujoco.MjModel.from_xml_string(ARM.format(joint=joint, first=first))
    data, rng = mujoco.MjData(model), np.random.default_rng(1)
    mujoco.mj_integratePos(model, data.qpos, rng.normal(size=model.nv), 0.5)
    free = [0] + [7] * (joint == "<freejoint/>")
    for at in free:  # in the float32 that both have
        data.qpos[at : at + 3] = np.float32([80.4, -60.1, 0.7]) + np.float32(at / 8)
    mujoco.mj_forward(model, data)
    m, d = mjw.put_model(model), mjw.put_data(model, data, nworld=1)
    start, number = int(model.tendon_adr[1]), int(model.tendon_num[1])
    things = model.wrap_objid
    kinds = [KINDS.get(int(kind), geometry.SITE) for kind in model.wrap_type]
    is_site = model.wrap_type == mujoco.mjtWrap.mjWRAP_SITE
    bodies = np.where(
        is_site, model.site_bodyid[things % model.nsite], model.geom_bodyid[things]
    ).astype(np.int32)
    links, most = links_of(model, [1], bodies, "cpu")
    near = wp.zeros((1, 3 * most + 3), dtype=float)
    places = wp.zeros((1, geometry.PLACE_SIZE * number), dtype=float)
    wp.launch(
        _read, dim=1,
        inputs=[
            links, Views(Pose, "qpos").of(m, d), start, number,
            wp.array(kinds, dtype=float), wp.array(things, dtype=int), near, places,
        ],
    )  # fmt: skip
    found = places.numpy()[0].reshape(number, -1).astype(float)
    touching = found[:, geometry.TOUCHED] != 0.0
    points = []
    for k in range(number):
        sides = (
            (geometry.FIRST, geometry.LAST) if kinds[start + k] else [geometry.FIRST]
        )
        if not kinds[start + k] or touching[k]:
            points += [found[k, side : side + 3] for side in sides]
    at = int(data.ten_wrapadr[1])
    right = data.wrap_xpos.reshape(-1, 3)[at : at + int(data.ten_wrapnum[1])]
    assert len(points) == len(right)
    assert touching.sum() == 2
    # Along the surface points are as coarse as they are; their paths are not.
    np.testing.assert_allclose(
        np.linalg.norm(np.diff(points, axis=0), axis=1).sum(),
        np.linalg.norm(np.diff(right, axis=0), axis=1).sum(),
        atol=1e-6,
    )
    sites = [k for k in range(number) if not kinds[start + k]]
    own = found[sites, geometry.FIRST : geometry.FIRST + 3]
    places_right = data.site_xpos[things[start + np.array(sites)]]
    np.testing.assert_allclose(own - own[0], places_right - places_right[0], atol=1e-6)
