"""Entry points in C for Python, and how `python_calls.h` reads their arguments."""

from collections.abc import Iterator
from itertools import count
from pathlib import Path

from cc_mujoco.errors import CableError
from cc_mujoco.native._c99 import CLibrary, Function, c_name
from cc_mujoco.native._kinds import (
    BOOL,
    NOTHING,
    REAL,
    Array,
    Kind,
    Scalar,
    Structure,
    dtype_of,
    holds_array,
)

MOST_PARTS = 160
"""Most arrays, numbers and fields of tuples in a call, see `python_calls.h`."""


def program_text(library: CLibrary, functions: dict[str, Function], *heads: str) -> str:
    """Return a source of its own: headers, `functions` and their entries."""
    names = ("native.h", "python_calls.h", *heads)
    parts = [Path(__file__).with_name(name).read_text() for name in names]
    return "\n".join([*parts, library.text(), entries_text(library, functions)])


def entries_text(library: CLibrary, functions: dict[str, Function]) -> str:
    called = {
        name: function
        for name, function in functions.items()
        if not holds_array(function.signature.result)
    }
    rows = "".join(
        f'    {{"{name}", py_{function.name}, 0x80, NULL}},\n'
        for name, function in called.items()
    )
    end = f"""CC_EXPORT PyMethodDef cc_methods[] = {{
{rows}    {{NULL, NULL, 0, NULL}}
}};

CC_EXPORT void cc_use_python(void *const *found)
{{
    memcpy(&api, found, sizeof api);
}}
"""
    return "\n".join([*(_entry(library, one) for one in called.values()), end])


def _entry(library: CLibrary, function: Function) -> str:
    kinds, result = function.signature.arguments, function.signature.result
    cells = count()
    given = ", ".join(_argument(library, kind, cells) for kind in kinds.values())
    lines = ["    (void)a;"] if not kinds else []
    parts = sum(map(_part_count, kinds.values()))
    made = _result_format(result)
    if max(parts, next(cells), len(made)) > MOST_PARTS:
        raise CableError(
            f"{function.name} takes or returns {max(parts, len(made))} arrays, numbers "
            f"and tuples; at most {MOST_PARTS} pass between Python and C"
        )
    call = f"{function.name}({given})"
    if result == NOTHING:
        lines += ["    (void)r;", f"    {call};"]
    else:
        lines.append(f"    const {library.type(result)} result = {call};")
        places = enumerate(_leaves("result", result))
        lines += [f"    r[{i}].{field} = {leaf};" for i, (field, leaf) in places]
    format_ = "".join(
        _format(library, function, name, kind) for name, kind in kinds.items()
    )
    return "\n".join(
        [
            f"CC_COLD static void call_{function.name}(const Cell *a, Cell *r)",
            "{",
            *lines,
            "}",
            f'CC_ENTRY({function.name}, "{format_}", {len(kinds)}, "{made}")',
            "",
        ]
    )


def _part_count(kind: Kind) -> int:
    if isinstance(kind, Structure):
        return sum(1 + _part_count(each) for _, each in kind.fields)
    return int(isinstance(kind, Array))


def _letter(kind: Kind) -> str:
    return "d" if kind == REAL else "b" if kind == BOOL else "i"


def _format(library: CLibrary, function: Function, name: str, kind: Kind) -> str:
    if isinstance(kind, Scalar):
        return f"{_letter(kind)}{name} "
    if isinstance(kind, Structure):
        fields = (
            _format(library, function, f"{name}.{f}", each) for f, each in kind.fields
        )
        return f"({name} {''.join(fields)})"
    dtype, path = dtype_of(kind.element), ".".join(name.split(".")[:2])
    is_read = function.writes.isdisjoint({path, path.partition(".")[0]})
    dims = kind.dims + _is_dual(library, kind)
    return f"[{dtype.kind}{dtype.itemsize}{dims}{'r' if is_read else 'w'}{name} "


def _is_dual(library: CLibrary, kind: Array) -> bool:
    """Return whether the last axis of an array is that of value and derivative."""
    return library.is_dual and kind.element == REAL


def _argument(library: CLibrary, kind: Kind, cells: Iterator[int]) -> str:
    if isinstance(kind, Scalar):
        cell = f"a[{next(cells)}].{'d' if kind == REAL else 'i'}"
        if kind == BOOL:
            return f"{cell} != 0"
        if kind == REAL and library.is_dual:
            return f"dual({cell})"
        return cell if kind.c in ("double", "int64_t") else f"({kind.c}){cell}"
    if isinstance(kind, Array):
        parts = [f"a[{next(cells)}].p"]
        parts += [f"a[{next(cells)}].i" for _ in range(kind.dims)]
        if _is_dual(library, kind):
            next(cells)
    else:
        parts = [_argument(library, each, cells) for _, each in kind.fields]
    return f"({library.type(kind)}){{{', '.join(parts)}}}"


def _result_format(kind: Kind) -> str:
    if isinstance(kind, Structure):
        size = chr(ord("a") + len(kind.fields))
        return f"({size}" + "".join(_result_format(each) for _, each in kind.fields)
    return "" if kind == NOTHING else _letter(kind)


def _leaves(source: str, kind: Kind) -> Iterator[tuple[str, str]]:
    """Yield format letter and C expression of each number in a result, `d` or `i`."""
    if isinstance(kind, Structure):
        for name, each in kind.fields:
            yield from _leaves(f"{source}.{c_name(name)}", each)
    else:
        yield "d" if kind == REAL else "i", source
