"""Acting as soon as another package is imported, without importing it.

MuJoCo knows this package's plugin, and Gymnasium its environments, from the moment
that both packages are imported, in either order. Importing them here instead would make
whoever needs neither wait for them: `cc-mujoco --help` for more than a second.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from importlib.machinery import ModuleSpec
from types import ModuleType


class _Waiting:
    """A finder that finds nothing itself, and adds an action to one package's import.

    It is no `importlib.abc.MetaPathFinder`, whose import alone takes 30 ms.
    """

    def __init__(self, name: str, then: Callable[[], object]) -> None:
        self._name, self._then = name, then

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if name != self._name:
            return None
        others = (finder for finder in sys.meta_path if finder is not self)
        found = (finder.find_spec(name, path, target) for finder in others)
        spec = next((spec for spec in found if spec is not None), None)
        if spec is None or spec.loader is None:
            return spec
        execute = spec.loader.exec_module

        def execute_and_act(module: ModuleType) -> None:
            execute(module)
            self._then()

        spec.loader.exec_module = execute_and_act  # type: ignore[method-assign]
        return spec


def when_imported(name: str, then: Callable[[], object]) -> None:
    """Call `then` now if a package is imported, else at the end of its import.

    Args:
        name: Of a package.
        then: May be called again, if the package is imported anew.
    """
    if name in sys.modules:
        then()
    sys.meta_path.insert(0, _Waiting(name, then))
