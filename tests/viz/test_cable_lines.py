"""Every cable is drawn, with or without a route, and so is the rope at its ends."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from cc_mujoco import plugin
from cc_mujoco.assets import scene_path
from cc_mujoco.viz._cable_lines import CONDUIT, JOINT_END, cable_lines, line_notes

SCENE = """<mujoco>
  <extension><plugin plugin="cc_mujoco.cable"><instance name="flexor">
    <config key="conduit" value="0.5:0.2"/><config key="axial_stiffness" value="4000"/>
    <config key="pretension" value="10"/><config key="friction" value="0.1"/>
    <config key="segments" value="8"/>{route}
  </instance></plugin></extension>
  <worldbody>
    <site name="out" pos="0 0 0.1"/><site name="clamp" pos="0.8 0 0.1"/>
    <body><joint name="drum" axis="0 1 0" armature="1e-3"/><geom size="0.02"/></body>
    <body pos="1 0 0"><joint name="elbow" axis="0 1 0"/><geom size="0.05"/>
      <site name="lever" pos="0 0 0.1"/></body>
  </worldbody>
  <tendon>
    <spatial name="way" width="0.01"><site site="out"/><site site="clamp"/></spatial>
    <spatial name="rope"><site site="clamp"/><site site="lever"/></spatial>
  </tendon>
  <actuator>
    <plugin plugin="cc_mujoco.cable" instance="flexor" joint="drum" gear="-0.02"/>
    <plugin plugin="cc_mujoco.cable" instance="flexor" {end}/>
  </actuator>
</mujoco>"""
ON_ROPE = 'tendon="rope" gear="1"'
TENSION = np.linspace(30.0, 14.0, 9)


def scene(end: str, route: str = "", without: str = "") -> mujoco.MjModel:
    keyed = f'<config key="route" value="{route}"/>' if route else ""
    text = SCENE.format(end=end, route=keyed)
    if without:
        start = text.index(f'<spatial name="{without}"')
        stop = text.index("</spatial>", start) + len("</spatial>")
        text = text[:start] + text[stop:]
    return mujoco.MjModel.from_xml_string(text)


def at_rest(model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    return data


@pytest.mark.parametrize("route", ["", "way"])
def test_conduit_lies_on_its_way_and_the_rope_has_the_tension_of_its_end(
    route: str,
) -> None:
    model = scene(ON_ROPE, route)
    conduit, rope = cable_lines(model, ("flexor",))
    assert (conduit.part, rope.part) == (CONDUIT, JOINT_END)
    assert conduit.radius == pytest.approx(0.01)
    points = conduit.points(model, at_rest(model))
    assert points[[0, -1]] == pytest.approx(np.array([[0, 0, 0.1], [0.8, 0, 0.1]]))
    parts = conduit.tensions(TENSION)
    assert np.all(np.diff(parts) < 0.0)
    assert rope.tensions(TENSION) == pytest.approx(TENSION[-1])
    assert conduit.nodes(9)[[0, -1]] == pytest.approx([0.0, 8.0])
    assert rope.nodes(9) == pytest.approx(8.0)
    (*notes,) = line_notes(model, ("flexor",))
    assert len(notes) == (0 if route else 1)
    assert route or "has no `route`: it is drawn along tendon 'way'" in notes[0]


def test_cable_without_a_way_is_drawn_straight_to_the_near_end_of_its_rope() -> None:
    model = scene(ON_ROPE, without="way")
    conduit, rope = cable_lines(model, ("flexor",))
    ends = conduit.points(model, at_rest(model))[[0, -1]]
    assert ends[1] == pytest.approx([0.8, 0.0, 0.1])
    assert np.linalg.norm(ends[0]) == pytest.approx(0.02)  # on the rim of the drum
    assert rope.part == JOINT_END
    assert "drawn straight" in next(line_notes(model, ("flexor",)))


def test_cable_between_joints_runs_from_pulley_to_pulley_on_the_side_it_pulls() -> None:
    ends = {}
    for gear in (-0.06, 0.06):
        model = scene(f'joint="elbow" gear="{gear}"', without="way")
        (line,) = cable_lines(model, ("flexor",))
        data = at_rest(model)
        points = line.points(model, data)
        assert points[0] == pytest.approx([0.0, 0.0, points[0, 2]])
        assert points[-1, 0] == pytest.approx(1.0)
        ends[gear] = points[-1, 2]
        # A joint that turns by one radian moves the rim by the radius along the cable.
        arm = points[-1] - data.xanchor[1]
        along = np.array([1.0, 0.0, 0.0])
        assert np.cross(data.xaxis[1], arm) @ along == pytest.approx(gear)
    assert ends[0.06] == pytest.approx(-ends[-0.06])


def test_cable_between_joints_at_one_place_is_reported() -> None:
    text = SCENE.format(end='joint="elbow" gear="0.02"', route="")
    text = text.replace('<body pos="1 0 0">', "<body>")
    start, stop = text.index("<tendon>"), text.index("</tendon>") + len("</tendon>")
    model = mujoco.MjModel.from_xml_string(text[:start] + text[stop:])
    assert cable_lines(model, ("flexor", "other")) == []
    (note,) = line_notes(model, ("flexor", "other"))
    assert note == (
        "cable 'flexor' has no `route`: it is not drawn, as both of its ends are at "
        "one place."
    )


@pytest.mark.parametrize(("name", "ropes"), [("wrist", 2), ("ankle", 1), ("finger", 0)])
def test_ropes_of_built_in_scenes_are_coloured(name: str, ropes: int) -> None:
    model = mujoco.MjModel.from_xml_path(str(scene_path(name)))
    cables = plugin.cables(model)
    parts = [line.part for line in cable_lines(model, cables)]
    assert parts.count(CONDUIT) == len(cables)
    assert parts.count(JOINT_END) == ropes
    assert list(line_notes(model, cables)) == []
