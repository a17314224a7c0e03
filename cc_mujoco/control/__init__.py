"""Torque controllers: from what a device can measure to the torque of its motor."""

from __future__ import annotations

from cc_mujoco.control.controller import Controller
from cc_mujoco.control.controllers import CONTROLLERS, controller
from cc_mujoco.control.disturbance import DisturbanceObserver
from cc_mujoco.control.drive import CableDrive, Drive
from cc_mujoco.control.external import External
from cc_mujoco.control.feed_forward import FeedForward
from cc_mujoco.control.model import CableModel
from cc_mujoco.control.model_based import ModelBased
from cc_mujoco.control.observed import Observed
from cc_mujoco.control.policy import Network, Policy, read_policy, write_policy
from cc_mujoco.control.predictive import PredictiveCompensation
from cc_mujoco.control.proportional_integral import Feedback, ProportionalIntegral
from cc_mujoco.control.stiction import StictionCompensation
from cc_mujoco.control.tensions import AdaptiveModel, FusedFeedback

__all__ = [
    "CONTROLLERS",
    "AdaptiveModel",
    "CableDrive",
    "CableModel",
    "Controller",
    "DisturbanceObserver",
    "Drive",
    "External",
    "FeedForward",
    "Feedback",
    "FusedFeedback",
    "ModelBased",
    "Network",
    "Observed",
    "Policy",
    "PredictiveCompensation",
    "ProportionalIntegral",
    "StictionCompensation",
    "controller",
    "read_policy",
    "write_policy",
]
