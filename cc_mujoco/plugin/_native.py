"""The native library in C99, written from the functions of the whole package."""

import ctypes
import operator
import re
from collections.abc import Iterable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import mujoco
from mujoco.introspect.enums import ENUMS

from cc_mujoco.cable._cable import KEYS
from cc_mujoco.native import _library as native_library
from cc_mujoco.native._c99 import UNARY, CLibrary, Function, KnownCall
from cc_mujoco.native._entries import entries_text
from cc_mujoco.native._functions import FUNCTIONS, NativeFunction
from cc_mujoco.native._kinds import BOOL, BYTE, INT, INT32, NOTHING, REAL, Array
from cc_mujoco.plugin import _ffi as ffi
from cc_mujoco.plugin import _mj_offsets as mj_offsets
from cc_mujoco.plugin import _registration as registration
from cc_mujoco.plugin._config import value_of
from cc_mujoco.plugin._engine import PLUGIN


def write(path: str) -> None:
    declares = re.compile(
        rb"^\s*@(compiled|internal|callback)\b|= (compiled|internal)\(", re.MULTILINE
    )
    compiler = native_library.PACKAGE / "native"
    for file in sorted(native_library.PACKAGE.rglob("*.py")):
        if file.parent != compiler and declares.search(file.read_bytes()):
            place = file.relative_to(native_library.PACKAGE.parent)
            import_module(".".join(place.with_suffix("").parts))
    Path(path).write_text(source(FUNCTIONS, with_python=True))


def source(functions: Iterable[NativeFunction], with_python: bool) -> str:
    """Return the C99 source of the plugin and `functions`, for every known MuJoCo.

    `with_python` adds the entries by which Python calls compiled functions.
    """
    made = CLibrary(_functions(), native_library.PACKAGE.parent)
    entries: dict[str, Function] = {}
    for function in functions:
        if function.symbol:
            made.export(function.symbol, function.py_func)
        elif with_python and function.is_entry:
            entries[function.key] = made.require(function.py_func)
    text = made.inner_text()
    exports = made.exports.items()
    plugin = [each for symbol, each in exports if "episode" not in symbol]
    plugin.append(_read("native_plugin.c"))
    episodes = [each for symbol, each in exports if "episode" in symbol]
    if with_python:
        halves = [
            *_in_unit(1, *plugin),
            *_in_unit(2, *episodes, entries_text(made, entries)),
        ]
    else:
        halves = [*plugin, *episodes, *native_library.identity()]
    return "\n".join(
        [
            "#define _GNU_SOURCE",
            f"#define CC_LOADS_ITSELF {int(not with_python)}",
            *(f"#define {name} {value}" for name, value in _constants().items()),
            _read("native.h"),
            *([_read("python_calls.h")] if with_python else []),
            "typedef struct {",
            *(f"    int64_t {mj_offsets.member(p)};" for p in mj_offsets.LOADED),
            "} Layout;",
            _read("native_plugin.h").replace('#include "native.h"\n', ""),
            _known_layouts(),
            text,
            *halves,
        ]
    )


def _in_unit(number: int, *parts: str) -> list[str]:
    return [f"#if CC_UNIT != {3 - number}", *parts, "#endif"]


def _read(name: str) -> str:
    folder = "plugin" if name.startswith("native_") else "native"
    return (native_library.PACKAGE / folder / name).read_text()


def _constants() -> dict[str, Any]:
    numbers = sorted(map(int, re.findall(r"^ *\{(\d+),", _known_layouts(), re.M)))
    known = ", ".join(f"{n // 1000000}.{n // 1000 % 1000}.{n % 1000}" for n in numbers)
    other_version = (
        f"{registration.PLUGIN_LIBRARY} is for MuJoCo {known}, not for this version; "
        "write it anew with `cc-mujoco plugin` beside it. It registers no cables."
    )
    bits = ENUMS["mjtPluginCapabilityBit"].values
    return {
        "CC_DIGEST_SLOTS": ffi.DIGEST_SLOTS,
        "CC_ENGINE_NAMES": ", ".join(map(_quoted, registration.ENGINE_NAMES)),
        "CC_KEYS": ", ".join(map(_quoted, KEYS)),
        "CC_OTHER_VERSION": _quoted(other_version),
        "CC_ENUMERATORS": _quoted(" ".join(_enumerators())),
        "CC_LAYOUT_PATHS": _quoted(" ".join(mj_offsets.LOADED)),
        "CC_PLUGIN": _quoted(PLUGIN),
        "CC_CAPABILITIES": bits["mjPLUGIN_ACTUATOR"] | bits["mjPLUGIN_PASSIVE"],
        "CC_STAGE": registration.NEEDED_STAGE,
    }


def _enumerators() -> Iterator[str]:
    """Yield `name=value` of each MuJoCo enumerator that the plugin's modules use."""
    names: set[str] = set()
    for file in Path(__file__).parent.glob("*.py"):
        names.update(re.findall(r"\b(mjt\w+\.mj\w+)", file.read_text()))
    for name in sorted(names):
        yield f"{name}={int(operator.attrgetter(name)(mujoco))}"


def _known_layouts() -> str:
    known = _read("native_layouts.h").rstrip()
    row = mj_offsets.row()
    head, _, tail = known.rpartition("};")
    return known if row in known else f"{head}{row}\n}};{tail}"


def _quoted(text: str) -> str:
    return f'"{text}"'


def _functions() -> dict[Any, KnownCall]:
    found: dict[Any, KnownCall] = {each: _engine_call(each) for each in ffi.ENGINE}
    found[value_of] = "decimal_value", (Array(BYTE),), REAL
    found[ffi._digest_table] = "(int64_t)(intptr_t)cc_mujoco_said", (), INT
    for name, result in (("copy", NOTHING), ("clear", NOTHING), ("same", BOOL)):
        found[getattr(ffi, name)] = f"{name}_bytes", (INT, INT, INT), result
    return found


def _engine_call(function: ffi.Engine) -> KnownCall:
    result = {None: NOTHING, ctypes.c_int: INT32}.get(function.result, INT)
    fields = {
        ctypes.c_double: "{}",
        ctypes.c_int: f"(int){{:{UNARY}}}",
        ctypes.c_size_t: f"(size_t){{:{UNARY}}}",
    }
    address = f"(void *)(intptr_t){{:{UNARY}}}"
    given = ", ".join(fields.get(kind, address) for kind in function.arguments)
    text = f"engine.{function.name}({given})"
    kinds = (REAL if k is ctypes.c_double else INT for k in function.arguments)
    if result == INT:
        text = f"(int64_t)(intptr_t){text}"
    return text, tuple(kinds), result
