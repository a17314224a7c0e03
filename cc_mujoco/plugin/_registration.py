"""Registration of the engine plugin with MuJoCo."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco

from cc_mujoco._utils.code_stamp import digest
from cc_mujoco.cable._parameters import KEYS
from cc_mujoco.plugin._engine import LIBRARY, PLUGIN
from cc_mujoco.plugin._prebuilt import address_in_library, use_library

PLUGIN_LIBRARY = "libcc_mujoco_cable.so"
"""File name of the shared library of the plugin."""
_CARRIED = Path(__file__).with_name(PLUGIN_LIBRARY)
NEEDED_STAGE = int(mujoco.mjtStage.mjSTAGE_ACC)
CALLBACK_FIELDS = (
    "nstate", "nsensordata", "init", "destroy", "copy", "reset", "compute", "advance",
    "visualize", "actuator_act_dot", "sdf_distance", "sdf_gradient",
    "sdf_staticdistance", "sdf_attribute", "sdf_aabb",
)  # fmt: skip

_ADDRESS, _INTEGER = ctypes.c_ssize_t, ctypes.c_int32
PYTHON_FUNCTIONS = {
    "settle": ctypes.CFUNCTYPE(None, _ADDRESS, _ADDRESS, _INTEGER, _INTEGER),
    "limits": ctypes.CFUNCTYPE(None, _ADDRESS, _ADDRESS, _INTEGER, _ADDRESS),
    "holds": ctypes.CFUNCTYPE(_INTEGER, _ADDRESS, _ADDRESS, _INTEGER),
    "turn": ctypes.CFUNCTYPE(ctypes.c_double, _ADDRESS, _ADDRESS, _INTEGER),
    "wrap": ctypes.CFUNCTYPE(None, _ADDRESS, _ADDRESS, _INTEGER, _ADDRESS),
    "compliance": ctypes.CFUNCTYPE(None, _ADDRESS, _ADDRESS, _INTEGER, _ADDRESS),
    "route": ctypes.CFUNCTYPE(_INTEGER, _ADDRESS, _INTEGER),
}
"""Compiled functions that Python calls, in compiled code `cc_mujoco_<name>`."""
DIGEST_NAME = "cc_mujoco_digest"
"""Name of the text in a shared library of the plugin that identifies its code."""


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

    A shared library of the plugin that lies in this package is loaded, if it was made
    of these sources for this MuJoCo; otherwise the plugin is compiled, or read from
    Numba's cache. One that the process has loaded from a library before stays.

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
        file = file_of(plugin.init)
        if file is not None:
            use_library(_require_same_code(file))
        return
    library = _load_carried()
    if library is not None:
        use_library(library)
    else:
        add_plugin(PLUGIN, compiled_callbacks(), KEYS, plugin_capabilities())


def plugin_function(name: str) -> Any:
    """Return a compiled function of the registered plugin, see `PYTHON_FUNCTIONS`."""
    kind, symbol = PYTHON_FUNCTIONS[name], f"cc_mujoco_{name}"
    return kind(_address_of(symbol))


def _address_of(symbol: str) -> int:
    """Return the address of compiled code or its data in this process."""
    address = address_in_library(symbol)
    if address is None:
        import llvmlite.binding  # type: ignore[import-untyped]

        address = llvmlite.binding.address_of_symbol(symbol)
    return int(address)


def warned_digests() -> ctypes.Array[ctypes.c_char]:
    """Return the memory of the digests of warnings that this process has issued."""
    from cc_mujoco.plugin._ffi import DIGEST_SLOTS, DIGEST_TABLE  # takes long to load

    return (ctypes.c_char * (8 * DIGEST_SLOTS)).from_address(_address_of(DIGEST_TABLE))


def code_digest() -> str:
    """Return the digest of the plugin's sources and of the version of MuJoCo."""
    return digest(Path(__file__), Path(__file__).parents[1])


def _load_carried() -> ctypes.CDLL | None:
    """Load the shared library in this package, if it fits; that registers the plugin.

    It runs on every x86-64 processor; a system with an older glibc than the one it was
    linked with, or without glibc, cannot load it. A line on standard error then gives
    the loader's reason.
    """
    if not _CARRIED.is_file() or code_digest().encode() not in _CARRIED.read_bytes():
        return None
    try:
        library = ctypes.CDLL(str(_CARRIED))
    except OSError as error:
        if sys.stderr is not None:
            sys.stderr.write(
                f"cc_mujoco: the compiled plugin does not load ({error}); it is "
                "compiled anew, for one to two minutes.\n"
            )
        return None
    return library if plugin_slot() >= 0 else None


class _SymbolInfo(ctypes.Structure):
    """`Dl_info` of dlfcn.h."""

    _fields_ = (
        ("file", ctypes.c_char_p),
        ("base", ctypes.c_void_p),
        ("symbol", ctypes.c_char_p),
        ("address", ctypes.c_void_p),
    )


def file_of(address: int) -> str | None:
    """Return the shared library that an address lies in; none has what Numba made."""
    if sys.platform != "linux":
        return None
    info = _SymbolInfo()
    found = ctypes.CDLL(None).dladdr(ctypes.c_void_p(address), ctypes.byref(info))
    return os.fsdecode(info.file) if found and info.file else None


def _require_same_code(file: str) -> ctypes.CDLL:
    """Return a loaded library of the plugin if it was made of these sources.

    Raises:
        ImportError: it was made of others.
    """
    library = ctypes.CDLL(file)
    try:
        made_of = ctypes.c_char.in_dll(library, DIGEST_NAME)
    except ValueError:
        same = False
    else:
        same = ctypes.string_at(ctypes.addressof(made_of)).decode() == code_digest()
    if not same:
        raise ImportError(
            f"the plugin `{PLUGIN}` of this process is that of {file}, written by "
            "another version of cc_mujoco; write it anew with `cc-mujoco plugin`, or "
            "do not load it"
        )
    return library


def plugin_capabilities() -> int:
    """Return the capabilities of the plugin, `mjtPluginCapabilityBit`."""
    from mujoco.introspect.enums import ENUMS

    bits = ENUMS["mjtPluginCapabilityBit"].values
    return int(bits["mjPLUGIN_ACTUATOR"]) | int(bits["mjPLUGIN_PASSIVE"])


def compiled_callbacks() -> dict[str, Any]:
    """Return the compiled callbacks by their names in `mjpPlugin`.

    Raises:
        ImportError: this MuJoCo lays its structures out in another way than it says.
    """
    from cc_mujoco.plugin import _mj_offsets as mj_offsets
    from cc_mujoco.plugin._callbacks import compile_callbacks

    mj_offsets.verify()
    try:
        return compile_callbacks(cache=True)
    except RuntimeError:  # Numba finds no folder for its cache.
        return compile_callbacks(cache=False)


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
