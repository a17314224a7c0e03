"""Bridge between `cc-mujoco run` and a robot of ROS 2: packets here, topics there.

    source /opt/ros/jazzy/setup.bash       # and a virtual environment made with
    python scripts/ros2_bridge.py --motor winch --joint knee    # --system-site-packages

To `cc-mujoco run` it is the rig at `--port` of this machine. It reads position and
velocity of the motor, and position, velocity and effort of the joint, from
`/joint_states` (sensor_msgs/JointState), and publishes the motor's torque on
`/effort_controller/commands` (std_msgs/Float64MultiArray), the topic of a
forward_command_controller. Set `update_rate` of the controller manager and the state
broadcaster to the rate of the loop, 500 Hz or more.

A host that is silent for 50 ms loses the torque. A bridge that is gone does not:
forward_command_controller goes on with its last command, so the hardware needs a
watchdog. Never tried with ROS or on hardware; the test has stand-ins for both.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from time import perf_counter
from typing import Any

from rig_end import ServedHost, UdpEnd

from cc_mujoco.hardware import Readings, Status
from cc_mujoco.hardware import _packet as packet


class Bridge:
    """A rig at a UDP port whose sensors and motor are ROS topics."""

    def __init__(
        self, end: UdpEnd, motor: str, joint: str, publish: Callable[[float], None]
    ) -> None:
        self._end, self._names = end, (motor, joint)
        self._publish = publish
        self._host = ServedHost()
        self._count = 0

    def forward(self) -> None:
        """Receive commands, and publish the torque that the watchdog permits."""
        now = perf_counter()
        while (found := self._end.receive()) is not None:
            self._host.take(*found, now)
        self._host.watch(now)
        self._publish(self._host.torque)

    def state(self, message: Any) -> str | None:
        """Send a JointState as a reading; return the reason if it cannot be used."""
        missing = [name for name in self._names if name not in message.name]
        if missing:
            listed = ", ".join(message.name)
            return f"no joint {missing[0]!r} among {listed}."
        motor, joint = map(list(message.name).index, self._names)
        columns = message.position, message.velocity, message.effort
        (angle, speed), (turn, turn_speed, torque) = (
            [column[place] if place < len(column) else math.nan for column in some]
            for place, some in ((motor, columns[:2]), (joint, columns))
        )
        if not all(map(math.isfinite, (angle, speed, turn, turn_speed, torque))):
            return "a position, a velocity, or the effort of the joint is not given."
        status = Status.ENABLED if self._host.enabled else Status.NONE
        stamp = message.header.stamp
        self._count += 1
        if self._host.address is not None:
            data = packet.pack_reading(
                self._count,
                stamp.sec * 1_000_000_000 + stamp.nanosec,
                Readings(0.0, angle, speed, turn, turn_speed, torque, status),
            )
            self._end.send(data, self._host.address)
        return None


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--motor", required=True, help="joint that the motor turns")
    parser.add_argument("--joint", required=True, help="joint that the cables drive")
    parser.add_argument("--port", type=int, default=5005)
    parser.add_argument("--states", default="/joint_states")
    parser.add_argument("--commands", default="/effort_controller/commands")
    given = parser.parse_args(arguments)
    import rclpy
    from rclpy.qos import qos_profile_sensor_data
    from sensor_msgs.msg import JointState
    from std_msgs.msg import Float64MultiArray

    rclpy.init()
    node = rclpy.create_node("cc_mujoco_bridge")
    publisher = node.create_publisher(Float64MultiArray, given.commands, 1)

    def publish(torque: float) -> None:
        publisher.publish(Float64MultiArray(data=[torque]))

    def state(message: Any) -> None:
        if (wrong := bridge.state(message)) is not None:
            node.get_logger().error(f"{given.states}: {wrong}")

    end = UdpEnd("127.0.0.1", given.port)
    bridge = Bridge(end, given.motor, given.joint, publish)
    node.create_subscription(JointState, given.states, state, qos_profile_sensor_data)
    node.create_timer(0.5e-3, bridge.forward)  # s
    try:
        rclpy.spin(node)
    finally:
        publish(0.0)
        end.close()


if __name__ == "__main__":
    main()
