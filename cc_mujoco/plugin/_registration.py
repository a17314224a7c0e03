"""Registration of the engine plugin with MuJoCo."""

import ctypes
import os
import sys
from collections.abc import Mapping
from typing import Any

import mujoco

from cc_mujoco.cable._cable import KEYS
from cc_mujoco.native import _library as native_library
from cc_mujoco.plugin._engine import LIBRARY, PLUGIN

PLUGIN_LIBRARY = "libcc_mujoco_cable.so"
"""File name of the shared library of the plugin, for a host in C."""
NEEDED_STAGE = int(mujoco.mjtStage.mjSTAGE_ACC)

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
"""Types of the compiled functions `cc_mujoco_<name>` that Python calls, by name."""
ENGINE_NAMES = (
    "mju_malloc", "mju_free", "mju_message", "mj_solveM", "mj_applyFT", "mj_kinematics",
    "mj_tendon", "mj_fullM", "mj_mulM", "mj_isSparse", "mju_cholFactor",
    "mju_cholSolve", "mj_markStack", "mj_freeStack", "mj_stackAllocNum", "mj_version",
    "mjp_registerPlugin", "mju_warning",
)  # fmt: skip
"""MuJoCo's functions that the native library is given, in the order of its table."""
_holder: ctypes.CDLL | None = None
"""Library that holds the registered plugin."""


class PluginRecord(ctypes.Structure):
    """Memory layout of `mjpPlugin`, see mjplugin.h of MuJoCo."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("nattribute", ctypes.c_int),
        ("attributes", ctypes.POINTER(ctypes.c_char_p)),
        ("capabilityflags", ctypes.c_int),
        ("needstage", ctypes.c_int),
        *((name, ctypes.c_void_p) for name in (
            "nstate", "nsensordata", "init", "destroy", "copy", "reset", "compute",
            "advance", "visualize", "actuator_act_dot", "sdf_distance", "sdf_gradient",
            "sdf_staticdistance", "sdf_attribute", "sdf_aabb",
        )),
    )  # fmt: skip


def register() -> None:
    """Register the plugin with MuJoCo, once per process.

    It comes from the native library, which is compiled if need be. If the process has
    loaded the plugin from another library of the same code before, that one stays.

    Raises:
        NativeLibraryError: this MuJoCo cannot run the plugin, or the name is taken by
            another.
    """
    global _holder
    library = native_library.library()
    addresses = (ctypes.c_void_p * len(ENGINE_NAMES))(
        *(ctypes.cast(getattr(LIBRARY, n), ctypes.c_void_p).value for n in ENGINE_NAMES)
    )
    library.cc_mujoco_use_engine(addresses)
    from cc_mujoco.plugin import _mj_offsets as mj_offsets

    paths = _text(library, "cc_mujoco_layout").split()
    layout = (ctypes.c_int64 * len(paths))(*map(mj_offsets.place, paths))
    library.cc_mujoco_use_layout(layout)
    LIBRARY.mjp_getPlugin.restype = ctypes.POINTER(PluginRecord)
    LIBRARY.mjp_getPlugin.argtypes = (ctypes.c_char_p, ctypes.POINTER(ctypes.c_int))
    present = LIBRARY.mjp_getPlugin(PLUGIN.encode(), None)
    if present:
        plugin = present.contents
        keys = [plugin.attributes[i].decode() for i in range(plugin.nattribute)]
        if keys != list(KEYS):
            raise native_library.NativeLibraryError(
                f"MuJoCo already has a plugin `{PLUGIN}` with other keys "
                f"({', '.join(keys)}); only one version can be loaded in a process"
            )
        file = file_of(plugin.init)
        _holder = library if file is None else _require_same_code(file)
        return
    compiled_with = _text(library, "cc_mujoco_enumerators").split()
    pairs = (each.split("=") for each in compiled_with)
    mj_offsets.verify(paths, {name: int(value) for name, value in pairs})
    library.cc_mujoco_register(addresses)
    _holder = library


def _text(library: ctypes.CDLL, name: str) -> str:
    found = ctypes.c_char.in_dll(library, name)
    return ctypes.string_at(ctypes.addressof(found)).decode()


def plugin_function(name: str) -> Any:
    assert _holder is not None
    return PYTHON_FUNCTIONS[name]((f"cc_mujoco_{name}", _holder))


def warned_digests() -> ctypes.Array[ctypes.c_char]:
    from cc_mujoco.plugin._ffi import DIGEST_SLOTS  # takes long to load

    assert _holder is not None
    return (ctypes.c_char * (8 * DIGEST_SLOTS)).in_dll(_holder, "cc_mujoco_said")


class _SymbolInfo(ctypes.Structure):
    """Memory layout of `Dl_info`, see dlfcn.h."""

    _fields_ = (
        ("file", ctypes.c_char_p),
        ("base", ctypes.c_void_p),
        ("symbol", ctypes.c_char_p),
        ("address", ctypes.c_void_p),
    )


def file_of(address: int) -> str | None:
    """Return the file of the shared library that an address is in, None if unknown."""
    if sys.platform == "win32":
        return None
    info = _SymbolInfo()
    found = ctypes.CDLL(None).dladdr(ctypes.c_void_p(address), ctypes.byref(info))
    return os.fsdecode(info.file) if found and info.file else None


def _require_same_code(file: str) -> ctypes.CDLL:
    library = ctypes.CDLL(file)
    try:
        made_of = _text(library, native_library.DIGEST_NAME)
    except ValueError:
        made_of = ""
    if made_of != native_library.digest():
        raise native_library.NativeLibraryError(
            f"the plugin `{PLUGIN}` of this process is that of {file}, written by "
            "another version of cc_mujoco; write it anew with `cc-mujoco plugin`, or "
            "do not load it"
        )
    return library


def add_plugin(name: str, entries: Mapping[str, str]) -> None:
    """Register another plugin of the native library, one without a configuration.

    `entries` are symbols of the library by the names of callbacks in `mjpPlugin`.
    """
    plugin = PluginRecord()
    LIBRARY.mjp_defaultPlugin(ctypes.byref(plugin))
    plugin.name = name.encode()
    plugin.needstage = NEEDED_STAGE
    for which, symbol in entries.items():
        function = getattr(native_library.library(), symbol)
        setattr(plugin, which, ctypes.cast(function, ctypes.c_void_p).value)
    # MuJoCo keeps the addresses for the life of the process, whatever happens to this
    # module; so must what they point to.
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(plugin))
    LIBRARY.mjp_registerPlugin(ctypes.byref(plugin))


def plugin_slot() -> int:
    """Return MuJoCo's number of the plugin, as in `mjModel.plugin`."""
    number = ctypes.c_int(-1)
    LIBRARY.mjp_getPlugin(PLUGIN.encode(), ctypes.byref(number))
    return number.value
