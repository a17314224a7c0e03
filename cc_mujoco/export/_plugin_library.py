"""The engine plugin in C, for MuJoCo without Python.

    write_plugin(folder)         # libcc_mujoco_cable.so, for mj_loadPluginLibrary
    write_plugin_source(folder)  # its source and a CMake file

The library registers the plugin when it is loaded.
"""

import os
from pathlib import Path

from cc_mujoco._utils import atomic_io
from cc_mujoco.errors import CableError
from cc_mujoco.export._templates import fill
from cc_mujoco.native import _library as native_library
from cc_mujoco.native._functions import FUNCTIONS
from cc_mujoco.plugin._registration import PLUGIN_LIBRARY

PLUGIN_SOURCE = "cc_mujoco_cable.c"


def write_plugin(folder: str | os.PathLike[str]) -> Path:
    """Write the engine plugin as a shared library for MuJoCo 3.17 and newer.

    Return its path in the folder.

    Raises:
        CableError: There is no C compiler, it fails, the folder cannot be written, or
            the file is there already.
    """
    path = _place(folder, PLUGIN_LIBRARY)
    with atomic_io.replacing_folder(folder) as partial:
        source = partial / PLUGIN_SOURCE
        source.write_text(_source(), encoding="utf-8")
        native_library.compile_library(partial / PLUGIN_LIBRARY, source)
        source.unlink()
    return path


def write_plugin_source(folder: str | os.PathLike[str]) -> Path:
    """Write the engine plugin as C99 with a CMake file; return the path of the source.

    Raises:
        CableError: The folder cannot be written, or a file is there already.
    """
    path = _place(folder, PLUGIN_SOURCE)
    _place(folder, "CMakeLists.txt")
    cmake = fill("CMakeLists_plugin.txt")
    with atomic_io.replacing_folder(folder) as partial:
        (partial / PLUGIN_SOURCE).write_text(_source(), encoding="utf-8")
        (partial / "CMakeLists.txt").write_text(cmake, encoding="utf-8")
    return path


def _place(folder: str | os.PathLike[str], name: str) -> Path:
    path = Path(folder) / name
    if os.path.lexists(path):
        raise CableError(f"{path} exists; remove it or choose another folder.")
    atomic_io.require_writable(folder)
    return path


def _source() -> str:
    from cc_mujoco.plugin import _callbacks as declared
    from cc_mujoco.plugin._native import source

    assert declared
    callbacks = [f for f in FUNCTIONS if f.symbol and "episode" not in f.symbol]
    return source(callbacks, with_python=False)
