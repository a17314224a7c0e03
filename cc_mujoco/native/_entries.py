"""Functions in C that Python calls, written for translated functions."""

from __future__ import annotations

from collections.abc import Sequence

from cc_mujoco.native._c99 import DIMENSIONS, CLibrary, Function, c_name
from cc_mujoco.native._kinds import (
    BOOL,
    INT,
    NOTHING,
    REAL,
    Array,
    Kind,
    Scalar,
    Structure,
    dtype_of,
    holds_array,
)  # fmt: skip

MOST_PARTS = 128
"""Most arrays, and most fields of tuples, of a call; see `python_calls.h`."""


def has_entry(function: Function) -> bool:
    """Return whether Python can call it in C: views of arrays are made by Python."""
    return not holds_array(function.signature.result)


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
    assert sum(map(_part_count, kinds.values())) <= MOST_PARTS, function.name
    lines: list[str] = []
    names = []
    for place, (name, kind) in enumerate(kinds.items()):
        lines += _take(library, function, f"a_{name}", name, f"args[{place}]", kind)
        names.append(f"a_{name}")
    result = function.signature.result
    call = f"{function.name}({', '.join(names)})"
    if result != NOTHING:
        call = f"const {library.type(result)} result = {call}"
    body = [
        "PyObject *made = NULL;",
        "if (!call.failed) {",
        "    void *thread = api.PyEval_SaveThread();",
        f"    {call};",
        "    api.PyEval_RestoreThread(thread);",
        *(f"    {line}" for line in _make("made", "result", result, 0)),
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
            f"CC_COLD static PyObject *py_{function.name}(",
            "    PyObject *self, PyObject *const *args, Py_ssize_t count)",
            "{",
            "    Call call;",
            "    call.view_count = call.item_count = 0;",
            "    call.failed = false;",
            "    (void)self;",
            *(["    (void)args;"] if not kinds else []),
            *(f"    {line}" for line in [*check, *lines, *body]),
            "}",
            "",
        ]
    )


def _part_count(kind: Kind) -> int:
    """Return how many arrays and fields are read of an argument, at most."""
    if isinstance(kind, Structure):
        return sum(1 + _part_count(each) for _, each in kind.fields)
    return int(isinstance(kind, Array))


def _take(
    library: CLibrary,
    function: Function,
    target: str,
    name: str,
    source: str,
    kind: Kind,
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
        dtype = dtype_of(kind.element)
        what = f"a contiguous array of {dtype} of {kind.dims} dimension"
        what += "s" if kind.dims > 1 else ""
        path = ".".join(name.split(".")[:2])
        is_written = not function.writes.isdisjoint({path, path.partition(".")[0]})
        what += " that can be written" if is_written else ""
        return [
            f"{c} {target} = {{0}};",
            "{",
            f"    int64_t shape[{kind.dims}] = {{0}};",
            "    void *data = NULL;",
            f'    take_array(&call, {source}, "{name}", "{what}", '
            f"'{dtype.kind}', {dtype.itemsize}, {kind.dims}, {int(is_written)}, "
            "&data, shape);",
            f"    {target}.p = data;",
            *(
                f"    {target}.{field} = shape[{i}];"
                for i, field in enumerate(DIMENSIONS[: kind.dims])
            ),
            "}",
        ]
    lines = [f"{c} {target};", f"memset(&{target}, 0, sizeof {target});"]
    for place, (field, each) in enumerate(kind.fields):
        item = f"{target}_{field}"
        lines.append(
            f'PyObject *o_{item} = take_item(&call, {source}, {place}, "{name}");'
        )
        inner = f"{name}.{field}", f"o_{item}"
        lines += _take(library, function, item, *inner, each)
        lines.append(f"{target}.{c_name(field)} = {item};")
    return lines


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
                        item, f"{source}.{c_name(field)}", each, depth + 1
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
    return [f"{target} = api.PyLong_FromLongLong({source});"]
