"""Controllers from outside: any `module:function`, and policies of Stable-Baselines3.

    controller("my_module:my_function", drive)      # called with the drive
    controller("runs/policy.zip", drive)            # a saved policy

What the function returns is a `Controller`, or a function from what is measured to the
torque of the motor [Nm].
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco.control.controller import Controller
from cc_mujoco.control.drive import Drive
from cc_mujoco.errors import CableError


class External(Controller):
    """A function of what is measured, with the motor's limits around it.

    It is made anew, by the function that makes it, before every episode.
    """

    def __init__(self, drive: Drive, make: Callable[[Drive], Any]) -> None:
        """Make the function.

        Args:
            drive: The device to be driven.
            make: Called with the drive; returns a function of the observation.
        """
        super().__init__(drive)
        self._make = make
        self._law = make(drive)

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Make the function anew, for all environments; see `Controller.reset`."""
        if where is None:
            self._law = self._make(self.drive)

    def torque(self, observation: Mapping[str, Any]) -> Any:
        """Torque of the motor [Nm]; see `Controller.torque`."""
        return self.limited(self._law(observation))


def from_callable(name: str, drive: Drive) -> Controller:
    """The controller that `module:function` makes; see the module's documentation.

    Modules are found as by `import` in the folder of the call.

    Raises:
        CableError: If there is no such module or function, or it makes no controller.
    """
    place, _, function = name.partition(":")
    here = os.getcwd()
    sys.path.insert(0, here)
    try:
        make = getattr(importlib.import_module(place), function)
    except ModuleNotFoundError as error:
        if error.name is None or not place.startswith(error.name):
            raise
        raise CableError(
            f"controller {name!r}: there is no module {place!r}; it must be importable "
            f"or lie in {here}."
        ) from None
    except AttributeError:
        raise CableError(
            f"controller {name!r}: module {place!r} has no {function!r}."
        ) from None
    finally:
        sys.path.remove(here)
    made = make(drive)
    if isinstance(made, Controller):
        return made
    if callable(made):
        return External(drive, make)
    raise CableError(
        f"controller {name!r}: called with a Drive it must return a Controller or a "
        f"function of the observation, not {made!r}."
    )


def features(observation: Mapping[str, Any], drive: Drive) -> NDArray[np.float32]:
    """What a policy sees, of the size of 1: (6,), or (environments, 6).

    Angles in rad, velocities in 10 rad/s of the joint, joint torques in tenths of the
    greatest, all referred to the joint; the last is the torque that is lacking.
    """
    ratio, most = drive.ratio, 0.1 * abs(drive.ratio) * drive.high
    desired, torque = observation["desired_torque_nm"], observation["joint_torque_nm"]
    motor = observation["motor_angle_rad"] / ratio
    seen = (
        10.0 * (motor - observation["joint_angle_rad"]),
        0.1 * observation["motor_velocity_rad_s"] / ratio,
        observation["joint_angle_rad"],
        observation["joint_velocity_rad_s"],
        desired / most,
        (desired - torque) / most,
    )
    found: NDArray[np.float32] = np.stack(seen, axis=-1).astype(np.float32)
    return np.clip(found, -10.0, 10.0)


class Policy(Controller):
    """A policy that Stable-Baselines3 saved: `features` in, share of full torque out.

    `scripts/train_policy.py` trains one.
    """

    def __init__(self, drive: Drive, path: str | os.PathLike[str]) -> None:
        """Load the policy.

        Args:
            drive: The device to be driven.
            path: The file.

        Raises:
            CableError: If Stable-Baselines3 is not installed, or the file cannot be
                read or has a policy for something else.
        """
        super().__init__(drive)
        if not os.path.isfile(path):
            raise CableError(f"policy {os.fspath(path)!r}: there is no such file.")
        try:
            from stable_baselines3 import PPO
        except ModuleNotFoundError:
            raise CableError(
                f"policy {os.fspath(path)!r} needs the package stable-baselines3, "
                "which is not installed."
            ) from None
        try:
            self._policy = PPO.load(path, device="cpu").policy
        except (ValueError, KeyError, AttributeError) as error:
            raise CableError(
                f"policy {os.fspath(path)!r} is not one that PPO saved: {error}."
            ) from None
        if self._policy.observation_space.shape != (6,):
            raise CableError(
                f"policy {os.fspath(path)!r} observes "
                f"{self._policy.observation_space.shape}; it must be (6,), `features`."
            )

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Do nothing; see `Controller.reset`."""

    def torque(self, observation: Mapping[str, Any]) -> Any:
        """Torque of the motor [Nm]; see `Controller.torque`."""
        seen = features(observation, self.drive)
        # One by one: a network rounds differently for one environment and for many.
        rows = np.atleast_2d(seen)
        share = np.array(
            [self._policy.predict(row, deterministic=True)[0][0] for row in rows]
        ).astype(np.float64)
        torque = np.clip(share, -1.0, 1.0) * self.drive.high
        return self.limited(torque if seen.ndim == 2 else float(torque[0]))
