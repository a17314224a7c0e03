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
from cc_mujoco.control._disturbance import DisturbanceObserver
from cc_mujoco.control._feed_forward import FeedForward
from cc_mujoco.control._gaussian import LinearQuadraticGaussian
from cc_mujoco.control._model_based import ModelBased
from cc_mujoco.control._policy import Policy
from cc_mujoco.control._predictive import PredictiveCompensation
from cc_mujoco.control._proportional_integral import Feedback, ProportionalIntegral
from cc_mujoco.control._stiction import StictionCompensation
from cc_mujoco.control._tension_feedback import AdaptiveModel, FusedFeedback
from cc_mujoco.control._tuned_feedback import FrictionFeedForward, TunedFeedback
from cc_mujoco.control._user_controller import from_callable
from cc_mujoco.device._drive import Drive
from cc_mujoco.errors import look_up

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
"""Every controller with its default gains, to be called with a `Drive`."""


def controller(name: str | Callable[[Drive], Any], drive: Drive) -> Controller:
    """Make a controller.

    Args:
        name: A key of `CONTROLLERS`, `module:function` or a function itself (see
            `external`), or the file of a policy, `*.safetensors` (see `policy`).
        drive: The device to be driven; environments have it as `unwrapped.drive`.

    Returns:
        The controller, reset.

    Raises:
        CableError: If there is no such controller; names the nearest and all others.
    """
    if not isinstance(name, str):
        return from_callable(name, drive)
    if name.endswith(POLICY_ENDING):
        return Policy(drive, name)
    if is_user_controller(name):
        return from_callable(name, drive)
    return look_up("controller", name, CONTROLLERS)(drive)
