"""Package of ROS 2 around an exported controller: a plugin of ros2_control.

Written for ROS 2 Jazzy, by "Writing a new controller" of https://control.ros.org/jazzy.
The tests compile and run it against stand-ins for the headers of ROS; it was neither
built with ROS nor tried on hardware.
"""

from __future__ import annotations

from cc_mujoco.device._drive import Drive
from cc_mujoco.errors import CableError
from cc_mujoco.export._controllers import ExportPlan

ROS2_FILES = ("package.xml", "cc_ros2_plugins.xml", "cc_ros2_controller.cpp")
"""Files of the package besides those of every export."""
_STATES = {
    "motor_angle_rad": ("motor_", "position"),
    "motor_velocity_rad_s": ("motor_", "velocity"),
    "joint_angle_rad": ("joint_", "position"),
    "joint_velocity_rad_s": ("joint_", "velocity"),
    "joint_torque_nm": ("joint_", "effort"),
}
"""State interface of every reading: whose, and which."""


def require_ros2_states(plan: ExportPlan, drive: Drive) -> None:
    """Refuse a controller that does not read what sensors measure.

    Raises:
        CableError: Its model needs to know how a joint winds the cables, or it reads
            the phase of a gait or a commanded angle.
    """
    others = set(plan.law.seen) - {*_STATES, "desired_torque_nm"}
    if others:
        raise CableError(
            f"--ros2-control cannot be with this policy, for it reads "
            f"{', '.join(sorted(others))}, of which ros2_control has no state."
        )
    if not plan.law.has_model or not (drive.lever or drive.crossed):
        return
    why = "pull a lever" if drive.lever else "pass other joints"
    raise CableError(
        f"--ros2-control cannot be with this controller, for the cables {why} and it "
        "reads angle and torque of an equivalent round pulley; write that conversion "
        "around the C code, or export pi or feedback."
    )


def ros2_texts(plan: ExportPlan) -> dict[str, str]:
    """Return the files of the package by name, for an axis without a name."""
    return dict(zip(ROS2_FILES, (PACKAGE, PLUGINS, source(plan)), strict=True))


def source(plan: ExportPlan) -> str:
    """Return the plugin in C++."""
    states = [name for name in plan.law.seen if name in _STATES]
    names = ", ".join(
        f'{whose} + "/{which}"' for whose, which in map(_STATES.__getitem__, states)
    )
    tensions = [name for name, _, _ in plan.tension_readings]
    reads = "\n".join(
        f"    readings.{name} = state_interfaces_[{place}].get_value();"
        for place, name in enumerate([*states, *tensions])
    )
    if "desired_torque_nm" in plan.law.seen:
        reads += "\n    readings.desired_torque_nm = desired;"
    listed = ", ".join(tensions) or "none"
    return f"""/* A controller of ros2_control around cc_controller_step; ROS 2 Jazzy.
 *
 * Parameters: motor and joint, the names of the joints in the robot's description;
 * desired_timeout, after which the desired torque is zero [s]; tension_interfaces, the
 * state interfaces of the tensions ({listed}).
 * Topic: ~/desired_torque, std_msgs/Float64, torque at the joint [N m].
 * Command: effort of the motor, within CC_LOW and CC_HIGH and with no other limit. */
#include <atomic>
#include <cmath>
#include <string>
#include <vector>

#include "controller_interface/controller_interface.hpp"
#include "pluginlib/class_list_macros.hpp"
#include "std_msgs/msg/float64.hpp"

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
    auto_declare<std::string>("motor", "motor");
    auto_declare<std::string>("joint", "joint");
    auto_declare<double>("desired_timeout", 0.1);
    auto_declare<std::vector<std::string>>("tension_interfaces", {{}});
    return CallbackReturn::SUCCESS;
  }}

  CallbackReturn on_configure(const rclcpp_lifecycle::State &) override
  {{
    motor_ = get_node()->get_parameter("motor").as_string();
    joint_ = get_node()->get_parameter("joint").as_string();
    timeout_ = get_node()->get_parameter("desired_timeout").as_double();
    tensions_ = get_node()->get_parameter("tension_interfaces").as_string_array();
    if (tensions_.size() != {len(tensions)}) {{
      RCLCPP_ERROR(get_node()->get_logger(),
                   "tension_interfaces must have {len(tensions)} names");
      return CallbackReturn::ERROR;
    }}
    const double period = cc_controller_parameters[CC_PERIOD];
    const double rate = static_cast<double>(get_update_rate());
    if (rate != 0.0 && std::abs(rate * period - 1.0) > 1e-6) {{
      RCLCPP_ERROR(get_node()->get_logger(), "update_rate must be %g", 1.0 / period);
      return CallbackReturn::ERROR;
    }}
    subscription_ = get_node()->create_subscription<std_msgs::msg::Float64>(
      "~/desired_torque", 1, [this](const std_msgs::msg::Float64 & message) {{
        desired_ = message.data;
        is_new_ = true;
      }});
    return CallbackReturn::SUCCESS;
  }}

  InterfaceConfiguration command_interface_configuration() const override
  {{
    return {{interface_configuration_type::INDIVIDUAL, {{motor_ + "/effort"}}}};
  }}

  InterfaceConfiguration state_interface_configuration() const override
  {{
    std::vector<std::string> names = {{{names}}};
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
    command(0.0);
    return CallbackReturn::SUCCESS;
  }}

  return_type update(const rclcpp::Time &, const rclcpp::Duration & period) override
  {{
    age_ = is_new_.exchange(false) ? 0.0 : age_ + period.seconds();
    const double desired = age_ < timeout_ ? desired_.load() : 0.0;
    cc_readings readings{{}};
{reads}
    const double torque = cc_controller_step(&controller_, &readings);
    const bool possible = std::isfinite(torque);  // not after an impossible reading
    command(possible ? torque : 0.0);
    return possible ? return_type::OK : return_type::ERROR;
  }}

private:
  void command(double torque)
  {{
    static_cast<void>(command_interfaces_[0].set_value(torque));
  }}

  cc_controller controller_{{}};
  std::string motor_, joint_;
  std::vector<std::string> tensions_;
  double timeout_ = 0.0, age_ = 0.0;
  std::atomic<double> desired_{{0.0}};
  std::atomic<bool> is_new_{{false}};
  rclcpp::Subscription<std_msgs::msg::Float64>::SharedPtr subscription_;
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
