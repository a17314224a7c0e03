"""Triangles of geoms: closed, turned outwards, of the right size."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cc_mujoco.viz._web_page import geom_mesh, join_meshes

VOLUMES = {
    "sphere": lambda x, y, z: 4 / 3 * np.pi * x**3,
    "ellipsoid": lambda x, y, z: 4 / 3 * np.pi * x * y * z,
    "capsule": lambda x, y, z: 4 / 3 * np.pi * x**3 + 2 * np.pi * x**2 * y,
    "cylinder": lambda x, y, z: 2 * np.pi * x**2 * y,
    "box": lambda x, y, z: 8 * x * y * z,
}
sizes = st.floats(0.01, 1.0)


@pytest.mark.parametrize("shape", VOLUMES)
@given(x=sizes, y=sizes, z=sizes, reach=st.floats(0.1, 50.0))
@settings(max_examples=20)
def test_volume_is_that_of_the_shape(
    shape: str, x: float, y: float, z: float, reach: float
) -> None:
    """By the divergence theorem, so that a triangle turned inwards would count less."""
    geom = f'<geom type="{shape}" size="{x} {y} {z}"/>'
    xml = f"<mujoco><worldbody>{geom}</worldbody></mujoco>"
    model = mujoco.MjModel.from_xml_string(xml)
    vertices, triangles = geom_mesh(model, 0, reach)
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    exact = VOLUMES[shape](*model.geom_size[0])
    volume = float((np.cross(a, b) * c).sum()) / 6
    assert volume <= exact * (1 + 1e-9)
    assert volume > (0.9 if shape != "box" else 1 - 1e-9) * exact
    # Closed: directed areas cancel.
    assert np.cross(b - a, c - a).sum(axis=0) == pytest.approx(0.0, abs=1e-9)
    half = model.geom_aabb[0, 3:]
    assert np.abs(vertices).max(axis=0) == pytest.approx(half, rel=0.06)


def test_a_plane_is_cut_off_where_nothing_is_to_see() -> None:
    xml = '<mujoco><worldbody><geom type="plane" size="0 2 1"/></worldbody></mujoco>'
    vertices, _ = geom_mesh(mujoco.MjModel.from_xml_string(xml), 0, 3.0)
    assert np.abs(vertices).max(axis=0).tolist() == [3.0, 2.0, 0.0]


def test_joined_triangles_keep_their_corners() -> None:
    xml = """<mujoco><worldbody><geom type="box" size=".1 .2 .3"/>
      <geom type="sphere" size=".1"/></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    one, other = (geom_mesh(model, geom, 1.0) for geom in range(2))
    both = join_meshes([one, other])
    corners = [m.vertices[m.triangles] for m in (one, other)]
    assert np.array_equal(both.vertices[both.triangles], np.concatenate(corners))
