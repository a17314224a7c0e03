// Stand-ins for what a controller of ros2_control uses of ROS 2 Jazzy, to compile and
// run it without ROS. All headers that it includes lead here.
#pragma once
#include <any>
#include <cstdio>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace rclcpp_lifecycle { struct State {}; }
namespace std_msgs::msg { struct Float64MultiArray { std::vector<double> data; }; }
namespace rclcpp
{
struct Time {};
struct Duration
{
  double length;
  double seconds() const { return length; }
};
template <class Message> struct Subscription
{
  using SharedPtr = std::shared_ptr<Subscription>;
  std::function<void(const Message &)> call;
};
struct Parameter
{
  std::any value;
  double as_double() const { return std::any_cast<double>(value); }
  std::vector<std::string> as_string_array() const
  {
    return std::any_cast<std::vector<std::string>>(value);
  }
};
struct Node
{
  std::map<std::string, std::any> parameters;
  std::function<void(const std_msgs::msg::Float64MultiArray &)> heard;
  Parameter get_parameter(const std::string & name) { return {parameters.at(name)}; }
  int get_logger() const { return 0; }
  template <class Message, class Call>
  typename Subscription<Message>::SharedPtr create_subscription(
    const std::string &, int, Call call)
  {
    heard = call;
    return std::make_shared<Subscription<Message>>();
  }
};
}  // namespace rclcpp
#define RCLCPP_ERROR(logger, ...) (static_cast<void>(logger), std::fprintf(stderr, __VA_ARGS__))

namespace controller_interface
{
enum class CallbackReturn { SUCCESS, ERROR };
enum class return_type { OK, ERROR };
enum class interface_configuration_type { INDIVIDUAL };
struct InterfaceConfiguration
{
  interface_configuration_type type;
  std::vector<std::string> names;
};
struct LoanedInterface
{
  double value = 0.0;
  double get_value() const { return value; }
  [[nodiscard]] bool set_value(double given) { value = given; return true; }
};
class ControllerInterface
{
public:
  virtual ~ControllerInterface() = default;
  virtual CallbackReturn on_init() = 0;
  virtual CallbackReturn on_configure(const rclcpp_lifecycle::State &) = 0;
  virtual CallbackReturn on_activate(const rclcpp_lifecycle::State &) = 0;
  virtual CallbackReturn on_deactivate(const rclcpp_lifecycle::State &) = 0;
  virtual InterfaceConfiguration command_interface_configuration() const = 0;
  virtual InterfaceConfiguration state_interface_configuration() const = 0;
  virtual return_type update(const rclcpp::Time &, const rclcpp::Duration &) = 0;
  template <class Kind> void auto_declare(const std::string & name, const Kind & value)
  {
    get_node()->parameters.try_emplace(name, value);
  }
  std::shared_ptr<rclcpp::Node> get_node() { return node_; }
  unsigned int get_update_rate() const { return rate; }
  unsigned int rate = 0;
  std::vector<LoanedInterface> command_interfaces_, state_interfaces_;

private:
  std::shared_ptr<rclcpp::Node> node_ = std::make_shared<rclcpp::Node>();
};
}  // namespace controller_interface
#define PLUGINLIB_EXPORT_CLASS(kind, base) \
  base * made() { return new kind(); }
