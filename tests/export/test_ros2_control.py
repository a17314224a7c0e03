"""Package of ROS 2 around an exported controller, with stand-ins for ROS."""

from __future__ import annotations

import dataclasses
import math
import shutil
import subprocess
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from cc_mujoco.cli._export import Export
from cc_mujoco.control import controller
from cc_mujoco.device import DeviceModel, find_device
from cc_mujoco.device._device import bare_model
from cc_mujoco.errors import CableError
from cc_mujoco.export import ExportPlan, require_ros2_states
from cc_mujoco.export._files import export_files

COMPILER = shutil.which("g++") or shutil.which("clang++")
C_COMPILER = shutil.which("gcc") or shutil.which("clang")
NOTHING = 99.0
"""Desired torque that is not sent."""
READ = (
    "motor_angle_rad",
    "motor_velocity_rad_s",
    "joint_velocity_rad_s",
    "joint_torque_nm",
)
STUBS = Path(__file__).with_name("ros2_stubs.hpp")
PROGRAM = """
#include "cc_ros2_controller.cpp"
int main()
{
  const double step = cc_controller_parameters[CC_PERIOD];
  using controller_interface::CallbackReturn;
  std::unique_ptr<controller_interface::ControllerInterface> one(made());
  one->get_node()->parameters["motor"] = std::string("winch");
  one->on_init();
  one->rate = 3;
  if (one->on_configure({}) != CallbackReturn::ERROR) return 1;
  one->rate = static_cast<unsigned int>(1.0 / step + 0.5);
  if (one->on_configure({}) != CallbackReturn::SUCCESS) return 2;
  const auto states = one->state_interface_configuration().names;
  for (auto & name : states) std::puts(name.c_str());
  std::puts(one->command_interface_configuration().names[0].c_str());
  one->command_interfaces_.resize(1);
  one->state_interfaces_.resize(states.size());
  if (one->on_activate({}) != CallbackReturn::SUCCESS) return 3;
  for (double desired; std::scanf("%lf", &desired) == 1;) {
    for (auto & state : one->state_interfaces_)
      if (std::scanf("%lf", &state.value) != 1) return 4;
    if (desired < 99.0) one->get_node()->heard({desired});
    const auto done = one->update({}, rclcpp::Duration{step});
    if (done != controller_interface::return_type::OK) std::puts("error");
    std::printf("%.17g\\n", one->command_interfaces_[0].value);
  }
  one->command_interfaces_[0].value = 1.0;
  one->on_deactivate({});
  return one->command_interfaces_[0].value == 0.0 ? 0 : 5;
}
"""


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("ros2") / "package"
    Export("wrist", "pi", out, ros2_control=True, allow_active=True).run()
    return out


def test_a_package_of_ros_2_names_its_plugin(package: Path) -> None:
    names = {path.name for path in package.iterdir()}
    assert names == set(export_files(ros2_control=True))
    assert (
        ElementTree.parse(package / "package.xml").findtext("name") == "cc_controller"
    )
    (plugin,) = ElementTree.parse(package / "cc_ros2_plugins.xml").iter("class")
    kind = plugin.get("type")
    assert f"PLUGINLIB_EXPORT_CLASS({kind}," in (
        package / "cc_ros2_controller.cpp"
    ).read_text("utf-8")
    Export("wrist", "pi", package, ros2_control=True, allow_active=True).run()


@pytest.mark.skipif(COMPILER is None, reason="there is no C++ compiler")
def test_the_plugin_gives_the_torques_of_the_library(
    package: Path, tmp_path: Path
) -> None:
    for name in (
        "controller_interface/controller_interface.hpp",
        "pluginlib/class_list_macros.hpp",
        "std_msgs/msg/float64.hpp",
    ):
        path = tmp_path / name
        path.parent.mkdir(parents=True)
        path.write_text(f'#include "{STUBS}"\n')
    (tmp_path / "program.cpp").write_text(PROGRAM)
    program, numbers = tmp_path / "program", tmp_path / "numbers.o"
    run(C_COMPILER, "-std=c99", "-c", package / "cc_parameters.c", "-o", numbers)
    run(
        COMPILER, "-std=c++17", "-Wall", "-Wextra", "-Werror", f"-I{tmp_path}",
        f"-I{package}", "-o", program, tmp_path / "program.cpp",
        package / "cc_controller.o", numbers, "-lm",
    )  # fmt: skip
    device = find_device("wrist")
    made = DeviceModel(device.description, bare_model(device).compile())
    drive = made.drives(device.description.period)[0]
    law = controller("pi", drive)
    silence = round(0.1 / drive.period)
    rows, torques = [], []
    for k in range(40 + 2 * silence):
        told = 2.0 if k < 40 else NOTHING
        row = [0.0, 0.1 * np.sin(k), 0.02 * np.sin(k), 1.0 + 0.3 * np.cos(k)]
        rows.append([told, *map(float, row)])
        seen = dict(zip(READ, row, strict=True))
        seen["desired_torque_nm"] = 2.0 if k < 39 + silence else 0.0
        torques.append(law.torque(seen))
    rows.append([NOTHING, 0.0, math.nan, 0.0, 0.0])
    lines = run(program, input="\n".join(" ".join(map(repr, row)) for row in rows))
    assert lines[:5] == [
        "winch/position", "winch/velocity", "joint/velocity", "joint/effort",
        "winch/effort",
    ]  # fmt: skip
    assert list(map(float, lines[5:-2])) == torques
    assert np.ptp(torques) > 0.1
    assert lines[-2:] == ["error", "0"]  # after a reading that is no number


def run(*words: Any, **how: Any) -> list[str]:
    done = subprocess.run(list(map(str, words)), capture_output=True, text=True, **how)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_cables_on_a_lever_are_refused_with_a_model(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(CableError, match="the cables pull a lever"):
        Export("ankle", "stiction", out, ros2_control=True).run()
    assert not out.exists()


def test_readings_without_a_state_are_refused() -> None:
    device = find_device("wrist")
    made = DeviceModel(device.description, bare_model(device).compile())
    drive = made.drives(device.description.period)[0]
    plan = ExportPlan.of("pi", drive, made.driven[0])
    require_ros2_states(plan, drive)
    law = dataclasses.replace(plan.law, seen=(*plan.law.seen, "phase_sine"))
    with pytest.raises(CableError, match="it reads phase_sine, of which"):
        require_ros2_states(dataclasses.replace(plan, law=law), drive)
