"""The report on what friction does to a tendon, before and after it has some."""

from __future__ import annotations

import copy
import math
import re
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import cc_mujoco
from cc_mujoco import cli
from cc_mujoco.errors import CableError, CableWarning
from cc_mujoco.plugin import TendonSummary, segment_wrap, step_limits, tendon_report
from plugin.open_scenes import atwood
from plugin.test_tendons import ARM, EXOSUIT, with_tendon

ZIGZAG = "".join(
    f'<site name="z{i}" pos="{0.02 * i} 0 {0.01 * (i % 2)}"/>' for i in range(12)
)
ZIGZAG_PATH = "".join(f'<site site="z{i}"/>' for i in range(12))


def straight_arm(path: str = ZIGZAG_PATH, more: str = "") -> mujoco.MjSpec:
    """Return a slide that a cord over zig-zag sites pulls."""
    return mujoco.MjSpec.from_string(
        f"<mujoco><worldbody>{ZIGZAG}"
        '<geom name="aside" type="cylinder" size=".01 .05" pos="0 1 0"/>'
        '<body pos=".4 0 0"><joint name="sled" type="slide" axis="1 0 0" '
        'range="-.1 .1"/><geom size=".01"/><site name="hook"/></body></worldbody>'
        f'<tendon><spatial name="cord">{path}<site site="hook"/></spatial>{more}'
        "</tendon></mujoco>"
    )


def only(report: cc_mujoco.plugin.TendonReport) -> TendonSummary:
    (summary,) = report.tendons
    return summary


def site_turns(m: mujoco.MjModel, d: mujoco.MjData, sites: list[str]) -> np.ndarray:
    """Return the turning angles of a polygon, written without the product."""
    along = np.diff([d.site(name).xpos for name in sites], axis=0)
    along /= np.linalg.norm(along, axis=1)[:, None]
    return np.arccos(np.clip(np.sum(along[1:] * along[:-1], axis=1), -1.0, 1.0))


def test_half_a_turn_around_a_wheel() -> None:
    summary = only(tendon_report(atwood(0.2, (1.0, 1.0), 0.1, radius=0.1)))
    (wheel,) = summary.places
    assert (wheel.kind, wheel.name, wheel.touched) == ("geom", "rim", True)
    assert wheel.turn == pytest.approx(math.pi)
    assert wheel.contact == pytest.approx(0.1 * math.pi)
    assert summary.loss == pytest.approx(1.0 - math.exp(-0.2 * math.pi))
    assert (summary.friction_source, summary.cable) == ("cable", "rope")
    assert set(summary.joints) == {"wheel", "a", "b"}
    assert sum(summary.piece_lengths) == pytest.approx(summary.length)


@pytest.mark.parametrize("case", [ARM, EXOSUIT], ids=["arm", "exosuit"])
def test_turns_of_a_public_model_are_those_of_its_sites_and_of_its_cable(
    case: tuple,
) -> None:
    bare, joints, sites = with_tendon(case, None)
    with_cable = with_tendon(case, 0.1)[0]
    before = only(tendon_report(bare, "cord", friction=0.1))
    after = only(tendon_report(with_cable, "cord"))
    assert before.places == after.places
    assert set(joints) <= set(before.joints)
    d, e = mujoco.MjData(bare), mujoco.MjData(with_cable)
    for m, data in ((bare, d), (with_cable, e)):
        mujoco.mj_forward(m, data)
    turn = site_turns(bare, d, sites)
    assert [place.turn for place in before.places] == pytest.approx(turn)
    assert segment_wrap(with_cable, e, "cord").sum() == pytest.approx(after.turn)
    kept = np.exp(-0.1 * np.cumsum(turn))
    assert [1.0 - p.total_loss for p in before.places] == pytest.approx(kept)
    # Other poses within the ranges of the joints: nearly none turns by more or less.
    random = np.random.default_rng(5)
    ids = [bare.joint(name).id for name in before.joints]
    outside = 0
    for _ in range(200):
        for j in ids:
            low, high = bare.jnt_range[j] if bare.jnt_limited[j] else (-3.1, 3.1)
            d.qpos[bare.jnt_qposadr[j]] = random.uniform(low, high)
        mujoco.mj_kinematics(bare, d)
        total = site_turns(bare, d, sites).sum()
        outside += not before.min_turn - 0.1 < total < before.max_turn + 0.1
    assert outside <= 4


def test_the_time_step_is_that_of_the_cable_which_friction_makes() -> None:
    bare, cable = (with_tendon(EXOSUIT, mu)[0] for mu in (None, 0.1))
    summary = only(tendon_report(bare, axial_stiffness=20000.0))
    true = step_limits(cable)["cord"].pieces
    assert only(tendon_report(cable)).step_limit == true
    # A drum lets the cable out, and the strain by the pretension counts.
    assert summary.step_limit == pytest.approx(true, rel=0.05)


def test_a_tendon_that_loses_much_as_it_lies_is_warned_of_once(
    capsys: pytest.CaptureFixture[str],
) -> None:
    turn = 21 * math.atan(0.5)
    spec = straight_arm()
    warned = only(tendon_report(spec, friction=0.1)).warning
    assert "its sites zig-zag" in warned
    assert f"turns by {only(tendon_report(spec)).turn:.3g} rad" in warned
    assert only(tendon_report(spec)).turn == pytest.approx(turn, rel=0.05)
    assert only(tendon_report(spec, friction=0.01)).warning == ""
    with pytest.warns(CableWarning, match="zig-zag") as caught:
        cc_mujoco.add_friction(spec, "cord", friction=0.1)
    assert len(caught) == 1
    assert capsys.readouterr().out == ""


def test_friction_is_added_with_a_report_on_request(
    capsys: pytest.CaptureFixture[str],
) -> None:
    cc_mujoco.add_friction(straight_arm(), "cord", friction=0.1, report=True)
    said = capsys.readouterr().out
    assert said.count("warning:") == 1
    assert "site z5" in said
    assert "friction 0.1 (cable)" in said


def test_a_curve_of_sites_is_no_zigzag() -> None:
    ring = "".join(
        f'<site name="r{i}" pos="{math.sin(0.4 * i)} {math.cos(0.4 * i)} 0"/>'
        for i in range(12)
    )
    path = "".join(f'<site site="r{i}"/>' for i in range(12))
    spec = mujoco.MjSpec.from_string(
        f"<mujoco><worldbody>{ring}</worldbody><tendon><spatial>{path}</spatial>"
        "</tendon></mujoco>"
    )
    summary = only(tendon_report(spec, friction=0.2))
    assert summary.turn == pytest.approx(4.0)
    assert summary.zigzag == pytest.approx(0.0, abs=1e-9)
    assert summary.warning and "zig-zag" not in summary.warning
    assert (summary.name, summary.joints) == ("0", ())
    assert math.isinf(summary.step_limit)


def test_a_geom_aside_is_never_touched() -> None:
    spec = straight_arm('<site site="z0"/><geom geom="aside"/><site site="z2"/>')
    report = tendon_report(spec)
    assert only(report).untouched == ("aside",)
    assert re.search(r"geom aside +never touched", str(report))
    assert "never touches geom aside" in report.overview()


def test_tendons_without_a_path_are_left_out_and_refused_by_name() -> None:
    more = (
        '<fixed name="coupled"><joint joint="sled" coef="1"/></fixed><spatial '
        'name="block"><site site="z0"/><site site="z1"/><pulley divisor="2"/>'
        '<site site="z3"/><site site="hook"/></spatial>'
    )
    spec = straight_arm(more=more)
    report = tendon_report(spec)
    assert only(report).name == "cord"
    assert report.skipped == {"coupled": "is fixed", "block": "has a <pulley>"}
    with pytest.raises(CableError, match="'block' has a <pulley>"):
        tendon_report(spec, "block")
    with pytest.raises(CableError, match=r"unknown tendon 'chord'.*'cord'"):
        tendon_report(spec, ["chord"])
    with pytest.raises(CableError, match="`friction` is -1"):
        tendon_report(spec, friction=-1.0)
    wrong: Any = "model.xml"
    with pytest.raises(CableError, match="needs an MjModel or MjSpec, not str"):
        tendon_report(wrong)
    other = mujoco.MjData(mujoco.MjModel.from_xml_string("<mujoco/>"))
    with pytest.raises(CableError, match="data have 0 positions, 0 speeds, 1 bodies"):
        tendon_report(spec, data=other)
    wrong = other
    with pytest.raises(CableError, match="takes a simulation by name, `data=`"):
        tendon_report(spec, wrong)


def test_a_report_changes_nothing_and_comes_out_the_same_again() -> None:
    m = with_tendon(ARM, 0.2)[0]
    d = mujoco.MjData(m)
    d.qpos[:2] = 0.3, 0.7
    mujoco.mj_forward(m, d)
    pose, state = d.qpos.copy(), d.plugin_state.copy()
    first, again = (tendon_report(m, data=d) for _ in range(2))
    assert first == again
    assert (d.qpos == pose).all() and (d.plugin_state == state).all()
    there = copy.copy(d)
    mujoco.mj_step(m, there)
    assert only(first).turn == pytest.approx(segment_wrap(m, there, "cord").sum())
    assert only(first).turn != only(tendon_report(m)).turn


def test_the_table_has_a_row_for_every_place() -> None:
    report = tendon_report(straight_arm(), friction=0.1)
    rows = report.table().to_pylist()
    assert [row["name"] for row in rows] == [f"z{i}" for i in range(1, 12)]
    assert rows[-1]["total_loss"] == pytest.approx(only(report).loss)


def test_the_command_prints_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "arm.xml"
    file.write_text(straight_arm().to_xml())
    assert cli.main(["tendons", str(file), "--friction", "0.1"]) == 0
    assert "whole tendon" in capsys.readouterr().out
    assert cli.main(["tendons", str(file), "--brief"]) == 0
    assert len(capsys.readouterr().out.splitlines()) < 10
    assert cli.main(["tendons", str(file), "--tendon", "chord"]) == 2
    assert "did you mean 'cord'" in capsys.readouterr().err
