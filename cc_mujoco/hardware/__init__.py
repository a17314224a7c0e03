"""A real rig, driven by the controllers of this package.

cc-mujoco run --rig rig.toml --controller pi --out runs/first
"""

from __future__ import annotations

from cc_mujoco.hardware.address import CanAddress, UdpAddress
from cc_mujoco.hardware.can_rig import CanRig
from cc_mujoco.hardware.clock import Clock, SystemClock
from cc_mujoco.hardware.drives import drive_of
from cc_mujoco.hardware.limits import Limiter, Limits
from cc_mujoco.hardware.log import RunLog, require_free
from cc_mujoco.hardware.loop import Ending, Loop, RunOutcome
from cc_mujoco.hardware.packet import Readings, Status
from cc_mujoco.hardware.rig import Rig
from cc_mujoco.hardware.settings import Settings, read_settings
from cc_mujoco.hardware.stops import listening
from cc_mujoco.hardware.udp_rig import UdpRig
from cc_mujoco.hardware.watch import Watch, Watchdog

__all__ = [
    "CanAddress",
    "CanRig",
    "Clock",
    "Ending",
    "Limiter",
    "Limits",
    "Loop",
    "Readings",
    "Rig",
    "RunLog",
    "RunOutcome",
    "Settings",
    "Status",
    "SystemClock",
    "UdpAddress",
    "UdpRig",
    "Watch",
    "Watchdog",
    "drive_of",
    "listening",
    "read_settings",
    "require_free",
]
