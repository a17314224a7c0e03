"""Package of ROS 2 around an exported controller: a plugin of ros2_control.

Written for ROS 2 Jazzy, by "Writing a new controller" of https://control.ros.org/jazzy.
The tests compile and run it against stand-ins for the headers of ROS; it was neither
built with ROS nor tried on hardware.
"""

from __future__ import annotations

from collections.abc import Iterable

from cc_mujoco.errors import CableError
from cc_mujoco.export._controllers import ExportPlan

ROS2_FILES = ("package.xml", "cc_ros2_plugins.xml", "cc_ros2_controller.cpp")
"""Files of the package besides those of every export."""
_STATES = {
    "motor_angle_rad": ("motors_", "position"),
    "motor_velocity_rad_s": ("motors_", "velocity"),
    "joint_angle_rad": ("joints_", "position"),
    "joint_velocity_rad_s": ("joints_", "velocity"),
    "winding_angle_rad": ("joints_", "position"),
    "winding_velocity_rad_s": ("joints_", "velocity"),
    "joint_torque_nm": ("joints_", "effort"),
}
"""State interface of every reading: whose, and which. Only a guard reads what is wound
without a leverage ratio; the joint's own motion is near enough for it."""


def require_ros2_states(plan: ExportPlan) -> None:
    """Refuse a controller that does not read what sensors measure.

    Raises:
        CableError: It needs to know how a joint winds the cables, or it reads the phase
            of a gait or a commanded angle.
    """
    read = {name for axis in plan.axes for name in axis.columns + axis.other_columns}
    others = read - {*_STATES, "desired_torque_nm"}
    if others:
        raise CableError(
            f"--ros2-control cannot be with this controller, for it reads "
            f"{', '.join(sorted(others))}, of which ros2_control has no state; write "
            "that around the C code, or export pi or feedback."
        )


def ros2_texts(plan: ExportPlan) -> dict[str, str]:
    return dict(zip(ROS2_FILES, (PACKAGE, PLUGINS, source(plan)), strict=True))


def _quoted(names: Iterable[str]) -> str:
    return ", ".join(f'"{name}"' for name in names)


def source(plan: ExportPlan) -> str:
    states: list[str] = []
    reads: list[str] = []
    for place, axis in enumerate(plan.axes):
        for name, column in zip(axis.seen, axis.columns, strict=False):
            if column in _STATES:
                whose, which = _STATES[column]
                reads.append(f"{name} = state_interfaces_[{len(states)}].get_value()")
                states.append(f'{whose}[{place}] + "/{which}"')
            else:
                reads.append(f"{name} = desired[{place}]")
    tensions = [name for axis in plan.axes for name, _, _ in axis.tension_readings]
    reads += [
        f"{name} = state_interfaces_[{place}].get_value()"
        for place, name in enumerate(tensions, len(states))
    ]
    assigned = "\n".join(f"    readings.{one};" for one in reads)
    listed = ", ".join(tensions) or "none"
    prefixes = [f"{name}_" if name else "" for name in plan.names]
    period = next(f.name for f in plan.fields if f.name.endswith("period")).upper()
    return f"""/* A controller of ros2_control around cc_controller_step; ROS 2 Jazzy.
 *
 * Parameters: motors and joints, the names of the joints in the robot's description, of
 * every axis ({", ".join(filter(None, plan.names)) or "one"}); desired_timeout, after
 * which the desired torques are zero [s]; tension_interfaces, the state interfaces of
 * the tensions ({listed}).
 * Topic: ~/desired_torque, std_msgs/Float64MultiArray, torque at every joint [N m].
 * Command: effort of the motors, within their limits and with no other limit. */
#include <array>
#include <atomic>
#include <cmath>
#include <string>
#include <vector>

#include "controller_interface/controller_interface.hpp"
#include "pluginlib/class_list_macros.hpp"
#include "std_msgs/msg/float64_multi_array.hpp"

#include "cc_controller.h"

namespace cc_controller_ros
{{
using controller_interface::CallbackReturn;
using controller_interface::InterfaceConfiguration;
using controller_interface::interface_configuration_type;
using controller_interface::return_type;

class Controller : public controller_interface::ControllerInterface
{{
public:
  CallbackReturn on_init() override
  {{
    using Names = std::vector<std::string>;
    auto_declare<Names>("motors", {{{_quoted(p + "motor" for p in prefixes)}}});
    auto_declare<Names>("joints", {{{_quoted(p + "joint" for p in prefixes)}}});
    auto_declare<double>("desired_timeout", 0.1);
    auto_declare<Names>("tension_interfaces", {{}});
    return CallbackReturn::SUCCESS;
  }}

  CallbackReturn on_configure(const rclcpp_lifecycle::State &) override
  {{
    motors_ = get_node()->get_parameter("motors").as_string_array();
    joints_ = get_node()->get_parameter("joints").as_string_array();
    timeout_ = get_node()->get_parameter("desired_timeout").as_double();
    tensions_ = get_node()->get_parameter("tension_interfaces").as_string_array();
    if (motors_.size() != CC_AXES || joints_.size() != CC_AXES ||
        tensions_.size() != {len(tensions)}) {{
      RCLCPP_ERROR(get_node()->get_logger(),
                   "motors and joints must have %d names, tension_interfaces "
                   "{len(tensions)}", static_cast<int>(CC_AXES));
      return CallbackReturn::ERROR;
    }}
    const double period = cc_controller_parameters[CC_{period}];
    const double rate = static_cast<double>(get_update_rate());
    if (rate != 0.0 && std::abs(rate * period - 1.0) > 1e-6) {{
      RCLCPP_ERROR(get_node()->get_logger(), "update_rate must be %g", 1.0 / period);
      return CallbackReturn::ERROR;
    }}
    subscription_ = get_node()->create_subscription<std_msgs::msg::Float64MultiArray>(
      "~/desired_torque", 1, [this](const std_msgs::msg::Float64MultiArray & message) {{
        if (message.data.size() != CC_AXES) return;
        for (int i = 0; i < CC_AXES; i++) desired_[i] = message.data[i];
        is_new_ = true;
      }});
    return CallbackReturn::SUCCESS;
  }}

  InterfaceConfiguration command_interface_configuration() const override
  {{
    std::vector<std::string> names;
    for (const auto & motor : motors_) names.push_back(motor + "/effort");
    return {{interface_configuration_type::INDIVIDUAL, names}};
  }}

  InterfaceConfiguration state_interface_configuration() const override
  {{
    std::vector<std::string> names = {{{", ".join(states)}}};
    names.insert(names.end(), tensions_.begin(), tensions_.end());
    return {{interface_configuration_type::INDIVIDUAL, names}};
  }}

  CallbackReturn on_activate(const rclcpp_lifecycle::State &) override
  {{
    age_ = timeout_;
    const int wrong = cc_controller_init(&controller_, cc_controller_parameters);
    return wrong == 0 ? CallbackReturn::SUCCESS : CallbackReturn::ERROR;
  }}

  CallbackReturn on_deactivate(const rclcpp_lifecycle::State &) override
  {{
    command({{}});
    return CallbackReturn::SUCCESS;
  }}

  return_type update(const rclcpp::Time &, const rclcpp::Duration & period) override
  {{
    age_ = is_new_.exchange(false) ? 0.0 : age_ + period.seconds();
    Torques desired{{}}, torques{{}};
    for (int i = 0; i < CC_AXES; i++)
      desired[i] = age_ < timeout_ ? desired_[i].load() : 0.0;
    cc_readings readings{{}};
{assigned}
    const int wrong = cc_controller_step(&controller_, &readings, torques.data());
    command(torques);
    return wrong == 0 ? return_type::OK : return_type::ERROR;
  }}

private:
  using Torques = std::array<double, CC_AXES>;

  void command(const Torques & torques)
  {{
    for (int i = 0; i < CC_AXES; i++)
      static_cast<void>(command_interfaces_[i].set_value(torques[i]));
  }}

  cc_controller controller_{{}};
  std::vector<std::string> motors_, joints_, tensions_;
  double timeout_ = 0.0, age_ = 0.0;
  std::array<std::atomic<double>, CC_AXES> desired_{{}};
  std::atomic<bool> is_new_{{false}};
  rclcpp::Subscription<std_msgs::msg::Float64MultiArray>::SharedPtr subscription_;
}};
}}  // namespace cc_controller_ros

PLUGINLIB_EXPORT_CLASS(cc_controller_ros::Controller,
                       controller_interface::ControllerInterface)
"""


PLUGINS = """<library path="cc_controller_ros">
  <class name="cc_controller/Controller" type="cc_controller_ros::Controller"
         base_class_type="controller_interface::ControllerInterface">
    <description>Controller of a Bowden-cable transmission.</description>
  </class>
</library>
"""

PACKAGE = """<?xml version="1.0"?>
<package format="3">
  <name>cc_controller</name>
  <version>0.1.0</version>
  <description>Controller of a Bowden-cable transmission for ros2_control.</description>
  <maintainer email="nobody@example.com">nobody</maintainer>
  <license>Apache-2.0</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <depend>controller_interface</depend>
  <depend>pluginlib</depend>
  <depend>rclcpp</depend>
  <depend>rclcpp_lifecycle</depend>
  <depend>std_msgs</depend>
  <export>
    <build_type>ament_cmake</build_type>
  </export>
</package>
"""

CMAKE_BLOCK = """
enable_language(CXX)
find_package(ament_cmake REQUIRED)
set(CC_ROS2_PACKAGES controller_interface pluginlib rclcpp rclcpp_lifecycle std_msgs)
foreach(package ${CC_ROS2_PACKAGES})
  find_package(${package} REQUIRED)
endforeach()

add_library(cc_controller_ros SHARED cc_ros2_controller.cpp)
target_compile_features(cc_controller_ros PRIVATE cxx_std_17)
target_link_libraries(cc_controller_ros cc_controller)
ament_target_dependencies(cc_controller_ros ${CC_ROS2_PACKAGES})
pluginlib_export_plugin_description_file(controller_interface cc_ros2_plugins.xml)
install(TARGETS cc_controller_ros DESTINATION lib)
ament_package()
"""
