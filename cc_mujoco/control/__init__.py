"""Torque controllers: from what a device can measure to the torque of its motor."""

from __future__ import annotations

from cc_mujoco.control.controller import MEASURED, Controller, Drive
from cc_mujoco.control.controllers import CONTROLLERS, controller
from cc_mujoco.control.feed_forward import FeedForward
from cc_mujoco.control.proportional_integral import ProportionalIntegral

__all__ = [
    "CONTROLLERS",
    "MEASURED",
    "Controller",
    "Drive",
    "FeedForward",
    "ProportionalIntegral",
    "controller",
]
