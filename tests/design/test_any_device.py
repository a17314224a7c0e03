"""What-ifs of a device of the user, and of devices with several axes."""

from __future__ import annotations

import math
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from cc_mujoco import cli
from cc_mujoco.design import StudySpec, make_plan, study
from cc_mujoco.design._protocol import split_axes, task_text, tasks_of_axes
from cc_mujoco.design._results_store import read_table
from cc_mujoco.design._show import show
from cc_mujoco.device import load_device
from cc_mujoco.errors import CableError, CableWarning
from cc_mujoco.export._passivity import EPISODE_TIME, activity, play
from cc_mujoco.metrics import METRICS, expand_cable_metrics, measure_axes
from cc_mujoco.simulation import EpisodeLog
from shared_folder import SHARED
from study_marks import study_but

SHORT: dict[str, Any] = {"duration": 0.2}
TASK = "hold:2"

LEVER = """
<mujoco>
  <option timestep="0.001" integrator="implicitfast"/>
  <extension><plugin plugin="cc_mujoco.cable"><instance name="puller">
    <config key="conduit" value="0.4:0.3 0.2:inf"/>
    <config key="axial_stiffness" value="20000"/>
    <config key="pretension" value="10"/> <config key="friction" value="0.1"/>
    <config key="segments" value="8"/>
  </instance></plugin></extension>
  <worldbody>
    <body name="drum"><joint name="drum" axis="0 1 0" armature="1e-3" damping="0.02"/>
      <geom size="0.02" mass="0.1"/></body>
    <site name="clamp" pos="0.08 0 0.3"/>
    <body name="shank"><joint name="elbow" axis="0 1 0" range="0.2 1.8" damping="0.1"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.04" mass="2"/>
      <site name="arm" pos="0.08 0 -0.02"/></body>
  </worldbody>
  <tendon><spatial name="free"><site site="clamp"/><site site="arm"/></spatial></tendon>
  <actuator>
    <motor name="servo" joint="drum" ctrlrange="-8 8"/>
    <position name="person" joint="elbow" kp="80" kv="4"/>
    <plugin plugin="cc_mujoco.cable" instance="puller" joint="drum" gear="-0.02"/>
    <plugin plugin="cc_mujoco.cable" instance="puller" tendon="free" gear="1"/>
  </actuator>
</mujoco>
"""


@pytest.fixture
def lever(tmp_path: Path) -> Path:
    path = tmp_path / "lever.xml"
    path.write_text(LEVER)
    return path


def test_a_scene_of_the_user_is_studied_and_what_is_unknown_has_no_number(
    lever: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    vary = {"joint_radius": [0.06, 0.1]}
    names = "rms_torque_error", "held_backlash", "reflected_inertia"
    unknown = "strength_used", "bend_ratio"
    asked = {"metrics": [*names, *unknown], "task": TASK, **SHORT}
    table = study(str(lever), vary, out=out, **asked)
    assert table["failed"].null_count == 2
    for name in unknown:
        assert table[name].null_count == 2
    for name in names:
        assert all(math.isfinite(value) for value in table[name].to_pylist())
    quick = study(
        str(lever), {"joint_radius": [0.1]}, metrics=["bandwidth"], task=TASK, **SHORT
    )
    assert math.isfinite(quick["bandwidth"][0].as_py())
    small, large = table["reflected_inertia"].to_pylist()
    assert large / small == pytest.approx((0.1 / 0.06) ** 2, rel=0.15)
    log, _ = show(out, 1)
    found = METRICS["rms_torque_error"].compute(log)
    assert found == table["rms_torque_error"][1].as_py()


@pytest.mark.parametrize(
    ("vary", "how", "says"),
    [
        ({"diameter": [0.002]}, {}, r"write `diameter` in \[rope\]"),
        ({"material": ["steel_ptfe"]}, {}, r"write `diameter` in \[rope\]"),
        ({"motor": ["maxon_353297"]}, {}, r"`gearing`.* write it in \[axis\]"),
        ({"friction": [0.1]}, {"objectives": ["strength_used"]},
         r"breaking load of the rope: write `strength` in \[rope\]"),
        ({"friction": [0.1]}, {"subject_to": ["bend_ratio>=20"]},
         r"diameter of the rope: write `diameter` in \[rope\]"),
        ({"friction": [0.1]}, {"objectives": ["elbow.rms_torque_error"]},
         "the device has only one; write 'rms_torque_error'"),
        ({"friction": [0.1]}, {"timestep": 0.0003}, "whole number of time steps"),
        ({"knee.motor_torque": [5.0]}, {}, "unknown axis 'knee'"),
    ],
)  # fmt: skip
def test_what_the_description_lacks_is_refused_in_one_sentence(
    lever: Path, vary: dict[str, Any], how: dict[str, Any], says: str
) -> None:
    with pytest.raises(CableError, match=says) as error:
        make_plan(StudySpec(str(lever), vary, task=TASK, **{**SHORT, **how}))
    assert "\n" not in str(error.value)


def test_a_known_diameter_makes_what_depends_on_it_possible(lever: Path) -> None:
    described = lever.with_name("lever.device.toml")
    described.write_text("[rope]\ndiameter = 0.002\nstrength = 900\n")
    vary = {"diameter": [0.001, 0.002]}
    table = study(
        str(lever), vary, task=TASK, metrics=["strength_used", "bend_ratio"], **SHORT
    )
    thin, thick = table["bend_ratio"].to_pylist()
    assert thin == pytest.approx(2.0 * thick)
    assert table["strength_used"].null_count == 0


def test_a_radius_of_a_pulley_of_unknown_inertia_is_varied_with_a_warning(
    lever: Path,
) -> None:
    with pytest.warns(CableWarning, match=r"write `motor_pulley` in \[axis\]"):
        make_plan(StudySpec(str(lever), {"motor_radius": [0.02]}, task=TASK, **SHORT))


def test_results_are_known_by_the_files_of_the_scene(
    lever: Path, tmp_path: Path
) -> None:
    out, vary = tmp_path / "out", {"friction": [0.1, 0.2]}
    how = {"task": TASK, "metrics": ["rms_torque_error"], **SHORT}
    first = study(str(lever), vary, out=out, **how)
    assert study(str(lever), vary, out=out, **how).equals(first)
    lever.write_text(LEVER.replace('value="20000"', 'value="30000"'))
    with pytest.raises(CableError, match=r"it differs in lever\.xml; --again"):
        study(str(lever), vary, out=out, **how)
    with pytest.raises(CableError, match=r"it differs in lever\.xml"):
        show(out, 0)
    again = study(str(lever), vary, out=out, again=True, **how)
    assert not again["rms_torque_error"].equals(first["rms_torque_error"])
    lever.with_name("lever.device.toml").write_text("[rope]\nstrength = 900\n")
    with pytest.raises(CableError, match=r"it differs in lever\.device\.toml"):
        study(str(lever), vary, out=out, **how)


def test_a_scene_that_changes_while_its_study_runs_is_an_error(
    lever: Path, tmp_path: Path
) -> None:
    def change(done: float) -> None:
        if done and other.exists():
            other.replace(lever)

    other = tmp_path / "other.xml"
    other.write_text(LEVER.replace('value="20000"', 'value="30000"'))
    vary = {"friction": list(np.linspace(0.05, 0.3, 16))}
    with pytest.raises(CableError, match=r"lever\.xml of the scene .* changed while"):
        study(str(lever), vary, task=TASK, metrics=["rms_torque_error"],
              progress=change, **SHORT)  # fmt: skip


@pytest.mark.usefixtures("undrawn")
def test_a_study_is_run_and_shown_again_from_another_folder(
    lever: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("torque.csv").write_text("time_s,torque_nm\n0,1\n0.1,2\n1,2\n")
    command = ["whatif", "lever.xml", "--vary", "friction=0.1,0.2"]
    command += ["--task", "torque.csv", "--duration", "0.2", "--out", "out"]
    monkeypatch.setattr("sys.argv", ["cc-mujoco", *command])
    assert cli.main([*command, "--metric", "rms_torque_error"]) == 0
    page = Path("out/report.html").read_text(encoding="utf-8")
    assert f"cd {tmp_path} &amp;&amp; cc-mujoco whatif lever.xml" in page
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    log, _ = show(tmp_path / "out", 1)
    found = METRICS["rms_torque_error"].compute(log)
    assert found == read_table(tmp_path / "out")["rms_torque_error"][1].as_py()


def test_a_controller_in_the_hands_of_a_wearer_is_judged_on_any_device(
    lever: Path,
) -> None:
    times: list[float] = []
    found = activity(lever, "none", progress=times.append)
    assert times == sorted(times) and times[-1] == pytest.approx(EPISODE_TIME)
    assert found.allowed > 0.0 and math.isfinite(found.energy)
    quiet = play(lever, "ideal", "spring", [found.limb])
    assert quiet.held[0] < 1e-3 * found.allowed


@pytest.fixture(scope="module")
def exosuit() -> pa.Table:
    return study(
        "exosuit",
        {"thigh.friction": [0.05, 0.3], "ankle.motor_torque": [2.0, 6.0]},
        metrics=["rms_torque_error", "peak_motor_torque", "slack_margin",
                 "reflected_inertia"],
        controllers=["hip=none,ankle=pi"],
        duration=0.4,
        threads=1,
    )  # fmt: skip


def test_a_number_of_a_device_is_that_of_its_worst_axis(exosuit: pa.Table) -> None:
    for name, worst in (("rms_torque_error", max), ("peak_motor_torque", max),
                        ("slack_margin", min), ("reflected_inertia", max)):  # fmt: skip
        for row in exosuit.to_pylist():
            assert row[name] == worst(row[f"hip.{name}"], row[f"ankle.{name}"])


def test_a_variable_of_an_axis_and_of_a_cable_changes_that_axis_alone(
    exosuit: pa.Table,
) -> None:
    hip = exosuit["hip.rms_torque_error"].to_pylist()
    assert hip[0] == pytest.approx(hip[1], rel=1e-3)
    assert hip[0] != pytest.approx(hip[2], rel=1e-3)
    assert max(exosuit["ankle.peak_motor_torque"].to_pylist()[::2]) <= 2.0


def test_an_axis_alone_can_be_an_objective_and_a_limit() -> None:
    plan = make_plan(StudySpec("exosuit", {"friction": [0.1]}, duration=0.2,
                     objectives=["hip.rms_torque_error", "max:ankle.rms_motor_torque"],
                     subject_to=["ankle.slack_margin>=0"]))  # fmt: skip
    assert {"hip.rms_torque_error", "ankle.slack_margin"} <= {*plan.protocol.metrics}
    for name, says in (
        ("knee.rms_torque_error", "unknown axis 'knee'"),
        ("hip.mass", "of the device as a whole; write 'mass'"),
    ):
        with pytest.raises(CableError, match=says):
            make_plan(StudySpec("exosuit", {"friction": [0.1]}, metrics=[name]))


SECOND = """
    <body name="drum2"><joint name="drum2" axis="0 1 0" armature="1e-3" damping="0.02"/>
      <geom size="0.02" mass="0.1"/></body>
"""
OTHER_ENDS = """
    <motor name="servo2" joint="drum2" ctrlrange="-8 8"/>
    <plugin plugin="cc_mujoco.cable" instance="other" joint="drum2" gear="-0.02"/>
    <plugin plugin="cc_mujoco.cable" instance="other" joint="elbow" gear="-0.08"/>
"""


def test_axes_that_drive_one_joint_are_not_held_apart(lever: Path) -> None:
    cable = LEVER[LEVER.index("<instance") : LEVER.index("</plugin>")]
    text = LEVER.replace(cable, cable + cable.replace("puller", "other"))
    text = text.replace("<worldbody>", f"<worldbody>{SECOND}")
    lever.write_text(text.replace("</actuator>", f"{OTHER_ENDS}</actuator>"))
    described = lever.with_name("lever.device.toml")
    names = ("servo", "bend"), ("servo2", "stretch")
    described.write_text(
        "".join(f'[[axis]]\nmotor = "{m}"\nname = "{n}"\n' for m, n in names)
    )
    vary, how = {"friction": [0.1]}, {"task": "hold:1", **SHORT}
    with pytest.raises(CableError, match="two axes drive joint 'elbow'"):
        make_plan(StudySpec(str(lever), vary, metrics=["bandwidth"], **how))
    plan = make_plan(StudySpec(str(lever), vary, **how))
    assert not {"bandwidth", "held_backlash"} & {*plan.protocol.metrics}


ARM = """
<mujoco>
  <option timestep="0.0005"/>
  <extension><plugin plugin="cc_mujoco.cable">
    <instance name="flexor">
      <config key="conduit" value="0.8:0.15 0.6:inf 0.6:0.4"/>
      <config key="axial_stiffness" value="4000"/>
      <config key="pretension" value="10"/> <config key="friction" value="0.1"/>
    </instance>
    <instance name="puller">
      <config key="conduit" value="0.4:0.15 0.6:inf"/>
      <config key="axial_stiffness" value="4000"/>
      <config key="pretension" value="10"/> <config key="friction" value="0.1"/>
    </instance>
  </plugin></extension>
  <worldbody>
    <body><joint name="motor" armature="1e-4"/><geom size="0.02"/></body>
    <body pos="0 0.2 0"><joint name="motor2" armature="1e-4"/><geom size="0.02"/></body>
    <body pos="1 0 0"><joint name="shoulder" stiffness="2" springref="-30"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="1"/>
      <body pos="0.3 0 0"><joint name="elbow" stiffness="2" springref="-30"/>
        <geom type="capsule" fromto="0 0 0 0.25 0 0" size="0.02" mass="0.5"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor joint="motor" ctrlrange="-1 1"/> <motor joint="motor2" ctrlrange="-1 1"/>
    <plugin plugin="cc_mujoco.cable" instance="flexor" joint="motor" gear="-0.02"/>
    <plugin plugin="cc_mujoco.cable" instance="flexor" joint="shoulder" gear="-0.1"/>
    <plugin plugin="cc_mujoco.cable" instance="puller" joint="motor2" gear="-0.02"/>
    <plugin plugin="cc_mujoco.cable" instance="puller" joint="elbow" gear="-0.06"/>
  </actuator>
</mujoco>
"""


def test_joints_that_move_each_other_are_held_still(tmp_path: Path) -> None:
    """An ideal wearer for each joint alone is unstable for an arm of two."""
    arm = tmp_path / "arm.xml"
    arm.write_text(ARM)
    out = tmp_path / "study"
    study(str(arm), {"friction": [0.05, 0.2]}, duration=1.0, out=out, threads=1)
    table = read_table(out)
    assert not any(table["failed"].to_pylist())


def test_tasks_and_controllers_are_read_by_axis() -> None:
    device = load_device("exosuit").description
    own = tasks_of_axes(None, device)
    assert tasks_of_axes("transparent", device) == dict.fromkeys(own, "transparent")
    one = tasks_of_axes("ankle=tunnel:half_width=0.1,limit=2", device)
    assert one == own | {"ankle": "tunnel:half_width=0.1,limit=2"}
    assert tasks_of_axes(task_text({n: str(t) for n, t in one.items()}), device) == one
    assert split_axes(["hip=pi,ankle=law:make", "none"], own) == (
        "pi",
        "law:make",
        "none",
    )


def test_metrics_of_a_log_are_given_axis_by_axis(tmp_path: Path) -> None:
    study("exosuit", {"friction": [0.1]}, duration=0.2, out=tmp_path,
          metrics=["rms_torque_error"], threads=1)  # fmt: skip
    log, _ = show(tmp_path, 0)
    assert isinstance(log, EpisodeLog)
    chosen = [METRICS["rms_torque_error"], METRICS["slack_time_{cable}"]]
    found = list(measure_axes(log, expand_cable_metrics(chosen, log.cables)))
    assert [(axis, metric.name) for axis, metric, _ in found] == [
        ("hip", "rms_torque_error"),
        ("ankle", "rms_torque_error"),
        *(("", f"slack_time_{cable}") for cable in log.cables),
    ]
    table = read_table(tmp_path)
    for axis, metric, value in found[:2]:
        assert value == table[f"{axis}.{metric.name}"][0].as_py()


@pytest.mark.shared
@pytest.mark.filterwarnings("ignore:variable 'joint_radius' leaves the inertia")
@pytest.mark.parametrize(
    "name", study_but(3, ["knee_exo", "knee4", "knee_mid", "elbow"])
)
def test_scenes_of_others_are_studied_as_they_are(name: str, tmp_path: Path) -> None:
    scene = tmp_path / f"{name}.xml"
    shutil.copyfile(SHARED / f"cases/device/{name}.xml", scene)
    vary = {"friction": [0.05, 0.2], "pretension": [5.0, 20.0], "joint_radius": [0.08]}
    metrics = ["rms_torque_error", "held_backlash", "strength_used"]
    table = study(str(scene), vary, metrics=metrics, **SHORT)
    assert table["failed"].null_count == 4
    assert table["strength_used"].null_count == 4
    assert table["held_backlash"][0].as_py() < table["held_backlash"][2].as_py()
