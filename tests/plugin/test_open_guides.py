"""Sites of an open path that are rollers, or guides of some radius."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest

import cc_mujoco
from cc_mujoco.cable import Cable, Section
from cc_mujoco.errors import CableError
from cc_mujoco.plugin import from_mjcf, read, segment_wrap, tendon_report
from plugin.open_scenes import TIED, atwood, instance, scene

FRICTION, LOAD = 0.2, 4.0 * 9.81
WORLD = (
    '<site name="first" pos="-0.3 0 0"/><site name="up" pos="0 0 0"/>'
    '<site name="down" pos="0 0 -0.3"/><body pos="0.3 0 -0.3">'
    '<joint name="hook" type="slide" axis="1 0 0" damping="200"/>'
    '<geom size="0.02" mass="4"/><site name="hook"/></body>'
)
PATH = "".join(f'<site site="{s}"/>' for s in ("first", "up", "down", "hook"))


def steps(guides: str, name: str = "rope", **keys: object) -> mujoco.MjModel:
    """Return a rope that a weight pulls over two right-angled corners, to the right."""
    given = {"friction": FRICTION, "conduit": "0.9:inf", "axial_stiffness": 2000}
    cable = instance(**(given | keys), **({"guides": guides} if guides else {}))
    text = scene(WORLD, PATH, TIED, cable, 'timestep="0.0002" gravity="9.81 0 0"')
    return mujoco.MjModel.from_xml_string(text.replace("rope", name))


def drawn(m: mujoco.MjModel) -> tuple[float, float, float]:
    """Return the end tensions while the weight creeps down, and its speed."""
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    mujoco.mj_step(m, d, 300)
    reading = read(m, d, "rope")
    assert reading.moving_fraction > 0.0
    return (
        float(reading.tension_proximal),
        float(reading.tension_distal),
        float(d.qvel[0]),
    )


@pytest.mark.parametrize(
    ("guides", "corners"),
    [("", 2), ("up:roller", 1), ("down:roller", 1), ("up:roller down:roller", 0)],
)
def test_a_roller_takes_nothing_of_the_tension(guides: str, corners: int) -> None:
    m = steps(guides, segments=2)
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    assert segment_wrap(m, d, "rope").sum() == pytest.approx(corners * math.pi / 2)
    near, far, _ = drawn(m)
    assert near / far == pytest.approx(math.exp(-FRICTION * corners * math.pi / 2))
    (summary,) = tendon_report(m).tendons
    assert summary.loss == pytest.approx(1.0 - near / far)
    assert str(summary).count(", roller") == guides.count("roller")


@pytest.mark.parametrize("radius", [0.01, 0.05])
def test_the_arc_of_a_guide_takes_drag_per_length(radius: float) -> None:
    """Coulomb friction does not know the radius; load-independent friction does."""
    drag = 100.0
    sharp = drawn(steps("", segments=2))
    round_ = drawn(steps(f"up:{radius}", segments=2))
    assert round_ == pytest.approx(sharp)
    m = steps(f"up:{radius}", segments=2, friction=0, load_independent_friction=drag)
    near, far, _ = drawn(m)
    assert far - near == pytest.approx(drag * radius * math.pi / 2, rel=1e-6)
    place = tendon_report(m).tendons[0].places[0]
    assert place.contact == pytest.approx(radius * math.pi / 2)
    assert place.guide == radius


def test_a_pulley_that_is_a_roller_balances_as_atwoods_machine_without_friction() -> (
    None
):
    free, none = (
        atwood(friction, (1.0, 1.6), 0.02, guides=guides)
        for friction, guides in ((0.3, "rim:roller"), (0.0, ""))
    )
    ends = []
    for m in (free, none):
        d = mujoco.MjData(m)
        mujoco.mj_forward(m, d)
        mujoco.mj_step(m, d, 2000)
        ends.append(np.concatenate([d.qpos, d.qvel]))
    assert ends[0] == pytest.approx(ends[1], abs=1e-9)
    assert abs(ends[0][0]) < 1e-9  # nothing turns the wheel


def test_a_cable_without_guides_is_the_same_bit_by_bit_as_one_without_the_key() -> None:
    plain = steps("", segments=2)
    blank = steps(" ", segments=2)
    assert drawn(plain) == drawn(blank)


def test_friction_is_added_with_guides() -> None:
    spec = mujoco.MjSpec.from_string(scene(WORLD, PATH, "", ""))
    cc_mujoco.add_friction(
        spec, "rope", friction=0.1, guides={"up": "roller", "down": 0.02}
    )
    m = spec.compile()
    cable = from_mjcf(m)["rope"]
    assert cable.guides == (("up", "roller"), ("down", 0.02))
    assert from_mjcf(spec)["rope"] == cable
    (summary,) = tendon_report(m).tendons
    assert [place.guide for place in summary.places] == ["roller", 0.02]


def test_guides_are_found_under_the_prefix_of_an_attached_part() -> None:
    part = mujoco.MjSpec.from_string(scene(WORLD, PATH, "", ""))
    cc_mujoco.add_friction(part, "rope", friction=0.1, guides={"up": "roller"})
    whole = mujoco.MjSpec()
    whole.option.timestep = part.option.timestep
    whole.attach(part, prefix="left_", frame=whole.worldbody.add_frame())
    m = whole.compile()
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    assert segment_wrap(m, d, "left_rope") == pytest.approx([0.0, math.pi / 2])
    (summary,) = tendon_report(m).tendons
    assert [place.guide for place in summary.places] == ["roller", None]


@pytest.mark.parametrize(
    "guides",
    ["up", "up:", ":roller", "up:0", "up:-1", "up:inf", "first:roller", "none:0.1",
     "up:rolle", "up:roller hook:0.1"],
)  # fmt: skip
def test_what_is_no_guide_is_refused_in_one_sentence(guides: str) -> None:
    with pytest.raises(ValueError, match=r"key `guides` is '.*'; it must be with"):
        steps(guides, segments=2)


def test_a_geom_has_its_own_radius() -> None:
    with pytest.raises(ValueError, match=r"key `guides` is 'rim:0\.1'"):
        atwood(0.1, (1.0, 1.0), 0.1, guides="rim:0.1")


def test_python_refuses_guides_that_are_none() -> None:
    conduit = (Section(1.0, math.inf),)
    for guides, path in (
        ((("a b", 0.1),), "open"),
        ((("a", 0.0),), "open"),
        (("a",), "open"),
        (3, "open"),
        ((("a", "roll"),), "open"),
        ((("a", "roller"),), "guided"),
    ):
        with pytest.raises(CableError, match="cable parameter `guides` is"):
            Cable(conduit=conduit, route="r", path=path, guides=guides)


def test_a_path_of_rollers_only_makes_friction_pointless(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)  # for the log of MuJoCo's warnings
    m = steps("up:roller down:roller", "lone", segments=2)
    mujoco.mj_step(m, mujoco.MjData(m))
    assert "key `friction` has no effect" in capfd.readouterr().err
