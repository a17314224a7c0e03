"""The scripted human: motion and impedance of joints, and tasks of the device."""

from typing import Any

import lazy_loader

from cc_mujoco.errors import require_new_name

_attribute, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    """Return a public name of `__init__.pyi`, or refuse one that was renamed."""
    require_new_name(name)
    return _attribute(name)
