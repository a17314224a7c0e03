"""The engine plugin as a shared library, for MuJoCo without Python.

    write_plugin(folder)  # libcc_mujoco_cable.so, for mj_loadPluginLibrary

The library holds the compiled functions that `cc_mujoco.plugin` registers, and a
constructor that registers them when the library is loaded.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import mujoco

from cc_mujoco._utils import atomic_io
from cc_mujoco._utils.compilation import bitcode_of
from cc_mujoco.cable._parameters import KEYS
from cc_mujoco.errors import CableError
from cc_mujoco.export._targets import LIBM, Target, emit
from cc_mujoco.plugin._engine import LIBRARY, PLUGIN
from cc_mujoco.plugin._ffi import (
    CALLBACKS,
    DIGEST_SLOTS,
    DIGEST_TABLE,
    ENGINE_FUNCTIONS,
)
from cc_mujoco.plugin._registration import (
    CALLBACK_FIELDS,
    DIGEST_NAME,
    NEEDED_STAGE,
    PLUGIN_LIBRARY,
    code_digest,
    compiled_callbacks,
    file_of,
    plugin_capabilities,
)

_CONSTRUCTOR = "cc_mujoco_load"
_TARGET = Target("x86_64-unknown-linux-gnu", "x86-64", "", "any Linux on x86-64")
_PROVIDED = (
    LIBM
    | frozenset(ENGINE_FUNCTIONS)
    | {"mj_version", "mjp_registerPlugin", "mju_error", "mju_warning", "strlen"}
)

# Memory of Numba's arrays as its runtime lays it out: the data's address at byte 24.
# `mju_malloc` reports that memory is exhausted, so no error reaches the other branches.
_RUNTIME = """
declare ptr @mju_malloc(i64)
declare void @mju_free(ptr)
declare double @ldexp(double, i32)
define ptr @NRT_MemInfo_alloc_aligned(i64 %size, i32 %align) {
  %wide = zext i32 %align to i64
  %more = add i64 %wide, 48
  %total = add i64 %size, %more
  %block = call ptr @mju_malloc(i64 %total)
  %start = ptrtoint ptr %block to i64
  %end = add i64 %start, %more
  %over = urem i64 %end, %wide
  %data = sub i64 %end, %over
  store i64 1, ptr %block
  %place = getelementptr i8, ptr %block, i64 24
  store i64 %data, ptr %place
  ret ptr %block
}
define void @NRT_incref(ptr %block) {
  %none = icmp eq ptr %block, null
  br i1 %none, label %end, label %count
count:
  %before = load i64, ptr %block
  %after = add i64 %before, 1
  store i64 %after, ptr %block
  br label %end
end:
  ret void
}
define void @NRT_decref(ptr %block) {
  %none = icmp eq ptr %block, null
  br i1 %none, label %end, label %count
count:
  %before = load i64, ptr %block
  %after = sub i64 %before, 1
  store i64 %after, ptr %block
  %last = icmp eq i64 %after, 0
  br i1 %last, label %free, label %end
free:
  call void @mju_free(ptr %block)
  br label %end
end:
  ret void
}
define void @NRT_MemInfo_call_dtor(ptr %block) {
  call void @mju_free(ptr %block)
  ret void
}
define void @NRT_Free(ptr %block) { ret void }
define double @numba_ldexp(double %x, i32 %exponent) {
  %y = call double @ldexp(double %x, i32 %exponent)
  ret double %y
}
@failed = internal constant [40 x i8] c"cc_mujoco: an array could not be made.\\0A\\00"
declare void @mju_error(ptr, ...)
define void @numba_gil_ensure(ptr %0) {
  call void (ptr, ...) @mju_error(ptr @failed)
  ret void
}
define void @numba_gil_release(ptr %0) { ret void }
define void @numba_do_raise(ptr %0) { ret void }
define ptr @numba_unpickle(ptr %0, i32 %1, ptr %2) { ret ptr null }
define ptr @numba_runtime_build_excinfo_struct(ptr %0, ptr %1) { ret ptr null }
define ptr @PyBytes_FromStringAndSize(ptr %0, i64 %1) { ret ptr null }
define ptr @PyUnicode_FromString(ptr %0) { ret ptr null }
define void @PyErr_Clear() { ret void }
define void @PyErr_SetNone(ptr %0) { ret void }
define void @PyErr_SetString(ptr %0, ptr %1) { ret void }
define void @PyErr_WriteUnraisable(ptr %0) { ret void }
define void @Py_DecRef(ptr %0) { ret void }
@PyExc_StopIteration = constant i64 0
@PyExc_SystemError = constant i64 0
@PyExc_RuntimeError = constant i64 0
"""


def write_plugin(folder: str | os.PathLike[str]) -> Path:
    """Write the engine plugin as a shared library for this version of MuJoCo.

    Args:
        folder: Where; no file of that name may be there.

    Returns:
        The path of the library.

    Raises:
        CableError: The machine is not Linux with glibc on x86-64, it has no linker, the
            folder cannot be written, or the file is there already.
    """
    path = Path(folder) / PLUGIN_LIBRARY
    if os.path.lexists(path):
        raise CableError(f"{path} exists; remove it or choose another folder.")
    atomic_io.require_ours(folder, [PLUGIN_LIBRARY], lambda _: False)
    if sys.platform != "linux" or os.uname().machine != "x86_64":
        raise CableError(
            "the plugin is written as a shared library on Linux on x86-64 only; "
            "elsewhere use it from Python."
        )
    linker = _linker()
    callbacks = compiled_callbacks()
    functions = bitcode_of({**CALLBACKS, **callbacks})
    content = emit(
        _TARGET,
        _interface(list(callbacks)),
        functions,
        _RUNTIME,
        _PROVIDED,
        frozenset({DIGEST_NAME, DIGEST_TABLE, *CALLBACKS}),
        passes=1,
    )
    with atomic_io.replacing_folder(folder) as partial:
        compiled = partial / "plugin.o"
        compiled.write_bytes(content)
        done = subprocess.run(
            [
                *(*linker, "-shared", "-z", "noexecstack", "-z", "now", "-z", "defs"),
                *("-init", _CONSTRUCTOR, "-soname", PLUGIN_LIBRARY),
                *("-o", str(partial / PLUGIN_LIBRARY), str(compiled)),
                *(str(LIBRARY._name), *_system_libraries()),
            ],
            capture_output=True,
            text=True,
        )
        compiled.unlink()
        if done.returncode != 0:
            raise CableError(
                f"`{' '.join(linker)}` cannot link the plugin: {done.stderr.strip()}"
            )
    return path


def _linker() -> list[str]:
    """Return the command of a linker.

    Raises:
        CableError: There is none.
    """
    found = shutil.which("ld")
    if found is not None:
        return [found]
    if find_spec("ziglang") is not None:
        return [sys.executable, "-m", "ziglang", "ld.lld"]
    raise CableError(
        "the plugin cannot be linked without a linker; install `ld`, of the package "
        "`binutils` of this system, or `pip install 'cc_mujoco[native]'`."
    )


def _system_libraries() -> list[str]:
    """Return the files of C's library and of its library of mathematics.

    Raises:
        CableError: They are no glibc.
    """
    found = []
    for name, symbol in (("libm.so.6", "cos"), ("libc.so.6", "strlen")):
        try:
            function = getattr(ctypes.CDLL(name), symbol)
        except OSError:
            raise CableError(
                f"the plugin is written as a shared library where there is {name}, on "
                "a Linux with glibc."
            ) from None
        address = ctypes.cast(function, ctypes.c_void_p).value or 0
        found.append(str(file_of(address)))
    return found


def _text(name: str, content: str, kind: str = "internal constant") -> str:
    """Return the LLVM assembly of a constant text."""
    data = content.encode() + b"\0"
    written = "".join(f"\\{byte:02X}" for byte in data)
    return f'@{name} = {kind} [{len(data)} x i8] c"{written}"'


def _interface(callbacks: list[str]) -> str:
    """Return the LLVM assembly of the record of the plugin and its constructor."""
    keys = ", ".join(f"ptr @key_{i}" for i in range(len(KEYS)))
    fields = ", ".join(
        f"ptr @{name}" if name in callbacks else "ptr null" for name in CALLBACK_FIELDS
    )
    version = mujoco.mj_version()
    layout = ", ".join(["ptr, i32, ptr, i32, i32", *["ptr"] * len(CALLBACK_FIELDS)])
    return "\n".join(
        [
            _text("plugin_name", PLUGIN),
            _text(DIGEST_NAME, code_digest(), "constant"),
            _text(
                "other_version",
                f"{PLUGIN_LIBRARY} is for MuJoCo {mujoco.__version__}, not for this "
                "version; it registers no cables.",
            ),
            *(_text(f"key_{i}", key) for i, key in enumerate(KEYS)),
            f"@keys = internal constant [{len(KEYS)} x ptr] [{keys}]",
            f"@{DIGEST_TABLE} = global [{DIGEST_SLOTS} x i64] zeroinitializer",
            *(f"declare void @{name}()" for name in callbacks),
            f"@record = internal global {{ {layout} }} {{ ptr @plugin_name, "
            f"i32 {len(KEYS)}, ptr @keys, i32 {plugin_capabilities()}, "
            f"i32 {NEEDED_STAGE}, {fields} }}",
            "declare i32 @mj_version()",
            "declare i32 @mjp_registerPlugin(ptr)",
            "declare void @mju_warning(ptr, ...)",
            f"define void @{_CONSTRUCTOR}() {{",
            "  %version = call i32 @mj_version()",
            f"  %fits = icmp eq i32 %version, {version}",
            "  br i1 %fits, label %register, label %refuse",
            "register:",
            "  %slot = call i32 @mjp_registerPlugin(ptr @record)",
            "  ret void",
            "refuse:",
            "  call void (ptr, ...) @mju_warning(ptr @other_version)",
            "  ret void",
            "}",
        ]
    )
