"""Bridge to ROS 2, with stand-ins for its Python packages."""

from __future__ import annotations

import socket
import sys
from collections.abc import Callable
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
import ros2_bridge
from rig_end import SILENCE

from cc_mujoco.hardware import Status, UdpRig


class JointState:
    """Message of sensor_msgs."""

    def __init__(self, nanosec: int, **columns: list[Any]) -> None:
        self.header = SimpleNamespace(stamp=SimpleNamespace(sec=1, nanosec=nanosec))
        self.name = columns.get("name", ["other", "knee", "winch"])
        self.position = columns.get("position", [9.0, 0.2, 0.5])
        self.velocity = columns.get("velocity", [9.0, 0.3, 0.6])
        self.effort = columns.get("effort", [9.0, 1.5, 9.0])


class Ros:
    """Node and executor of rclpy; `spin` runs what the test gives it."""

    def __init__(self) -> None:
        self.sent: list[float] = []
        self.errors: list[str] = []
        self.topics: dict[str, Callable[[Any], None]] = {}
        self.tick: Callable[[], None] = lambda: None
        self.script: Callable[[], None] = lambda: None

    def init(self) -> None:
        pass

    def spin(self, node: Ros) -> None:
        self.script()

    def create_node(self, name: str) -> Ros:
        return self

    def create_publisher(self, kind: type, topic: str, depth: int) -> Ros:
        assert topic == "/effort_controller/commands"
        return self

    def publish(self, message: Any) -> None:
        (torque,) = message.data
        self.sent.append(torque)

    def create_subscription(
        self, kind: type, topic: str, call: Callable[[Any], None], how: Any
    ) -> None:
        assert kind is JointState
        self.topics[topic] = call

    def create_timer(self, interval: float, call: Callable[[], None]) -> None:
        self.tick = call

    def get_logger(self) -> SimpleNamespace:
        return SimpleNamespace(error=self.errors.append)


@pytest.fixture
def ros(monkeypatch: pytest.MonkeyPatch) -> Ros:
    made = Ros()
    for name, content in (
        ("rclpy", {key: getattr(made, key) for key in ("init", "spin", "create_node")}),
        ("rclpy.qos", {"qos_profile_sensor_data": None}),
        ("sensor_msgs", {}),
        ("sensor_msgs.msg", {"JointState": JointState}),
        ("std_msgs", {}),
        ("std_msgs.msg", {"Float64MultiArray": SimpleNamespace}),
    ):
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    return made


def test_topics_are_a_rig_for_the_host(
    ros: Ros, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [0.0]
    monkeypatch.setattr(ros2_bridge, "perf_counter", lambda: clock[0])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]

    def script() -> None:
        state = ros.topics["/joint_states"]
        ros.tick()
        host = UdpRig("127.0.0.1", port)
        state(JointState(1))  # nobody is there to hear it
        host.write(0.0)
        ros.tick()
        state(JointState(2))
        seen = host.read()
        assert seen is not None and seen.status == Status.NONE
        assert seen.time == pytest.approx(1.000000002, rel=1e-12)
        assert seen[1:6] == (0.5, 0.6, 0.2, 0.3, 1.5)
        host.write(0.7)
        ros.tick()
        state(JointState(3))
        seen = host.read()
        assert seen is not None and seen.status == Status.ENABLED
        clock[0] = 1.1 * SILENCE
        ros.tick()
        assert ros.sent == [0.0, 0.0, 0.7, 0.0]
        state(JointState(4, name=["knee"]))
        state(JointState(5, effort=[]))
        assert host.read() is None
        host.close()

    ros.script = script
    ros2_bridge.main(["--motor", "winch", "--joint", "knee", "--port", str(port)])
    assert ros.sent[-1] == 0.0
    assert ros.errors == [
        "/joint_states: no joint 'winch' among knee.",
        "/joint_states: a position, a velocity, or the effort of the joint is not "
        "given.",
    ]
