"""Wrap angles along a tendon agree with the geometry of its path, however it runs."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from cc_mujoco.cable._conduit import node_places
from cc_mujoco.plugin import from_mjcf, route_wrap, segment_wrap
from plugin.scenes import end

ENDS = end("near", "bowden", 'joint="j"', -0.1) + end(
    "far", "bowden", 'joint="k"', -0.1
)


def scene(
    world: str,
    tendon: str,
    segments: int = 40,
    conduit: str = "1:0.5",
    bend: str = "route",
    ends: str = ENDS,
) -> str:
    """Return a scene with a cable along a tendon and two joints that hold its ends."""
    return f"""
<mujoco>
  <extension><plugin plugin="cc_mujoco.cable"><instance name="bowden">
    <config key="conduit" value="{conduit}"/>
    <config key="axial_stiffness" value="4000"/>
    <config key="pretension" value="10"/>
    <config key="friction" value="0.2"/>
    <config key="segments" value="{segments}"/>
    <config key="route" value="path"/>
    <config key="bend" value="{bend}"/>
  </instance></plugin></extension>
  <worldbody>
    {world}
    <body pos="0 0 5"><joint name="j"/><geom size="0.1"/></body>
    <body pos="0 0 6"><joint name="k"/><geom size="0.1"/></body>
  </worldbody>
  <tendon><spatial name="path">{tendon}</spatial></tendon>
  <actuator>{ends}</actuator>
</mujoco>"""


def sites(points: np.ndarray) -> tuple[str, str]:
    """Sites at points, and a tendon through them."""
    world = "".join(
        f'<site name="s{i}" pos="{x!r} {y!r} {z!r}"/>'
        for i, (x, y, z) in enumerate(points.tolist())
    )
    return world, "".join(f'<site site="s{i}"/>' for i in range(len(points)))


def evaluate(xml: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    m = mujoco.MjModel.from_xml_string(xml)
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    return m, d


def test_polygon_of_an_arc_bends_evenly() -> None:
    """Equal chords have the even curvature of their arc but for the outer halves."""
    turn, chords = 0.1, 20
    heading = turn * np.arange(chords)
    steps = 0.05 * np.stack([np.cos(heading), np.sin(heading), 0 * heading], axis=1)
    points = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    m, d = evaluate(scene(*sites(points), segments=2 * chords))
    wrap = segment_wrap(m, d, "bowden")
    assert wrap[[0, -1]] == pytest.approx(0.0, abs=1e-12)
    assert wrap[1:-1] == pytest.approx(turn / 2, rel=1e-9)
    assert route_wrap(m, d, "bowden") == pytest.approx(turn * (chords - 1))


def test_any_polygon_turns_by_the_angles_between_its_pieces() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        points = np.cumsum(rng.normal(size=(rng.integers(2, 9), 3)), axis=0)
        pieces = np.diff(points, axis=0)
        unit = pieces / np.linalg.norm(pieces, axis=1)[:, None]
        turns = np.arccos(np.clip((unit[1:] * unit[:-1]).sum(axis=1), -1.0, 1.0))
        m, d = evaluate(scene(*sites(points), segments=int(rng.integers(1, 60))))
        wrap = segment_wrap(m, d, "bowden")
        assert np.all(wrap >= 0.0)
        assert wrap.sum() == pytest.approx(turns.sum(), rel=1e-7)
        assert route_wrap(m, d, "bowden") == pytest.approx(turns.sum(), rel=1e-7)


def test_bend_of_a_site_lies_around_it() -> None:
    """A right angle after a third of the path is spread half-way to its neighbours."""
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 2, 0.0]])
    m, d = evaluate(scene(*sites(points), segments=12))
    wrap = segment_wrap(m, d, "bowden")
    expected = np.zeros(12)
    expected[2:8] = math.pi / 2 / 6
    assert wrap == pytest.approx(expected, abs=1e-12)


def test_bend_of_a_site_lies_around_it_on_unequal_segments() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 2, 0.0]])
    conduit = "0.3:inf 0.1:0.1 0.2:inf"
    m, d = evaluate(scene(*sites(points), segments=12, conduit=conduit))
    edges = node_places(from_mjcf(m)["bowden"]) / 0.6
    assert np.ptp(np.diff(edges)) > 0.05
    inside = np.diff(np.clip(edges, 0.5 / 3.0, 2.0 / 3.0))
    expected = math.pi / 2 * inside / 0.5
    assert segment_wrap(m, d, "bowden") == pytest.approx(expected, abs=1e-12)


def test_repeated_sites_and_a_straight_path_do_not_bend() -> None:
    points = np.array([[0, 0, 0], [0, 0, 0], [1, 0, 0], [1, 0, 0], [3, 0, 0.0]])
    m, d = evaluate(scene(*sites(points)))
    assert np.all(segment_wrap(m, d, "bowden") == 0.0)


ROUND = """
  <geom name="post" type="{kind}" size="{size}" pos="0.3 -0.2 0.1" euler="{euler}"/>
  <site name="a" pos="{a}"/><site name="b" pos="{b}"/>
  <site name="side" pos="{side}"/>"""
AROUND = '<site site="a"/><geom geom="post" sidesite="side"/><site site="b"/>'


def around(kind: str, a: str, b: str, side: str, euler: str = "0 0 0") -> str:
    size = "0.2" if kind == "sphere" else "0.2 3"
    world = ROUND.format(kind=kind, size=size, a=a, b=b, side=side, euler=euler)
    return scene(world, AROUND, segments=400)


def turned(m: mujoco.MjModel, d: mujoco.MjData) -> float:
    """Angle by which the path turns in all, from its length alone: lengths add up."""
    start = d.ten_wrapadr[0]
    points = d.wrap_xpos.reshape(-1, 3)[start : start + d.ten_wrapnum[0]]
    straight = np.linalg.norm(points[1] - points[0]) + np.linalg.norm(
        points[3] - points[2]
    )
    return float(d.ten_length[0] - straight) / 0.2


@pytest.mark.parametrize("kind", ["sphere", "cylinder"])
@pytest.mark.parametrize(
    ("a", "b", "side"),
    [
        ("-0.7 0 0.1", "0.5 -1.2 0.1", "0.7 0.2 0.1"),
        ("-0.7 -0.1 0.1", "1.3 -0.05 0.1", "0.3 0.3 0.1"),
        ("-0.7 -0.1 0.1", "-0.7 -0.3 0.1", "0.9 -0.2 0.1"),  # half a turn
        ("-0.2 0.1 0.1", "0.2 0.4 0.1", "0.5 -0.7 0.1"),  # most of a turn
    ],
)
def test_arc_around_a_geom_is_its_length_over_its_radius(
    kind: str, a: str, b: str, side: str
) -> None:
    m, d = evaluate(around(kind, a, b, side))
    assert d.ten_wrapnum[0] == 4
    wrap = segment_wrap(m, d, "bowden")
    assert wrap.sum() == pytest.approx(turned(m, d), rel=1e-9)
    # It lies where the arc does, evenly.
    start = np.linalg.norm(d.wrap_xpos.reshape(-1, 3)[1] - d.site("a").xpos)
    along = np.linspace(0.0, d.ten_length[0], 401)
    inside = (along[:-1] > start) & (along[1:] < start + 0.2 * turned(m, d))
    rate = d.ten_length[0] / 400 / 0.2
    assert wrap[inside] == pytest.approx(rate, rel=1e-9)
    assert wrap.sum() - wrap[inside].sum() < 2.0 * rate


def test_helix_bends_less_than_its_circle() -> None:
    """Total curvature of a helix of radius r that turns by f over the length l."""
    m, d = evaluate(around("cylinder", "-0.7 -0.2 -0.9", "1.1 -0.3 1.3", "0.3 0.4 0.1"))
    points = d.wrap_xpos.reshape(-1, 3)[:4]
    middle = np.array([0.3, -0.2])
    first, last = points[1, :2] - middle, points[2, :2] - middle
    turn = math.acos(first @ last / 0.04)
    rise = points[2, 2] - points[1, 2]
    length = math.hypot(0.2 * turn, rise)
    assert rise > 0.05
    assert segment_wrap(m, d, "bowden").sum() == pytest.approx(
        0.2 * turn**2 / length, rel=1e-9
    )


def test_path_inside_a_geom_turns_where_it_touches() -> None:
    """With the side site inside, the tendon touches the geom in a single point."""
    m, d = evaluate(around("cylinder", "-0.2 -0.6 0.1", "0.8 -0.5 0.1", "0.3 -0.1 0.1"))
    points = d.wrap_xpos.reshape(-1, 3)[:4]
    assert np.allclose(points[1], points[2])
    before, after = points[1] - points[0], points[3] - points[2]
    cosine = before @ after / np.linalg.norm(before) / np.linalg.norm(after)
    assert segment_wrap(m, d, "bowden").sum() == pytest.approx(math.acos(cosine))


def test_tilted_cylinder_and_a_path_that_misses_it() -> None:
    m, d = evaluate(
        around("cylinder", "-0.7 0 0.1", "1.3 0 0.1", "0.3 0 0.9", "90 0 0")
    )
    assert segment_wrap(m, d, "bowden").sum() == pytest.approx(turned(m, d), rel=1e-9)
    m, d = evaluate(around("cylinder", "-0.7 0.8 0.1", "1.3 0.8 0.1", "0.3 1 0.1"))
    assert d.ten_wrapnum[0] == 2
    assert np.all(segment_wrap(m, d, "bowden") == 0.0)


SWEPT = """
  <site name="a" pos="-0.5 0.1 0"/><site name="g" pos="-0.2 0.08 0"/>
  <geom name="post" type="cylinder" size="0.05 0.1"/>
  <site name="side" pos="0 0.2 0"/>
  <body><joint name="elbow" axis="0 0 1"/><geom size="0.02" pos="0.3 0 0"/>
    <site name="b" pos="0.2 0.03 0"/><site name="c" pos="0.4 0.05 0.02"/></body>"""
SWEPT_PATH = """<site site="a"/><site site="g"/><geom geom="post" sidesite="side"/>
  <site site="b"/><site site="c"/>"""


def test_wrap_changes_steadily_as_a_joint_bends_the_path() -> None:
    """Also where the path comes to touch the post: no jump, in any segment."""
    m, d = evaluate(scene(SWEPT, SWEPT_PATH, segments=25))
    elbow = m.joint("elbow").qposadr[0]
    count = 4001
    wraps, touches = np.empty((count, 25)), np.empty(count)
    for i, angle in enumerate(np.linspace(0.9, -1.5, count)):
        d.qpos[elbow] = angle
        mujoco.mj_forward(m, d)
        wraps[i], touches[i] = segment_wrap(m, d, "bowden"), d.ten_wrapnum[0]
    assert set(touches) == {4.0, 6.0}
    assert np.abs(np.diff(wraps, axis=0)).max() < 2e-3
    assert wraps[-1].sum() - wraps.sum(axis=1).min() > 1.0


def test_sections_are_what_bends_a_conduit_otherwise() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 2, 0.0]])
    m, d = evaluate(scene(*sites(points), segments=10, bend="fixed"))
    assert segment_wrap(m, d, "bowden") == pytest.approx(np.full(10, 0.2))
    assert route_wrap(m, d, "bowden") == pytest.approx(math.pi / 2)


@pytest.mark.parametrize("segments", [1, 2, 7])
def test_mesh_coarser_than_the_path_keeps_the_whole_angle(segments: int) -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 0.01, 0], [0.99, 0.01, 0], [0, 1, 0]])
    m, d = evaluate(scene(*sites(points), segments=segments))
    fine, e = evaluate(scene(*sites(points), segments=500))
    assert segment_wrap(m, d, "bowden").sum() == pytest.approx(
        segment_wrap(fine, e, "bowden").sum()
    )


def test_a_tendon_of_several_branches_cannot_bend_a_conduit() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 2, 0], [2, 2, 0.0]])
    world, tendon = sites(points)
    halves = tendon.split("/>")
    split = "/>".join([*halves[:2], '<pulley divisor="2"', *halves[2:]])
    with pytest.raises(ValueError, match=r"`bend` is 'route'.*one branch"):
        evaluate(scene(world, split))
    evaluate(scene(world, split, bend="fixed"))
