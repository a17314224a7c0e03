"""Scenes as people write them: any effect can be added, or a sentence says why not."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from cc_mujoco import cli
from cc_mujoco.datasets import Bench
from cc_mujoco.diagnosis import repair_scene, rollout, write
from cc_mujoco.diagnosis._scene.repair import require_repairable
from cc_mujoco.errors import CableError
from diagnosis.rigs import BENCH, EFFECTS, JOINT, MOTOR, TIME, Torques

TEXT = BENCH.path.read_text(encoding="utf-8")
SHOWN = {name: EFFECTS[name][0] for name in ("joint_inertia", "joint_gravity")}


def put(folder: Path, *changes: tuple[str, str], text: str = TEXT) -> Bench:
    """Return the shipped bench with every pattern of its text replaced."""
    for pattern, new in changes:
        text, count = re.subn(pattern, new, text, flags=re.DOTALL)
        assert count, pattern
    path = folder / "scene.xml"
    path.write_text(text, encoding="utf-8")
    return Bench.of(path)


BARE = (r"<sensor>.*</custom>", "")
FORCE = r"(<actuatorfrc name=\"tension_agonist_proximal\")"


@pytest.fixture(scope="module")
def usual() -> Torques:
    """Return the torques of a rollout of the shipped bench."""
    return rollout(repair_scene(BENCH, BENCH.cables, SHOWN), TIME, MOTOR, JOINT)


@pytest.mark.parametrize(
    "changes",
    [
        ((r"<plugin name=\"\w+_(proximal|distal)\"", "<plugin"), BARE),
        (
            (r"<plugin name=\"\w+_(proximal|distal)\"", "<plugin"),
            BARE,
            (r"<motor name=\"motor\"", '<motor name="agonist_distal"'),
        ),
        ((r"<actuatorfrc name=\"\w+\"", "<actuatorfrc"), (r"<custom>.*</custom>", "")),
        ((r"=\"joint\"", "=\"the joint &amp; 'x'\""),),
        ((r"<site size=\"0.002\"", '<site size="0.002" pos="1 0 0" euler="1 0 0"'),),
        ((FORCE, r'\1 delay="0.01" nsample="200"'),),
        ((FORCE, r'\1 cutoff="30"'),),
        (
            (r"</extension>", '<plugin plugin="mujoco.pid"/></extension>'),
            (
                r"</actuator>",
                '<plugin joint="motor" plugin="mujoco.pid"><config key="kp" value="1"/>'
                "</plugin></actuator>",
            ),
        ),
        (
            (r"angle=\"radian\"", 'angle="degree"'),
            (r"1.5707963", "90"),
        ),
    ],
    ids=[
        "actuators without names",
        "and the names that they get taken",
        "sensors without names",
        "names with blanks",
        "sites turned by default",
        "a sensor that is late",
        "a sensor that is cut off",
        "another plugin",
        "degrees",
    ],
)
def test_scenes_that_differ_in_style_show_the_same(
    tmp_path: Path, changes: tuple[tuple[str, str], ...], usual: Torques
) -> None:
    bench = put(tmp_path, *changes)
    require_repairable(bench)
    path = tmp_path / "repaired.xml"
    write(path, repair_scene(bench, bench.cables, SHOWN))
    for shown, wanted in zip(rollout(path, TIME, MOTOR, JOINT), usual, strict=True):
        assert shown == pytest.approx(wanted, abs=1e-5 * np.abs(wanted).max())


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (((r"contact=\"dis", 'limit="disable" contact="dis'),), "disables limit in"),
        (((r"<compiler ", '<compiler boundinertia="1e-4" '),), "has boundinertia in"),
        (
            ((r"(<plugin name=\"agonist_distal\")", r'\1 forcerange="-50 50"'),),
            "actuator 'agonist_distal' has a `forcerange`",
        ),
        (
            ((r"</worldbody>", '<body name="joint_pulley"/></worldbody>'),),
            "has body 'joint_pulley', .* rename it",
        ),
        (
            ((r"<sensor>", '<sensor><clock name="instrument_one"/>'),),
            "sensor 'instrument_one' of its own; rename it",
        ),
        (
            (
                (
                    r"(<jointpos name=\"motor_angle_rad\" joint=)\"motor\"",
                    r'\1"joint"',
                ),
            ),
            "'motor_angle_rad' must be a <jointpos> of joint 'motor'",
        ),
        (
            (
                (
                    r"objname=\"tension_antagonist_proximal\"",
                    'objname="motor_angle_rad"',
                ),
            ),
            "motor_torque_nm differs from what its cables do alone by 0.01",
        ),
    ],
)
def test_what_a_scene_must_not_be_is_a_sentence(
    tmp_path: Path, changes: tuple[tuple[str, str], ...], sentence: str
) -> None:
    with pytest.raises(CableError, match=sentence) as error:
        require_repairable(put(tmp_path, *changes))
    assert "\n" not in str(error.value)


def test_a_file_that_would_be_lost_is_missed_before(tmp_path: Path) -> None:
    (tmp_path / "part").mkdir()
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
    (tmp_path / "part" / "hand.obj").write_text(
        f"{corners}f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n", encoding="utf-8"
    )
    (tmp_path / "part" / "part.xml").write_text(
        '<mujoco><asset><mesh name="hand" file="hand.obj"/></asset><worldbody>'
        '<body name="hand"><geom type="mesh" mesh="hand"/></body></worldbody></mujoco>',
        encoding="utf-8",
    )
    bench = put(
        tmp_path,
        (r"<asset>", '<asset><model name="part" file="part/part.xml"/>'),
        (r"</worldbody>", '<attach model="part" body="hand" prefix="x"/></worldbody>'),
    )
    with pytest.raises(CableError, match=r"would not load again .*hand\.obj"):
        require_repairable(bench)


def test_an_angle_offset_is_in_the_unit_of_the_scene(tmp_path: Path) -> None:
    bench = put(
        tmp_path,
        (r"angle=\"radian\"", 'angle="degree"'),
        (r"<joint name=\"joint\"", '<joint name="joint" ref="20"'),
    )
    offset = {"angle_offset": {"joint_angle_offset": 0.2}}
    write(tmp_path / "out.xml", repair_scene(bench, bench.cables, offset))
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out.xml"))
    rest = model.qpos0[model.joint("joint").qposadr[0]]
    assert rest == pytest.approx(np.radians(20.0) - 0.2, abs=1e-6)


def test_a_limit_without_margin_is_the_play(tmp_path: Path) -> None:
    bench = put(tmp_path, (r"<default>\n", '<default><tendon margin="0.1"/>\n'))
    model = repair_scene(
        bench, bench.cables, {"backlash": {"backlash": 0.03}}
    ).compile()
    assert model.tendon_margin[model.tendon("joint_backlash").id] == 0.0


def test_the_command_refuses_before_it_works(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(tmp_path, (r"contact=\"dis", 'sensor="disable" contact="dis'))
    out = tmp_path / "out"
    data = str(tmp_path / "none.csv")  # not even read
    scene = str(tmp_path / "scene.xml")
    assert cli.main(["diagnose", scene, data, "--out", str(out)]) == 2
    assert "disables sensor" in capsys.readouterr().err
    assert not out.exists()
