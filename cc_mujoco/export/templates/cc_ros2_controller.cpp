/* A controller of ros2_control around cc_controller_step; ROS 2 Jazzy.
 *
 * Parameters: motors and joints, the names of the joints in the robot's description, of
 * every axis ($axes); desired_timeout, after
 * which the desired torques are zero [s]; tension_interfaces, the state interfaces of
 * the tensions ($tensions).
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
{
using controller_interface::CallbackReturn;
using controller_interface::InterfaceConfiguration;
using controller_interface::interface_configuration_type;
using controller_interface::return_type;

class Controller : public controller_interface::ControllerInterface
{
public:
  CallbackReturn on_init() override
  {
    using Names = std::vector<std::string>;
    auto_declare<Names>("motors", {$motors});
    auto_declare<Names>("joints", {$joints});
    auto_declare<double>("desired_timeout", 0.1);
    auto_declare<Names>("tension_interfaces", {});
    return CallbackReturn::SUCCESS;
  }

  CallbackReturn on_configure(const rclcpp_lifecycle::State &) override
  {
    motors_ = get_node()->get_parameter("motors").as_string_array();
    joints_ = get_node()->get_parameter("joints").as_string_array();
    timeout_ = get_node()->get_parameter("desired_timeout").as_double();
    tensions_ = get_node()->get_parameter("tension_interfaces").as_string_array();
    if (motors_.size() != CC_AXES || joints_.size() != CC_AXES ||
        tensions_.size() != $tension_count) {
      RCLCPP_ERROR(get_node()->get_logger(),
                   "motors and joints must have %d names, tension_interfaces "
                   "$tension_count", static_cast<int>(CC_AXES));
      return CallbackReturn::ERROR;
    }
    const double period = cc_controller_parameters[CC_$period];
    const double rate = static_cast<double>(get_update_rate());
    if (rate != 0.0 && std::abs(rate * period - 1.0) > 1e-6) {
      RCLCPP_ERROR(get_node()->get_logger(), "update_rate must be %g", 1.0 / period);
      return CallbackReturn::ERROR;
    }
    subscription_ = get_node()->create_subscription<std_msgs::msg::Float64MultiArray>(
      "~/desired_torque", 1, [this](const std_msgs::msg::Float64MultiArray & message) {
        if (message.data.size() != CC_AXES) return;
        for (int i = 0; i < CC_AXES; i++) desired_[i] = message.data[i];
        is_new_ = true;
      });
    return CallbackReturn::SUCCESS;
  }

  InterfaceConfiguration command_interface_configuration() const override
  {
    std::vector<std::string> names;
    for (const auto & motor : motors_) names.push_back(motor + "/effort");
    return {interface_configuration_type::INDIVIDUAL, names};
  }

  InterfaceConfiguration state_interface_configuration() const override
  {
    std::vector<std::string> names = {$states};
    names.insert(names.end(), tensions_.begin(), tensions_.end());
    return {interface_configuration_type::INDIVIDUAL, names};
  }

  CallbackReturn on_activate(const rclcpp_lifecycle::State &) override
  {
    age_ = timeout_;
    const int wrong = cc_controller_init(&controller_, cc_controller_parameters);
    return wrong == 0 ? CallbackReturn::SUCCESS : CallbackReturn::ERROR;
  }

  CallbackReturn on_deactivate(const rclcpp_lifecycle::State &) override
  {
    command({});
    return CallbackReturn::SUCCESS;
  }

  return_type update(const rclcpp::Time &, const rclcpp::Duration & period) override
  {
    age_ = is_new_.exchange(false) ? 0.0 : age_ + period.seconds();
    Torques desired{}, torques{};
    for (int i = 0; i < CC_AXES; i++)
      desired[i] = age_ < timeout_ ? desired_[i].load() : 0.0;
    cc_readings readings{};
$assigned
    const int wrong = cc_controller_step(&controller_, &readings, torques.data());
    command(torques);
    return wrong == 0 ? return_type::OK : return_type::ERROR;
  }

private:
  using Torques = std::array<double, CC_AXES>;

  void command(const Torques & torques)
  {
    for (int i = 0; i < CC_AXES; i++)
      static_cast<void>(command_interfaces_[i].set_value(torques[i]));
  }

  cc_controller controller_{};
  std::vector<std::string> motors_, joints_, tensions_;
  double timeout_ = 0.0, age_ = 0.0;
  std::array<std::atomic<double>, CC_AXES> desired_{};
  std::atomic<bool> is_new_{false};
  rclcpp::Subscription<std_msgs::msg::Float64MultiArray>::SharedPtr subscription_;
};
}  // namespace cc_controller_ros

PLUGINLIB_EXPORT_CLASS(cc_controller_ros::Controller,
                       controller_interface::ControllerInterface)
