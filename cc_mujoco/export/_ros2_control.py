"""Package of ROS 2 around an exported controller: a plugin of ros2_control.

Written for ROS 2 Jazzy, by "Writing a new controller" of https://control.ros.org/jazzy.
The tests compile and run it against stand-ins for the headers of ROS; it was neither
built with ROS nor tried on hardware.
"""

from cc_mujoco.errors import CableError
from cc_mujoco.export._controllers import ExportPlan
from cc_mujoco.export._templates import fill

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
"""State interface of every reading: owner and name. Motion of a winding without a
leverage ratio is read by guards only; the joint's own is accurate enough for them.
"""


def require_ros2_states(plan: ExportPlan) -> None:
    """Refuse a controller whose readings ros2_control has no sensor interfaces for.

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
    prefixes = [f"{name}_" if name else "" for name in plan.names]
    *plain, controller = ROS2_FILES
    text = fill(
        controller,
        axes=", ".join(filter(None, plan.names)) or "one",
        tensions=", ".join(tensions) or "none",
        motors=", ".join(f'"{prefix}motor"' for prefix in prefixes),
        joints=", ".join(f'"{prefix}joint"' for prefix in prefixes),
        tension_count=len(tensions),
        period=next(f.name for f in plan.fields if f.name.endswith("period")).upper(),
        states=", ".join(states),
        assigned="\n".join(f"    readings.{one};" for one in reads),
    )
    return {name: fill(name) for name in plain} | {controller: text}
