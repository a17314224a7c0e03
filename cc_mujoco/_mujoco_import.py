"""Registration with MuJoCo and Gymnasium at their import, whichever comes first.

MuJoCo has to know the plugin before it loads a model with cables, and Gymnasium the
environments before it makes one. Both take a second to import, for which a program
without them need not wait. The entry points that MuJoCo 4 calls do the same, but MuJoCo
3 calls none.
"""

import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

from cc_mujoco.errors import CableError

OLDEST_MUJOCO = (3, 17)
"""Oldest release of MuJoCo on which the plugin is right; tested on it and the newest.

Earlier ones load it, but not all cables on open paths conserve energy there.
"""


class OldMujocoError(CableError, ImportError):
    """A part of this package that the installed MuJoCo is too old for."""


def register_with_mujoco() -> None:
    """Register the plugin now, or once MuJoCo has been imported.

    On a MuJoCo before `OLDEST_MUJOCO` the plugin is left out.
    """
    _after_import("mujoco", _register)


def register_with_gymnasium() -> None:
    """Register the environments now, or once Gymnasium has been imported."""
    _after_import("gymnasium", lambda: import_module("cc_mujoco.envs").register())


def _after_import(name: str, register: Callable[[], None]) -> None:
    if name in sys.modules:
        register()
    else:
        sys.meta_path.insert(0, _Finder(name, register))


def require_plugin_support() -> None:
    """Require a MuJoCo that can run the plugin.

    Raises:
        OldMujocoError: it is older than `OLDEST_MUJOCO`.
    """
    if not supports_plugin():
        oldest = ".".join(map(str, OLDEST_MUJOCO))
        raise OldMujocoError(
            f"cables inside MuJoCo need mujoco {oldest} or newer, not "
            f"{_mujoco().__version__}: `pip install --upgrade mujoco`, or use the "
            "parts without it, such as cc_mujoco.cable and cc_mujoco.control."
        )


def _mujoco() -> Any:
    return import_module("mujoco")


def supports_plugin() -> bool:
    major, minor = OLDEST_MUJOCO
    return bool(_mujoco().mj_version() >= 1_000_000 * major + 1_000 * minor)


def _register() -> None:
    if supports_plugin():
        import_module("cc_mujoco.plugin")


class _Finder(MetaPathFinder):
    """Finder that finds one module as later finders do, and registers once it loads."""

    def __init__(self, name: str, register: Callable[[], None]) -> None:
        self._name, self._register = name, register

    def find_spec(
        self,
        fullname: str,
        path: Sequence[str] | None,
        target: ModuleType | None = None,
    ) -> ModuleSpec | None:
        """Return the spec that later finders give for the module; None for others."""
        if fullname != self._name:
            return None
        behind = sys.meta_path[sys.meta_path.index(self) + 1 :]
        found = (finder.find_spec(fullname, path, target) for finder in behind)
        spec = next((spec for spec in found if spec is not None), None)
        if spec is not None and spec.loader is not None:
            loader: Any = spec.loader
            execute = loader.exec_module

            def execute_and_register(module: ModuleType) -> None:
                execute(module)
                if self in sys.meta_path:
                    sys.meta_path.remove(self)
                    self._register()

            loader.exec_module = execute_and_register
        return spec
