"""Functions in C that Python calls, written for translated functions."""

from __future__ import annotations

from collections.abc import Sequence

from cc_mujoco.native._c99 import CLibrary, Function
from cc_mujoco.native._kinds import (
    BOOL,
    INT,
    NOTHING,
    REAL,
    Array,
    Kind,
    Scalar,
    Structure,
    short_name,
)  # fmt: skip

_CLASSES = {"double": ("d", 8, "float64"), "int64_t": ("i", 8, "int64"),
            "uint8_t": ("u", 1, "uint8"), "int8_t": ("i", 1, "int8"),
            "bool": ("?", 1, "bool"), "uint64_t": ("u", 8, "uint64"),
            "int32_t": ("i", 4, "int32")}  # fmt: skip


def has_entry(function: Function) -> bool:
    """Return whether Python can call it in C: views of arrays are made by Python."""
    return not _holds_array(function.signature.result)


def _holds_array(kind: Kind) -> bool:
    if isinstance(kind, Structure):
        return any(_holds_array(each) for _, each in kind.fields)
    return isinstance(kind, Array)


def entries_text(library: CLibrary, functions: Sequence[tuple[str, Function]]) -> str:
    """Return the functions in C that Python calls, and their table.

    Args:
        library: to which the functions belong.
        functions: names that Python calls them by, and the functions.
    """
    texts = [_entry(library, function) for _, function in functions]
    rows = "".join(
        f'    {{"{name}", py_{function.name}, 0x80, NULL}},\n'
        for name, function in functions
    )
    table = (
        f"CC_EXPORT PyMethodDef cc_methods[] = {{\n{rows}"
        "    {NULL, NULL, 0, NULL}\n};\n"
    )
    load = (
        "CC_EXPORT void cc_use_python(void *const *found)\n{\n"
        "    memcpy(&api, found, sizeof api);\n}\n"
    )
    return "\n".join([*texts, table, load])


def _entry(library: CLibrary, function: Function) -> str:
    kinds = function.signature.arguments
    lines: list[str] = []
    names = []
    for place, (name, kind) in enumerate(kinds.items()):
        lines += _take(library, f"a_{name}", name, f"args[{place}]", kind)
        names.append(f"a_{name}")
    result = function.signature.result
    call = f"{function.name}({', '.join(names)})"
    if result != NOTHING:
        call = f"const {library.type(result)} result = {call}"
    made = "result"
    body = [
        "PyObject *made = NULL;",
        f"if (!call.failed && has_count(&call, count, {len(kinds)})) {{"
        if not kinds
        else "if (!call.failed) {",
        "    void *thread = api.PyEval_SaveThread();",
        f"    {call};",
        "    api.PyEval_RestoreThread(thread);",
        *(f"    {line}" for line in _make("made", made, result, 0)),
        "}",
        "end_call(&call);",
        "return made;",
    ]
    check = [
        f"if (!has_count(&call, count, {len(kinds)})) {{",
        "    return NULL;",
        "}",
    ]
    return "\n".join(
        [
            f"static PyObject *py_{function.name}(",
            "    PyObject *self, PyObject *const *args, Py_ssize_t count)",
            "{",
            "    Call call;",
            "    call.view_count = call.item_count = 0;",
            "    call.failed = false;",
            "    (void)self;",
            *(["    (void)args;"] if not kinds else []),
            *(f"    {line}" for line in [*(check if kinds else []), *lines, *body]),
            "}",
            "",
        ]
    )


def _take(
    library: CLibrary, target: str, name: str, source: str, kind: Kind
) -> list[str]:
    """Return the lines that read an argument into a variable."""
    if isinstance(kind, Scalar):
        how = {REAL: "take_real", BOOL: "take_bool"}.get(kind, "take_int")
        value = f'{how}(&call, {source}, "{name}")'
        if kind not in (REAL, BOOL, INT):
            value = f"({kind.c}){value}"
        return [f"const {kind.c} {target} = call.failed ? 0 : {value};"]
    c = library.type(kind)
    if isinstance(kind, Array):
        letter, size, dtype = _CLASSES[kind.element.c]
        what = f"a contiguous array of {dtype} of {kind.dims} dimension" + "s" * (
            kind.dims > 1
        )
        fields = ["n", "columns", "layers"][: kind.dims]
        return [
            f"{c} {target} = {{0}};",
            "{",
            f"    int64_t shape[{kind.dims}] = {{0}};",
            "    void *data = NULL;",
            f'    take_array(&call, {source}, "{name}", "{what}", '
            f"'{letter}', {size}, {kind.dims}, &data, shape);",
            f"    {target}.p = data;",
            *(f"    {target}.{field} = shape[{i}];" for i, field in enumerate(fields)),
            "}",
        ]
    lines = [f"{c} {target};", f"memset(&{target}, 0, sizeof {target});"]
    for place, (field, each) in enumerate(kind.fields):
        item = f"{target}_{field}"
        lines.append(
            f'PyObject *o_{item} = take_item(&call, {source}, {place}, "{name}");'
        )
        lines += _take(library, item, f"{name}.{field}", f"o_{item}", each)
        lines.append(f"{target}.{_field(field)} = {item};")
    return lines


def _field(name: str) -> str:
    from cc_mujoco.native._c99 import _name

    return _name(name)


def _make(target: str, source: str, kind: Kind, depth: int) -> list[str]:
    """Return the lines that make a Python object of a result."""
    if kind == NOTHING:
        return ["api.Py_IncRef(api.none);", f"{target} = api.none;"]
    if isinstance(kind, Structure):
        item = f"item{depth}"
        lines = [f"{target} = api.PyTuple_New({len(kind.fields)});"]
        for place, (field, each) in enumerate(kind.fields):
            lines += [
                "{",
                f"    PyObject *{item} = NULL;",
                *(
                    f"    {line}"
                    for line in _make(
                        item, f"{source}.{_field(field)}", each, depth + 1
                    )
                ),
                f"    (void)api.PyTuple_SetItem({target}, {place}, {item});",
                "}",
            ]
        return lines
    if kind == REAL:
        return [f"{target} = api.PyFloat_FromDouble({source});"]
    if kind == BOOL:
        return [f"{target} = api.PyBool_FromLong({source});"]
    assert short_name(kind)
    return [f"{target} = api.PyLong_FromLongLong({source});"]
