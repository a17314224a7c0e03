"""Controllers from outside: any `module:function`.

    controller("my_module:my_function", drive)      # called with the drive

What the function returns is a `Controller`, or a function from what is measured to the
torque of the motor [Nm]. An exception inside becomes a `CableError` that says where it
was raised; the exception itself is its cause.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco import user_code
from cc_mujoco.control.controller import Controller
from cc_mujoco.control.drive import Drive
from cc_mujoco.errors import CableError


class External(Controller):
    """A function of what is measured, with the motor's limits around it.

    It is made anew, by the function that makes it, before every episode.
    """

    def __init__(
        self, drive: Drive, make: Callable[[Drive], Any], name: str = "function"
    ) -> None:
        """Make the function.

        Args:
            drive: The device to be driven.
            make: Called with the drive; returns a function of the observation.
            name: For error messages.
        """
        super().__init__(drive)
        self._make = make
        self.name = name
        self._law = make(drive)

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        """Make the function anew, for all environments; see `Controller.reset`."""
        if where is None:
            self._law = self._make(self.drive)

    def torque(self, observation: Mapping[str, Any]) -> Any:
        """Torque of the motor [Nm]; see `Controller.torque`.

        Raises:
            CableError: If the function raises, or returns what is not real numbers.
        """
        with blamed(self.name):
            torque = self._law(observation)
        given = np.asarray(torque)
        if given.dtype.kind not in "fiu":
            raise CableError(
                f"controller {self.name!r} gave {torque!r}; it must be a torque in N m."
            )
        # Infinite is a division by zero, not the wish for all that the motor has.
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
    _require_taken(name, make, f"{function!r}", "the drive")
    with blamed(name):
        made = make(drive)
    if isinstance(made, Controller):
        return made
    if callable(made):
        _require_taken(name, made, f"what {function!r} returns", "what is measured")
        return External(drive, make, name)
    raise CableError(
        f"controller {name!r}: called with a Drive it must return a Controller or a "
        f"function of the observation, not {made!r}."
    )


def _require_taken(name: str, called: Any, which: str, what: str) -> None:
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


def blamed(name: str) -> AbstractContextManager[None]:
    """Say in one sentence which controller raised what, and where."""
    return user_code.blamed(f"controller {name!r}")
