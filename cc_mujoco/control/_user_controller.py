"""Controllers from outside: any `module:function`.

    controller("my_module:my_function", drive)      # called with the drive

The function returns a `Controller`, or a function from measurements to the torque of
the motor [N m]. An exception inside becomes a `CableError` with its location; the
exception itself is its cause.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._utils import user_code
from cc_mujoco.control._controller import Controller
from cc_mujoco.device._drive import Drive
from cc_mujoco.errors import CableError


class _Readings(dict[str, Any]):
    """Measurements, whose error for a misspelt name lists the names."""

    def __missing__(self, name: str) -> Any:
        error = KeyError(name)
        error.add_note(str(CableError.unknown("reading", name, self)))
        raise error


class External(Controller):
    """User function of the measurements, with the motor's limits applied.

    It is made anew, by the function that makes it, before every episode.
    """

    def __init__(
        self, drive: Drive, make: Callable[[Drive], Any], name: str = "function"
    ) -> None:
        """Prepare; `make` of the drive returns a function of the observation."""
        super().__init__(drive)
        self._make_controller = make
        self.name = name
        self._law = make(drive)

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        if where is None:
            self._law = self._make_controller(self.drive)

    def torque(self, observation: Mapping[str, Any]) -> Any:
        """Return the torque of the motor [N m]; see `Controller.torque`.

        Raises:
            CableError: If the function raises, or returns what is not real numbers.
        """
        with controller_errors(self.name):
            torque = self._law(_Readings(observation))
        given = np.asarray(torque)
        if given.dtype.kind not in "fiu":
            raise CableError(
                f"controller {self.name!r} gave {torque!r}; it must be a torque in N m."
            )
        # Infinity is a division by zero, not a request for the motor's largest torque.
        return self.limited(np.where(np.isfinite(given), given, np.nan)[()])


def from_callable(given: str | Callable[[Drive], Any], drive: Drive) -> Controller:
    """Return the controller that a function makes; see the module's documentation.

    Args:
        given: `module:function`, found as by `import` in the folder of the call, or the
            function itself.
        drive: The device to be driven.

    Raises:
        CableError: If there is no such module or function, it makes no controller,
            either takes other than one argument, or its code raises.
    """
    if isinstance(given, str):
        name, make = given, user_code.named_object("controller", given, "function")
    else:
        name, make = getattr(given, "__qualname__", type(given).__name__), given
    place, _, function = name.rpartition(":")
    if not callable(make):
        raise CableError(
            f"controller {name!r}: module {place!r} has no function {function!r}."
        )
    _require_one_argument(name, make, f"{function!r}", "the drive")
    with controller_errors(name):
        made = make(drive)
    if isinstance(made, Controller):
        return made
    if callable(made):
        _require_one_argument(
            name, made, f"what {function!r} returns", "what is measured"
        )
        return External(drive, make, name)
    raise CableError(
        f"controller {name!r}: called with a Drive it must return a Controller or a "
        f"function of the observation, not {made!r}."
    )


def _require_one_argument(name: str, called: Any, which: str, what: str) -> None:
    """Refuse a function that cannot be called with one argument."""
    try:
        signature = inspect.signature(called)
    except (TypeError, ValueError):  # some of extension modules have none
        return
    try:
        signature.bind(None)
    except TypeError:
        code = getattr(inspect.unwrap(called), "__code__", None)
        where = f" in {code.co_filename}, line {code.co_firstlineno}," if code else ""
        raise CableError(
            f"controller {name!r}: {which}{where} must take one argument, {what}, but "
            f"takes {signature}."
        ) from None


def controller_errors(name: str) -> AbstractContextManager[None]:
    """Report in one sentence which controller raised which error, and where."""
    return user_code.user_errors(f"controller {name!r}")
