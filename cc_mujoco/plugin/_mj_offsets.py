"""Memory layout of the fields of MuJoCo's C structures.

The layout follows from `mujoco.introspect`, MuJoCo's own machine-made description of
its headers, with the platform's alignment rules (through `ctypes`). `verify` compares
it with the addresses that the Python bindings report and refuses a MuJoCo where they
differ, so a wrong offset is an import error and never a stray write.
"""

import ctypes
import math
import operator
import textwrap
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any

import mujoco
import numpy as np
from mujoco.introspect.ast_nodes import (
    AnonymousStructDecl,
    ArrayType,
    PointerType,
    ValueType,
)
from mujoco.introspect.structs import STRUCTS

from cc_mujoco.native._kinds import INT, LoadedInt, Memory
from cc_mujoco.native._library import NativeLibraryError

_SCALARS: dict[str, Any] = {
    "char": ctypes.c_char,
    "float": ctypes.c_float,
    "int": ctypes.c_int,
    "mjtBool": ctypes.c_bool,
    "mjtByte": ctypes.c_uint8,
    "mjtNum": ctypes.c_double,
    "mjtSize": ctypes.c_int64,
    "size_t": ctypes.c_size_t,
    "uint64_t": ctypes.c_uint64,
    "uintptr_t": ctypes.c_size_t,
}
_structures: dict[str, type[ctypes.Structure]] = {}


def structure(name: str) -> type[ctypes.Structure]:
    """Return the `ctypes` structure of a MuJoCo struct, for `.field.offset`."""
    if name not in _structures:
        made: Any = type(name, (ctypes.Structure,), {})
        _structures[name] = made
        made._fields_ = _members(STRUCTS[name].fields)
    return _structures[name]


LOADED: dict[str, LoadedInt] = {}
"""Offsets and sizes that compiled code reads from its table `layout`, by path."""


def place(path: str) -> LoadedInt:
    """Return the offset of a field, e.g. `mjModel.opt.timestep`, or a size [bytes]."""
    is_field = "." in path
    found = LoadedInt(_find(path)[0] if is_field else ctypes.sizeof(structure(path)))
    found.c = f"layout.{member(path)}"
    LOADED[path] = found
    return found


def _find(path: str) -> tuple[int, Any]:
    name, *fields = path.split(".")
    found: Any = structure(name)
    total = 0
    for field in fields:
        total += getattr(found, field).offset
        found = dict(found._fields_)[field]
    return total, found


def member(path: str) -> str:
    return path.replace(".", "_")


def row() -> str:
    """Return the table row for the installed MuJoCo, as in `native_layouts.h`."""
    given = ", ".join(f".{member(path)}={LOADED[path]}" for path in sorted(LOADED))
    text = f"{{{mujoco.mj_version()}, {{{given}}}}},"
    return textwrap.fill(text, 90, subsequent_indent="  ")


def _members(fields: Any) -> list[tuple[str, Any]]:
    return [(each.name, _type(each.type, each.array_extent)) for each in fields]


def _type(node: Any, extent: tuple[Any, ...] | None = None) -> Any:
    """Return the `ctypes` type of a node; `extent` are sizes of the array behind it."""
    if isinstance(node, PointerType):
        if not isinstance(node.inner_type, ValueType) or node.inner_type.name == "void":
            return ctypes.c_void_p
        inner, *columns = _type(node.inner_type), *(extent or ())[1:]
        for each in columns:
            count = getattr(mujoco, str(each), each)
            inner = inner * count if isinstance(count, int) else inner
        return ctypes.POINTER(inner)
    if isinstance(node, ArrayType):
        return _type(node.inner_type) * math.prod(node.extents)
    if isinstance(node, AnonymousStructDecl):
        fields = {"_fields_": _members(node.fields)}
        return type("anonymous", (ctypes.Structure,), fields)
    return _SCALARS.get(node.name) or structure(node.name)


def _memory(name: str) -> Memory:
    return Memory(INT.c, name, structure(name), place)


MjModel = Annotated[Any, _memory("mjModel")]
MjData = Annotated[Any, _memory("mjData")]
MjLogMessage = Annotated[Any, _memory("mjLogMessage")]
"""Addresses of structures in compiled code, with their fields as attributes."""


def verify(paths: Iterable[str], enumerators: Mapping[str, int]) -> None:
    """Raise a `NativeLibraryError` unless the layout agrees with the Python bindings.

    Compared are the offsets and sizes of `paths` and the values of `enumerators`.
    `mjData.plugin_state` is empty in the test model and `plugin_data` has no address in
    Python, so their neighbours are compared, and `plugin_data` must hold an address.
    """
    probe = Path(__file__).with_name("probe.xml").read_text()
    model = mujoco.MjModel.from_xml_string(probe)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    model.opt.disableflags, model.opt.enableflags = 1 << 11, 1 << 3
    model.opt.disableactuator, data.time = 1 << 5, 0.75
    addresses = {"mjModel": model._address, "mjData": data._address}
    d = structure("mjData").from_address(data._address)
    addresses["mjContact"] = ctypes.addressof(d.contact.contents)
    objects = {"mjModel": model, "mjData": data, "mjContact": data.contact[0]}
    wrong = [
        name
        for name, value in enumerators.items()
        if int(operator.attrgetter(name)(mujoco)) != value
    ]
    for path in paths:
        name, _, fields = path.partition(".")
        if not fields or name not in objects:
            continue
        try:
            shown = operator.attrgetter(fields)(objects[name])
        except AttributeError:
            continue  # such as `plugin_data`
        at, kind = _find(path)
        if not _is_at(addresses[name] + at, kind, shown):
            wrong.append(path)
    if not d.plugin_data[0]:
        wrong.append("mjData.plugin_data")
    if wrong:
        raise NativeLibraryError(
            f"cc_mujoco cannot run on mujoco {mujoco.__version__}: its structures are "
            f"laid out differently than described ({', '.join(wrong)}); "
            "install a mujoco of a release that cc_mujoco supports"
        )


def _is_at(address: int, kind: Any, shown: Any) -> bool:
    held = kind.from_address(address)
    if isinstance(shown, np.ndarray):
        is_pointer = kind is ctypes.c_void_p or hasattr(kind, "contents")
        first = ctypes.c_size_t.from_address(address).value if is_pointer else address
        return shown.size == 0 or shown.ctypes.data == first
    if isinstance(shown, bytes):
        return ctypes.string_at(held, len(shown)) == shown
    return not isinstance(shown, int | float) or held.value == shown
