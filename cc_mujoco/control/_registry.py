"""All controllers by name.

>>> from cc_mujoco.device._drive import Drive
>>> from cc_mujoco.control import controller
>>> drive = Drive(ratio=5.2, low=-1.0, high=1.0, period=0.001)
>>> controller("none", drive).torque({"desired_torque_nm": 2.6})
0.5
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from cc_mujoco._utils.provenance import POLICY_ENDING, is_user_controller
from cc_mujoco.control._backlash_inverse import BacklashInverse
from cc_mujoco.control._controller import Controller
from cc_mujoco.control._distal_feedback import DistalFeedback
from cc_mujoco.control._disturbance import DisturbanceObserver
from cc_mujoco.control._feed_forward import FeedForward
from cc_mujoco.control._gaussian import LinearQuadraticGaussian
from cc_mujoco.control._hysteresis_inverse import (
    BoucWenFeedForward,
    CableInverse,
    LinearFit,
    PrandtlIshlinskiiInverse,
    SmoothBacklashInverse,
)
from cc_mujoco.control._model_based import ModelBased
from cc_mujoco.control._policy import Policy
from cc_mujoco.control._position import IdealRatio
from cc_mujoco.control._predictive import PredictiveCompensation
from cc_mujoco.control._proportional_integral import Feedback, ProportionalIntegral
from cc_mujoco.control._stiction import StictionCompensation
from cc_mujoco.control._tension_feedback import AdaptiveModel, FusedFeedback
from cc_mujoco.control._tuned_feedback import FrictionFeedForward, TunedFeedback
from cc_mujoco.control._user_controller import from_callable
from cc_mujoco.device._drive import Drive
from cc_mujoco.errors import CableError, look_up

CONTROLLERS: dict[str, type[Controller]] = {
    "none": FeedForward,
    "feedback": Feedback,
    "pi": ProportionalIntegral,
    "pi_tuned": TunedFeedback,
    "pi_feed_forward": FrictionFeedForward,
    "inverse": BacklashInverse,
    "lqg": LinearQuadraticGaussian,
    "fused": FusedFeedback,
    "model": ModelBased,
    "stiction": StictionCompensation,
    "disturbance": DisturbanceObserver,
    "predictive": PredictiveCompensation,
    "adaptive": AdaptiveModel,
}
"""Every controller of torque with its default gains, to be called with a `Drive`."""

POSITION_CONTROLLERS: dict[str, type[Controller]] = {
    "none": IdealRatio,
    "linear": LinearFit,
    "backlash_inverse": SmoothBacklashInverse,
    "prandtl_ishlinskii": PrandtlIshlinskiiInverse,
    "bouc_wen": BoucWenFeedForward,
    "cable_inverse": CableInverse,
    "distal_feedback": DistalFeedback,
}
"""Every controller of a joint angle, for a drive that commands one."""


def controller(name: str | Callable[[Drive], Any], drive: Drive) -> Controller:
    """Make a controller.

    Args:
        name: A key of `CONTROLLERS`, or of `POSITION_CONTROLLERS` for a drive that
            commands an angle, `module:function` or a function itself (see
            `_user_controller`), or the file of a policy, `*.safetensors`.
        drive: The device to be driven; environments have it as `unwrapped.drive`.

    Returns:
        The controller, reset.

    Raises:
        CableError: If there is no such controller; names the nearest and all others.
            Or if it commands what the task does not ask for, or needs a sensor at the
            joint that the device does not have.
    """
    if not isinstance(name, str):
        return from_callable(name, drive)
    if name.endswith(POLICY_ENDING):
        return Policy(drive, name)
    if is_user_controller(name):
        return from_callable(name, drive)
    if drive.commands_angle:
        if name in CONTROLLERS and name not in POSITION_CONTROLLERS:
            raise CableError(
                f"controller {name!r} follows a torque, and the task commands an "
                f"angle; take one of {', '.join(POSITION_CONTROLLERS)}."
            )
        return look_up("controller", name, POSITION_CONTROLLERS)(drive)
    if name in POSITION_CONTROLLERS and name not in CONTROLLERS:
        raise CableError(
            f"controller {name!r} follows an angle, and the task commands a torque; "
            "take the task `position`."
        )
    kind = look_up("controller", name, CONTROLLERS)
    if not drive.joint_sensor:
        raise CableError(
            f"controller {name!r} follows a torque that depends on the joint, and this "
            "device measures nothing there; take the task `position`, or set "
            "joint_sensor = true in [sensors]."
        )
    return kind(drive)
