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

from cc_mujoco.control import axes_controller
from cc_mujoco.device import DeviceModel, Plant, find_device
from cc_mujoco.errors import CableError
from cc_mujoco.export import ExportPlan, require_ros2_states
from cc_mujoco.export._command import Export
from cc_mujoco.export._files import EXPORT_FILES
from cc_mujoco.export._ros2_control import ROS2_FILES
from hardware.devices import ARM, written

COMPILER = shutil.which("g++") or shutil.which("clang++")
C_COMPILER = shutil.which("gcc") or shutil.which("clang")
NOTHING = 99.0
"""Desired torque that is not sent."""
READ = (
    "motor_angle_rad",
    "motor_velocity_rad_s",
    "joint_angle_rad",
    "joint_velocity_rad_s",
    "joint_torque_nm",
)
STUBS = Path(__file__).with_name("ros2_stubs.hpp")
PROGRAM = """
#include "cc_ros2_controller.cpp"
int main()
{
  const double step = cc_controller_parameters[CC_ELBOW_PERIOD];
  using controller_interface::CallbackReturn;
  std::unique_ptr<controller_interface::ControllerInterface> one(made());
  one->get_node()->parameters["motors"] = std::vector<std::string>{"winch"};
  one->on_init();
  if (one->on_configure({}) != CallbackReturn::ERROR) return 6;
  one->get_node()->parameters["motors"] = std::vector<std::string>{"winch", "drum"};
  one->rate = 3;
  if (one->on_configure({}) != CallbackReturn::ERROR) return 1;
  one->rate = static_cast<unsigned int>(1.0 / step + 0.5);
  if (one->on_configure({}) != CallbackReturn::SUCCESS) return 2;
  const auto states = one->state_interface_configuration().names;
  for (auto & name : states) std::puts(name.c_str());
  const auto commands = one->command_interface_configuration().names;
  for (auto & name : commands) std::puts(name.c_str());
  one->command_interfaces_.resize(commands.size());
  one->state_interfaces_.resize(states.size());
  if (one->on_activate({}) != CallbackReturn::SUCCESS) return 3;
  for (double desired; std::scanf("%lf", &desired) == 1;) {
    for (auto & state : one->state_interfaces_)
      if (std::scanf("%lf", &state.value) != 1) return 4;
    if (desired < 99.0) one->get_node()->heard({{desired, 0.5 * desired}});
    const auto done = one->update({}, rclcpp::Duration{step});
    if (done != controller_interface::return_type::OK) std::puts("error");
    for (auto & command : one->command_interfaces_)
      std::printf("%.17g\\n", command.value);
  }
  one->command_interfaces_[1].value = 1.0;
  one->on_deactivate({});
  return one->command_interfaces_[1].value == 0.0 ? 0 : 5;
}
"""


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ros2")
    export(folder)
    return folder / "package"


def export(folder: Path) -> None:
    scene, out = str(written(folder, ARM)), folder / "package"
    Export(scene, "pi", out, ros2_control=True, no_check=True).run()


def test_a_package_of_ros_2_names_its_plugin(package: Path) -> None:
    names = {path.name for path in package.iterdir()}
    assert names == {*EXPORT_FILES, *ROS2_FILES}
    assert (
        ElementTree.parse(package / "package.xml").findtext("name") == "cc_controller"
    )
    (plugin,) = ElementTree.parse(package / "cc_ros2_plugins.xml").iter("class")
    kind = plugin.get("type")
    assert f"PLUGINLIB_EXPORT_CLASS({kind}," in (
        package / "cc_ros2_controller.cpp"
    ).read_text("utf-8")
    export(package.parent)


@pytest.mark.skipif(COMPILER is None, reason="there is no C++ compiler")
def test_the_plugin_gives_the_torques_of_the_library(
    package: Path, tmp_path: Path
) -> None:
    for name in (
        "controller_interface/controller_interface.hpp",
        "pluginlib/class_list_macros.hpp",
        "std_msgs/msg/float64_multi_array.hpp",
    ):
        path = tmp_path / name
        path.parent.mkdir(parents=True)
        path.write_text(f'#include "{STUBS}"\n')
    (tmp_path / "program.cpp").write_text(PROGRAM)
    program, numbers = tmp_path / "program", tmp_path / "numbers.o"
    law = tmp_path / "law.o"
    run(C_COMPILER, "-std=c99", "-c", package / "cc_parameters.c", "-o", numbers)
    run(C_COMPILER, "-std=c99", "-O2", "-c", package / "cc_controller.c", "-o", law)
    run(
        COMPILER, "-std=c++17", "-Wall", "-Wextra", "-Werror", f"-I{tmp_path}",
        f"-I{package}", "-o", program, tmp_path / "program.cpp",
        law, numbers, "-lm",
    )  # fmt: skip
    device = find_device(package.parent / "device.xml")
    made = DeviceModel(device.description, Plant(device).model())
    drives = made.drives(device.description.period)
    law = axes_controller("pi", drives, made.prefixes)
    silence = round(0.1 / drives[0].period)
    rows, torques = [], []
    for k in range(41 + 2 * silence):
        told, wanted = (2.0 if k < end else 0.0 for end in (40, 39 + silence))
        rows.append([told or NOTHING])
        seen = {}
        for place, prefix in enumerate(made.prefixes):
            speed, torque = 0.1 * np.sin(k + place), 1.0 + 0.3 * np.cos(k + place)
            row = list(map(float, (0.0, speed, 0.0, 0.2 * speed, torque)))
            if k == 40 + 2 * silence:
                row[-1] = math.nan  # the guard rides through one
            rows[-1] += row
            seen |= dict(zip((prefix + name for name in READ), row, strict=True))
            seen[f"{prefix}desired_torque_nm"] = wanted / (1.0 + place)
        torques.append(law.torque(seen))
    lines = run(program, input="\n".join(" ".join(map(repr, row)) for row in rows))
    assert lines[:12] == [
        "winch/position", "winch/velocity", "elbow_joint/position",
        "elbow_joint/velocity", "elbow_joint/effort", "drum/position",
        "drum/velocity", "shoulder_joint/position", "shoulder_joint/velocity",
        "shoulder_joint/effort", "winch/effort", "drum/effort",
    ]  # fmt: skip
    assert list(map(float, lines[12:])) == np.ravel(torques).tolist()
    assert (np.ptp(torques, axis=0) > 0.1).all()


def run(*words: Any, **how: Any) -> list[str]:
    done = subprocess.run(list(map(str, words)), capture_output=True, text=True, **how)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_cables_on_a_lever_are_refused_with_a_model(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(CableError, match="it reads leverage_ratio, of which"):
        Export("ankle", "stiction", out, ros2_control=True).run()
    assert not out.exists()


def test_readings_without_a_state_are_refused() -> None:
    device = find_device("wrist")
    made = DeviceModel(device.description, Plant(device).model())
    drive = made.drives(device.description.period)[0]
    plan = ExportPlan.of("pi", [drive], made.driven)
    require_ros2_states(plan)
    (axis,) = plan.axes
    read = dataclasses.replace(axis, columns=(*axis.columns, "phase_sine"))
    with pytest.raises(CableError, match="it reads phase_sine, of which"):
        require_ros2_states(dataclasses.replace(plan, axes=(read,)))
