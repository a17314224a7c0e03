"""Exported controllers of several axes: each by its name, all in one program."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from cc_mujoco.cli._export import Export
from cc_mujoco.control import controller
from cc_mujoco.device import DeviceModel, find_device
from cc_mujoco.device._device import bare_model
from cc_mujoco.errors import CableError
from cc_mujoco.export._c_source import renamed
from cc_mujoco.export._files import export_files
from hardware.devices import ARM, written
from shared_folder import SHARED

COMPILER = shutil.which("gcc") or shutil.which("clang")
CASES = SHARED / "cases" / "device"

PROGRAM = """
#include "cc_elbow_controller.h"
#include "cc_shoulder_controller.h"

static cc_elbow_controller elbow;
static cc_shoulder_controller shoulder;

int start(void)
{
    return cc_elbow_controller_init(&elbow, cc_elbow_controller_parameters)
        || cc_shoulder_controller_init(&shoulder, cc_shoulder_controller_parameters)
        || CC_ELBOW_RATIO != CC_SHOULDER_RATIO;
}

void step(double speed, double torque, double desired, double *found)
{
    cc_elbow_readings e = {0};
    cc_shoulder_readings s = {0};
    e.motor_velocity_rad_s = s.motor_velocity_rad_s = speed;
    e.joint_torque_nm = s.joint_torque_nm = torque;
    e.desired_torque_nm = s.desired_torque_nm = desired;
    found[0] = cc_elbow_controller_step(&elbow, &e);
    found[1] = cc_shoulder_controller_step(&shoulder, &s);
}
"""


def test_names_in_c_begin_with_the_axis() -> None:
    text = "cc_controller_step CC_LOW cc_mujoco @cc_controller_size success"
    assert renamed(text, "left hip") == (
        "cc_left_hip_controller_step CC_LEFT_HIP_LOW cc_mujoco "
        "@cc_left_hip_controller_size success"
    )
    assert renamed(text, "") == text


def test_a_device_with_several_axes_needs_the_name_of_one(tmp_path: Path) -> None:
    scene = written(tmp_path, ARM)
    with pytest.raises(CableError, match="has the axes elbow, shoulder; name one"):
        Export(str(scene), "pi", tmp_path / "out", allow_active=True).run()
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(COMPILER is None, reason="there is no C compiler")
def test_controllers_of_two_axes_run_in_one_program(tmp_path: Path) -> None:
    scene = written(tmp_path, ARM)
    axes = ("elbow", "shoulder")
    for axis in axes:
        out = tmp_path / axis
        Export(str(scene), "pi", out, allow_active=True, axis=axis).run()
        assert {path.name for path in out.iterdir()} == set(export_files(axis))
    (tmp_path / "both.c").write_text(PROGRAM)
    library = tmp_path / "both.so"
    sources = [
        str(tmp_path / axis / name)
        for axis in axes
        for name in (f"cc_{axis}_parameters.c", f"cc_{axis}_controller.o")
    ]
    subprocess.run(
        [str(COMPILER), "-std=c99", "-shared", "-fPIC", "-o", str(library),
         *(f"-I{tmp_path / axis}" for axis in axes),
         str(tmp_path / "both.c"), *sources, "-lm"],
        check=True,
    )  # fmt: skip
    both = ctypes.CDLL(str(library))
    assert both.start() == 0
    device = find_device(scene)
    drives = DeviceModel(device.description, bare_model(device).compile()).drives(1e-3)
    laws = [controller("pi", drive) for drive in drives]
    found = (ctypes.c_double * 2)()
    for k in range(50):
        speed, torque, desired = 0.1 * np.sin(k), 1.0 + 0.3 * np.cos(k), 2.0
        both.step(*map(ctypes.c_double, (speed, torque, desired)), found)
        seen = {
            "motor_velocity_rad_s": speed, "joint_velocity_rad_s": 0.0,
            "joint_torque_nm": torque, "desired_torque_nm": desired,
        }  # fmt: skip
        assert list(found) == [law.torque(seen) for law in laws]
    assert found[0] != found[1]


@pytest.mark.shared
@pytest.mark.parametrize(
    "name",
    [
        "knee_exo",
        pytest.param("elbow", marks=pytest.mark.study),
        pytest.param("knee4", marks=pytest.mark.study),
        pytest.param("knee_mid", marks=pytest.mark.study),
    ],
)
def test_devices_of_others_are_exported(name: str, tmp_path: Path) -> None:
    scene = str(CASES / f"{name}.xml")
    Export(scene, "stiction", tmp_path / "out", allow_active=True).run()
    header = (tmp_path / "out" / "cc_controller.h").read_text()
    assert f"stiction for the scene {scene}, on host" in header
