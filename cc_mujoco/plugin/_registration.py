"""Registration of the engine plugin with MuJoCo."""

from __future__ import annotations

import ctypes
import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
from mujoco.introspect.enums import ENUMS

from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable._parameters import KEYS
from cc_mujoco.plugin import _mj_offsets as mj_offsets
from cc_mujoco.plugin._callbacks import compile_callbacks
from cc_mujoco.plugin._config import PLUGIN
from cc_mujoco.plugin._ffi import LIBRARY


def _stamp() -> str:
    """Return a digest of what compiled code depends on beyond its own source file.

    Numba's cache checks only the file of a function. The digest also changes with the
    kernel, the parameter table and MuJoCo's layout.
    """
    digest = hashlib.sha256(mujoco.__version__.encode())
    for module in (mj_offsets, kernel):
        for source in sorted(Path(str(module.__file__)).parent.glob("*.py")):
            digest.update(source.read_bytes())
    return digest.hexdigest()


_CAPABILITIES = ENUMS["mjtPluginCapabilityBit"].values
_ACTUATOR = int(_CAPABILITIES["mjPLUGIN_ACTUATOR"])
_PASSIVE = int(_CAPABILITIES["mjPLUGIN_PASSIVE"])
CAPABILITIES = _ACTUATOR | _PASSIVE
"""Capabilities of the plugin, `mjtPluginCapabilityBit`."""
NEEDED_STAGE = int(mujoco.mjtStage.mjSTAGE_ACC)
CALLBACK_FIELDS = (
    "nstate", "nsensordata", "init", "destroy", "copy", "reset", "compute", "advance",
    "visualize", "actuator_act_dot", "sdf_distance", "sdf_gradient",
    "sdf_staticdistance", "sdf_attribute", "sdf_aabb",
)  # fmt: skip


class PluginRecord(ctypes.Structure):
    """`mjpPlugin` of mjplugin.h."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("nattribute", ctypes.c_int),
        ("attributes", ctypes.POINTER(ctypes.c_char_p)),
        ("capabilityflags", ctypes.c_int),
        ("needstage", ctypes.c_int),
        *((name, ctypes.c_void_p) for name in CALLBACK_FIELDS),
    )


def register() -> None:
    """Register the plugin with MuJoCo, once per process.

    Raises:
        ImportError: this MuJoCo cannot run the plugin, or the name is taken by another.
    """
    LIBRARY.mjp_getPlugin.restype = ctypes.POINTER(PluginRecord)
    LIBRARY.mjp_getPlugin.argtypes = (ctypes.c_char_p, ctypes.POINTER(ctypes.c_int))
    present = LIBRARY.mjp_getPlugin(PLUGIN.encode(), None)
    if present:
        plugin = present.contents
        keys = [plugin.attributes[i].decode() for i in range(plugin.nattribute)]
        if keys != list(KEYS):
            raise ImportError(
                f"MuJoCo already has a plugin `{PLUGIN}` with other keys "
                f"({', '.join(keys)}); only one version can be loaded in a process"
            )
        return
    mj_offsets.verify()
    add_plugin(PLUGIN, compiled_callbacks(), KEYS, CAPABILITIES)


def compiled_callbacks() -> dict[str, Any]:
    """Return the compiled callbacks by their names in `mjpPlugin`."""
    stamp = _stamp()
    try:
        return compile_callbacks(stamp, cache=True)
    except RuntimeError:  # Numba finds no folder for its cache.
        return compile_callbacks(stamp, cache=False)


def add_plugin(
    name: str,
    callbacks: Mapping[str, Any],
    keys: Sequence[str] = (),
    capabilities: int = 0,
) -> None:
    """Hand a plugin over to MuJoCo.

    Args:
        name: of the plugin, which MuJoCo must not have yet.
        callbacks: compiled, by their names in `mjpPlugin`.
        keys: of its configuration.
        capabilities: what it is, `mjtPluginCapabilityBit`.
    """
    plugin = PluginRecord()
    LIBRARY.mjp_defaultPlugin(ctypes.byref(plugin))
    plugin.name = name.encode()
    plugin.nattribute = len(keys)
    plugin.attributes = (ctypes.c_char_p * len(keys))(*(k.encode() for k in keys))
    plugin.capabilityflags = capabilities
    plugin.needstage = NEEDED_STAGE
    for which, callback in callbacks.items():
        setattr(plugin, which, callback.address)
    # MuJoCo keeps the addresses for the life of the process, whatever happens to this
    # module; so must what they point to.
    ctypes.pythonapi.Py_IncRef(ctypes.py_object((plugin, callbacks)))
    LIBRARY.mjp_registerPlugin(ctypes.byref(plugin))


def plugin_slot() -> int:
    """Return the MuJoCo's number of the plugin, as in `mjModel.plugin`."""
    number = ctypes.c_int(-1)
    LIBRARY.mjp_getPlugin(PLUGIN.encode(), ctypes.byref(number))
    return number.value
