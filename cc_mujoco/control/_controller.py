"""Definition of a controller and of its measurements.

    controller = CONTROLLERS["pi"](env.unwrapped.drive)
    controller.reset()
    observation, info = env.reset(seed=0)
    torque = controller.torque(info)                       # N m at the motor pulley
    env.step(env.unwrapped.action(torque))

Controllers work on numbers and, for many environments at once, on arrays; both give
the same bits.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._utils.arguments import require_kind
from cc_mujoco._utils.exclusive import exclusive
from cc_mujoco.device._drive import Drive
from cc_mujoco.device._sensors import WINDING_COLUMNS
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray


class Controller(ABC):
    """Law for the motor torque; subclasses are small and may keep a state.

    One thread at a time may call one; another meanwhile is a `CableError`.
    """

    name = ""
    """Name in error messages; that of its class where it is empty."""

    def __init_subclass__(cls, **given: Any) -> None:
        """Refuse calls by several threads at once, see `exclusive`."""
        super().__init_subclass__(**given)
        for name in ("reset", "torque", "given"):
            if name in cls.__dict__:
                setattr(cls, name, exclusive(cls.__dict__[name]))

    def __init__(self, drive: Drive) -> None:
        """Prepare for the first episode with a drive."""
        require_kind("drive", drive, Drive)
        self.drive = drive

    @abstractmethod
    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Reset the state, before every episode.

        `where` masks the environments that restart; all of them by default.
        """

    @abstractmethod
    def torque(self, observation: Mapping[str, Any]) -> Any:
        """Return the torque of the motor [N m], inside the limits of the drive.

        Args:
            observation: At least the keys `device.MEASURED_COLUMNS`, each a
                number or an array over environments; others are not read, except
                `device.WINDING_COLUMNS` and, where the drive has such sensors,
                `device.TENSION_COLUMN`.

        Returns:
            A float for numbers, an array for arrays.
        """

    def given(self, torque: Any) -> None:  # noqa: B027, most do not ask
        """Accept the torque that the motor got instead of the last one [N m].

        With several axes it is that of every motor, (axes,). A torque that no motor can
        have got, as it is no number or beyond `guard.MAX_READING`, is ignored.

        A host calls this if its limits (of rate, a soft start) are not those of the
        drive. Otherwise a model would continue from the wrong torque.
        """

    def limited(self, torque: Any) -> Any:
        """Return a torque clipped to the limits of the motor [N m]."""
        within = limit_torques(torque, (self.drive,))
        return within if isinstance(within, np.ndarray) else float(within)


def limit_torques(torque: Any, drives: Sequence[Drive]) -> Any:
    """Return the torques of all motors clipped to their limits [N m].

    The torque is of the only motor, or of each (..., axes). One of another shape is
    returned as it is: the caller of the controller refuses it.
    """
    if len(drives) == 1:
        return np.clip(torque, drives[0].low, drives[0].high)
    if np.shape(torque)[-1:] != (len(drives),):
        return torque
    low, high = zip(*((drive.low, drive.high) for drive in drives), strict=True)
    return np.clip(torque, low, high)


def needs_winding(observation: Mapping[str, Any], drive: Drive) -> bool:
    """Return whether `device.WINDING_COLUMNS` describe the joint: no round pulley.

    Raises:
        CableError: The joint is none, and they are missing.
    """
    if WINDING_COLUMNS[0] in observation:
        return True
    columns = ", ".join(WINDING_COLUMNS)
    if drive.crossed:
        raise CableError(
            f"joint {', '.join(drive.crossed)} winds the cables too; a controller "
            f"with a model of them needs to read {columns}."
        )
    if drive.lever:
        raise CableError(
            "the cables pull a lever, whose arm changes with its angle; a "
            f"controller with a model of them needs to read {columns}."
        )
    return False


def as_round_pulley(observation: Mapping[str, Any], drive: Drive) -> Mapping[str, Any]:
    """Convert measurements to a joint with a round pulley on which the cables wind.

    Models of cables have a constant arm. So angle and velocity of the joint are those
    of that pulley, and both torques are those that its tensions would make there. An
    observation without `device.WINDING_COLUMNS` is assumed to be of such a pulley.

    Raises:
        CableError: Other joints wind the cables too, or they pull a lever.
    """
    if not needs_winding(observation, drive):
        return observation
    angle, velocity, leverage = (observation[name] for name in WINDING_COLUMNS)
    changed = {"joint_angle_rad": angle, "joint_velocity_rad_s": velocity}
    with np.errstate(all="ignore"):  # a torque over an arm of 0 is none
        for name in ("joint_torque_nm", "desired_torque_nm"):
            changed[name] = np.divide(observation[name], leverage)
    return {**observation, **changed}


def readings(observation: Mapping[str, Any], names: Sequence[str]) -> FloatArray:
    """Return the measurements of these names (rows, names); a number is its own row."""
    columns = [np.atleast_1d(np.asarray(observation[name], float)) for name in names]
    seen = np.empty((max(column.size for column in columns), len(names)))
    for place, column in enumerate(columns):
        seen[:, place] = column
    return seen
