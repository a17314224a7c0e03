"""Runs of several axes: one loop, and what ends one axis ends all."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from cc_mujoco import cli
from cc_mujoco.control import Controller, axes_controller
from cc_mujoco.device._sensors import WINDING_COLUMNS
from cc_mujoco.errors import CableError
from cc_mujoco.hardware import (
    DrivenAxis,
    Loop,
    Readings,
    RunLog,
    RunOutcome,
    Status,
    Watchdog,
    read_axes,
    read_settings,
)
from cc_mujoco.hardware._limits import Limiter
from cc_mujoco.hardware._references import constant_course
from cc_mujoco.hardware._replay import as_episode, read_rows
from cc_mujoco.hardware._run_log import RUN_COLUMNS, SAMPLE_TIME, run_columns
from cc_mujoco.hardware._settings import RigAxes
from hardware.devices import ARM, SimulatedDevice, written
from hardware.fakes import LIMITS, PERIOD, FakeRig, Rows, SimulatedClock, drive
from hardware.peers import Peer
from study_marks import study_unless

Fault = Callable[[int, Readings], Readings | None]
PAGE = Path(__file__).parents[2] / "cc_mujoco" / "hardware" / "README.md"
NAMES = ("hip", "knee", "ankle")
PREFIXES = ("hip.", "knee.", "ankle.")
TROUBLE = 100
"""Reading at which a rig gets into trouble."""


def lost(count: int, seen: Readings) -> Readings | None:
    return seen if count < TROUBLE else None


def too_far(count: int, seen: Readings) -> Readings:
    return seen._replace(joint_angle=3.0) if count == TROUBLE else seen


def no_number(count: int, seen: Readings) -> Readings:
    return seen._replace(joint_torque=math.nan) if count == TROUBLE else seen


def faulty(count: int, seen: Readings) -> Readings:
    return seen._replace(status=Status.FAULT) if count >= TROUBLE else seen


def broken(count: int, seen: Readings) -> Readings:
    if count >= TROUBLE:
        raise CableError("the bus is off.")
    return seen


class DeafRig(FakeRig):
    """Rig to which nothing can be written any more."""

    def write(self, torque: float) -> None:
        super().write(torque)
        if self.reads >= TROUBLE:
            raise CableError("the link is down.")


def play(
    rigs: Sequence[FakeRig], clock: SimulatedClock, law: Controller | None = None
) -> tuple[RunOutcome, Rows]:
    axes = [
        DrivenAxis(rig, drive(), constant_course(goal), LIMITS, Watchdog(), name)
        for rig, goal, name in zip(rigs, (0.5, 1.0, 1.5), NAMES, strict=True)
    ]
    rows = Rows()
    law = law or axes_controller("none", [axis.drive for axis in axes], PREFIXES)
    return Loop(axes, law, clock=clock, log=rows).run(0.5), rows


def require_all_stopped(rigs: Sequence[FakeRig]) -> None:
    """Require limits, a ramp of every axis to zero, and closed rigs."""
    step = LIMITS.torque_rate * PERIOD + 1e-12
    for rig in rigs:
        torques = [0.0, *rig.written]
        assert max(torques) > 0.1
        assert all(abs(b - a) <= step for a, b in pairwise(torques))
        assert not any(torques[-5:]) and rig.closed == 1
    # Each starts down in the same cycle.
    assert len({int(np.argmax(np.abs(rig.written))) for rig in rigs}) <= 2
    assert len({len(rig.written) for rig in rigs}) == 1


@pytest.mark.parametrize(
    ("fault", "why"),
    [
        (lost, "axis knee: the rig is silent"),
        (too_far, "axis knee: the joint is at 3 rad, outside its range"),
        (no_number, "axis knee: the reading of joint_torque is nan"),
        (faulty, "axis knee: the rig reports a fault"),
        (broken, "axis knee: the bus is off."),
    ],
)
def test_what_is_amiss_on_one_axis_stops_all(fault: Fault, why: str) -> None:
    clock = SimulatedClock()
    rigs = [FakeRig(clock), FakeRig(clock, fault), FakeRig(clock)]
    outcome, rows = play(rigs, clock)
    assert outcome.code == 3 and outcome.sentence.startswith(why)
    require_all_stopped(rigs)
    assert TROUBLE - 5 < outcome.cycles < TROUBLE + 15
    assert np.isfinite(np.array(rows.rows)[:, :6]).all()


def test_a_link_that_takes_nothing_on_one_axis_stops_all() -> None:
    clock = SimulatedClock()
    rigs = [FakeRig(clock), DeafRig(clock), FakeRig(clock)]
    outcome, _ = play(rigs, clock)
    assert outcome.sentence == "axis knee: the link is down."
    require_all_stopped(rigs)


def test_no_axis_gets_torque_before_all_are_heard() -> None:
    clock = SimulatedClock()

    def late(count: int, seen: Readings) -> Readings | None:
        return seen if count > 30 else None

    rigs = [FakeRig(clock), FakeRig(clock, late), FakeRig(clock)]
    outcome, _ = play(rigs, clock)
    assert outcome.code == 0
    assert all(not any(rig.written[:30]) and any(rig.written) for rig in rigs)
    mute = [FakeRig(clock), FakeRig(clock, lambda *_: None), FakeRig(clock)]
    outcome, _ = play(mute, clock)
    assert outcome.sentence == "axis knee: the rig gave no reading in 3 s."
    assert not any(torque for rig in mute for torque in rig.written)


def test_every_axis_gets_its_own_torque_within_its_own_soft_start() -> None:
    clock = SimulatedClock()
    rigs = [FakeRig(clock) for _ in NAMES]
    outcome, rows = play(rigs, clock)
    assert outcome.code == 0
    for rig, goal in zip(rigs, (0.5, 1.0, 1.5), strict=True):
        limiter = Limiter(LIMITS, PERIOD)
        expected = [limiter.limited(goal / 2.0) for _ in range(250)]
        begin = next(k for k, torque in enumerate(rig.written) if torque)
        assert rig.written[begin : begin + 250] == pytest.approx(expected)
    assert len(rows.rows[0]) == 3 * 10 + 3


@pytest.mark.parametrize("torque", [[0.1, 0.2], 0.1, [0.1, math.nan, 0.2]])
def test_a_controller_of_all_axes_that_gives_no_torque_of_each_stops_all(
    torque: object,
) -> None:
    def make(drives: object) -> Callable[[object], object]:
        return lambda seen: torque

    make.__dict__["ALL_AXES"] = True
    clock = SimulatedClock()
    rigs = [FakeRig(clock) for _ in NAMES]
    law = axes_controller(make, [drive()] * 3, PREFIXES)
    outcome, _ = play(rigs, clock, law)
    assert outcome.code == 3 and "the controller" in outcome.sentence
    assert all(rig.closed == 1 and not any(rig.written) for rig in rigs)


BOTH = """scene = "device.xml"
period = 0.002
[limits]
torque = 2.0
torque_rate = 100.0
motor_speed = 60.0
joint_range = [-1.5, 2.3]
soft_start = 0.05
[watchdog]
missed_readings = 50
missed_deadlines = 9999
[task]
torque = 0.5
[axes.shoulder.rig]
address = "127.0.0.1:5001"
[axes.elbow]
motor_lag = 0.003
rig = { address = "127.0.0.1:5002" }
limits = { torque = 1.5 }
task = { torque = 1.0 }
"""


def file_of(folder: Path, text: str = BOTH) -> Path:
    written(folder, ARM)
    path = folder / "rig.toml"
    path.write_text(text)
    return path


def test_an_axis_has_its_own_settings_and_otherwise_those_of_all(
    tmp_path: Path,
) -> None:
    axes = RigAxes(read_axes(file_of(tmp_path)))
    assert axes.names == axes.log_names == ("elbow", "shoulder")  # the device's order
    elbow, shoulder = axes.settings
    assert (elbow.limits.torque, shoulder.limits.torque) == (1.5, 2.0)
    assert elbow.limits.motor_speed == shoulder.limits.motor_speed == 60.0
    assert [drive.motor_lag for drive in axes.drives] == [0.003, 0.0]
    assert [drive.high for drive in axes.drives] == [1.5, 2.0]
    rest = Readings(0.0, *[0.0] * 5)
    assert [goal.torque(0.0, rest) for goal in axes.desired(1.0)] == [1.0, 0.5]


def test_the_example_of_the_page_drives_two_axes(tmp_path: Path) -> None:
    page = PAGE.read_text("utf-8")
    section = page.partition("\n### Several axes\n")[2]
    example = section.partition("```toml\n")[2].partition("```")[0]
    axes = RigAxes(read_axes(file_of(tmp_path, example)))
    assert axes.names == ("hip", "ankle")
    assert [each.limits.torque for each in axes.settings] == [4.0, 8.0]
    axes.desired(1.0)
    axes.controller("hip=pi,ankle=predictive")
    with pytest.raises(CableError, match="of axis hip needs to know how joint knee"):
        axes.controller("predictive")


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("axes.elbow", "axes.elbw", "did you mean 'elbow'"),
        ("[axes.elbow]", "[axes.elbow]\ndriven = 1", "driven must be true or false"),
        ("[axes.elbow]", "[axes.elbow]\nlag = 1", r"key 'lag' in .*\[axes.elbow\]"),
        ("5001", "5002", "shoulder and elbow have the same rig"),
        ("127.0.0.1:5001", "localhost:5002", "have the same address"),
        ("scene", 'axis = "elbow"\nscene', r"has `axis` and \[axes\]"),
        ("torque = 1.5 }", "torque = -1 }", r"axis elbow, \[limits\]: .*torque"),
        ("torque = 1.0 }", "torque = 9.0 }", "axis elbow: .*asks for 9 N m"),
        ("torque = 1.0 }", "torque = -1.0 }", "axis elbow: .*only pulls"),
    ],
)
def test_what_is_wrong_with_axes_is_said(
    tmp_path: Path, old: str, new: str, why: str
) -> None:
    with pytest.raises(CableError, match=why):
        RigAxes(read_axes(file_of(tmp_path, BOTH.replace(old, new)))).desired(1.0)


def test_an_axis_that_is_left_out_is_missed_unless_no_rig_drives_it(
    tmp_path: Path,
) -> None:
    head, _, tail = BOTH.partition("[axes.elbow]")
    left_out = file_of(tmp_path, head)
    with pytest.raises(CableError, match=r"\[axes\] leaves out elbow; give a table"):
        RigAxes(read_axes(left_out))
    alone = f"{head}[axes.elbow]\ndriven = false\n{tail}"
    one = file_of(tmp_path, alone)
    axes = RigAxes(read_axes(one))
    assert (axes.names, axes.log_names) == (("shoulder",),) * 2
    assert read_settings(one).axis == "shoulder"
    assert type(axes.controller("shoulder=pi")) is type(axes.controller("pi"))
    with pytest.raises(CableError, match="drives the axes shoulder, elbow, and here"):
        read_settings(file_of(tmp_path))
    none = alone.replace("[axes.shoulder.rig]", "[axes.shoulder]")
    none = none.replace('address = "127.0.0.1:5001"', "driven = false")
    with pytest.raises(CableError, match="has no axis that is driven"):
        read_axes(file_of(tmp_path, none))


@pytest.mark.parametrize(
    ("other", "why"),
    [
        ("command_id = 0x111\nreading_id = 0x112", "both use the identifier 0x111"),
        ("command_id = 1\nreading_id = 2\nbus = { a = 1 }", "open it differently"),
    ],
)
def test_axes_on_one_bus_have_identifiers_of_their_own(
    tmp_path: Path, other: str, why: str
) -> None:
    text = BOTH.replace('address = "127.0.0.1:5001"', 'address = "can:can0"').replace(
        'rig = { address = "127.0.0.1:5002" }', ""
    )
    text += f'[axes.elbow.rig]\naddress = "can:can0"\n{other}\n'
    with pytest.raises(CableError, match=why):
        read_axes(file_of(tmp_path, text))


DEVICES = {
    "bilateral": {"left_ankle": -1.0, "right_hip": 1.0, "left_knee": 0.5},
    "hand": {"index_flexor": 0.05, "middle_extensor": -0.05},
}


@pytest.mark.parametrize("scene", study_unless("hand".__eq__, DEVICES))
def test_a_device_of_many_axes_is_driven_and_its_log_is_shown(
    scene: str, tmp_path: Path
) -> None:
    device = SimulatedDevice(scene, noise=1e-5)
    names, tasks = device.worn.names, DEVICES[scene]
    tables = "".join(
        f'[axes.{name}]\nrig.address = "127.0.0.1:{5001 + k}"\n'
        f"task.torque = {tasks.get(name, 0.0)}\n"
        for k, name in enumerate(reversed(names))
    )
    head = BOTH.partition("[axes.")[0].replace("device.xml", scene)
    path = file_of(tmp_path, head.replace("0.002", "0.001") + tables)
    axes = RigAxes(read_axes(path))
    assert axes.names == names
    assert axes.windings.unmeasured == [()] * len(names)  # each other's joints
    with pytest.raises(CableError, match="did you mean"):
        axes.controller(f"{names[0]}s=pi")
    law = axes.controller(",".join(f"{name}=none" for name in names))
    desired = axes.desired(0.3)
    driven = axes.driven([device.rig(name) for name in names], desired)
    for _ in range(2):  # one in which nothing was measured is replaced
        log = RunLog(tmp_path / "run", {"rig": path.read_text()}, 50, axes=names)
        log.close({"exit_code": 3})
    log = RunLog(tmp_path / "run", {"rig": path.read_text()}, 50, axes=axes.log_names)
    loop = Loop(driven, law, clock=device, log=log, windings=axes.windings)
    log.close(loop.run(0.3).to_json())
    assert loop.outcome.code == 0, loop.outcome.sentence
    rows = tmp_path / "run" / "log.csv"
    assert tuple(rows.read_text().split("\n", 1)[0].split(",")) == run_columns(names)
    found = read_rows(rows)
    for name, own in zip(names, axes.drives, strict=True):
        motor = found[f"{name}.motor_torque_nm"]
        wanted = tasks.get(name, 0.0) / own.ratio
        assert motor[290] == pytest.approx(wanted, abs=1e-9), name
    _, episode = as_episode(found, scene, rows)
    assert episode.axes == names
    # The windings that a controller saw are those that the device's own sensors have.
    angles = [device.worn.column(name, "joint_angle_rad") for name in names]
    speeds = [device.worn.column(name, "joint_velocity_rad_s") for name in names]
    for name, wound in zip(names, axes.windings.read(angles, speeds), strict=True):
        for column in WINDING_COLUMNS if wound else ():
            true = device.worn.column(name, column)
            assert wound[column] == pytest.approx(true, abs=3e-3)


@pytest.mark.parametrize("dies", [False, True])
def test_the_command_runs_two_axes_and_stops_both(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], dies: bool
) -> None:
    def mortal(count: int, data: bytes) -> list[bytes]:
        return [] if dies and count > 60 else [data]

    with Peer() as shoulder, Peer(mortal) as elbow:
        text = BOTH.replace('address = "127.0.0.1:5001"', shoulder.end.rig).replace(
            'address = "127.0.0.1:5002"', elbow.end.rig
        )
        rig = str(file_of(tmp_path, text))
        given = ["--rig", rig, "--out", str(tmp_path / "run"), "--duration"]
        given += ["5.0" if dies else "0.2", "--controller", "elbow=pi,shoulder=none"]
        if dies:
            assert cli.main(["run", *given]) == 3
            printed = capsys.readouterr().err
            assert "axis elbow: the rig is silent: no new reading in 50" in printed
        else:
            assert cli.main(["run", *given]) == 0
    assert shoulder.stopped() and elbow.stopped()
    assert not any(shoulder.torques[-14:]) and not any(elbow.torques[-14:])
    page = json.loads((tmp_path / "run" / "run.json").read_text())
    assert page["exit_code"] == 3 * dies and "[axes.elbow]" in page["rig"]
    header = (tmp_path / "run" / "log.csv").read_text().split("\n", 1)[0].split(",")
    assert header[1] == f"elbow.{SAMPLE_TIME}" and header[-3:] == [*RUN_COLUMNS[-3:]]
    assert "shoulder.command_torque_nm" in header
