"""Functions outside the subset are refused with their place."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
import pytest
from typing_extensions import TypeAliasType

from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray, FloatMatrix
from cc_mujoco.native._c99 import CLibrary
from cc_mujoco.native._kinds import INT, REAL, Array, kind_of
from cc_mujoco.native._library import compiler, write_source


def own_array() -> FloatArray:
    found = np.zeros(3)
    return found


def of_any_size(n: int) -> float:
    found = np.zeros(n)
    return float(found[0])


def copied(values: FloatArray) -> float:
    found = values.copy()
    return float(found[0])


def column(table: FloatMatrix) -> FloatArray:
    return table[:, 1]


def stepped(values: FloatArray) -> FloatArray:
    return values[::2]


def whole(values: FloatArray) -> FloatArray:
    return 2.0 * values


def matrix_of_no_name(values: FloatArray) -> float:
    return float(values[0, 1])


def unknown(values: Any) -> float:
    return float(values[0])


def by_name(x: float) -> float:
    return helper(x=x)


def helper(x: float) -> float:
    return 2.0 * x


def changes(x: float) -> float:
    total: Any = np.zeros(2)
    total = x
    return float(total)


def cube(x: float) -> float:
    return x**3


def divided(x: float) -> float:
    return x // 0.1


def itself(n: int) -> int:
    return itself(n - 1) if n > 0 else 0


def last(values: FloatArray) -> float:
    return float(values[-1])


def over_values(values: FloatArray) -> float:
    total = 0.0
    for value in values:
        total += value
    return total


NUMBERS = 1.0, 2.0, 3.0


def leaves_a_table(x: float) -> float:
    total = 0.0
    for _ in range(3):
        for number in NUMBERS:
            if number > x:
                break
            total += number
    return total


def text(x: float) -> float:
    return x if str(x) else 0.0


def exits(x: float) -> float:
    with open("file"):
        return x


REFUSED: dict[Callable[..., Any], str] = {
    own_array: "an array of its own that is returned",
    of_any_size: "size is no constant; have the caller give it",
    copied: "a call",
    column: "a view of a column",
    stepped: "a slice with a step",
    whole: "arithmetic of arrays",
    matrix_of_no_name: "say FloatMatrix",
    unknown: "the type typing.Any",
    by_name: "an argument given by name",
    changes: "total changes its type",
    cube: "a power of an integer; multiply",
    divided: "use math.floor",
    itself: "a call that ends in the function itself",
    last: "an index from the end; subtract from the size",
    over_values: "a loop that is not over a range",
    leaves_a_table: "a loop that is not over a range",
    text: "a call of what is not compiled",
    exits: "outside the subset",
}


@pytest.mark.parametrize("function", REFUSED)
def test_refusal_names_file_line_and_reason(function: Any) -> None:
    library = CLibrary({}, Path(__file__).parents[2])
    with pytest.raises(CableError) as told:
        library.require(function)
        library.translate()
    first = function.__code__.co_firstlineno
    found = re.match(r"(.*):(\d+): (.*)", str(told.value))
    assert found is not None
    assert found[1] == __file__
    assert first <= int(found[2]) <= first + 3
    assert REFUSED[function] in found[3]
    assert f"in {function.__name__} is outside the subset" in found[3]


def arithmetic(a: int, b: int, x: float, y: float, out: FloatArray) -> None:
    out[0] = a // b
    out[1] = a % b
    out[2] = math.floor(x / y)
    out[3] = x % y
    out[4] = x**2
    out[5] = abs(y) ** x
    out[6] = min(x, y)
    out[7] = max(x, y, 0.0)
    out[8] = abs(a)
    out[9] = np.sign(x)
    out[10] = round(x)
    out[11] = a << 2 | b & 3 ^ 5
    out[12] = 1.0 if a < b < 3 or not x > y else -1.0


def chained(x: float) -> float:
    a = b = 1.5
    if x > 0.0:
        b = x
    return a + b


def test_a_constant_is_kept_where_one_of_its_names_changes() -> None:
    library = CLibrary({}, Path(__file__).parents[2])
    library.require(chained)
    assert re.search(r"\bb = \w+;\n    if", library.text())


def test_arithmetic_is_that_of_python(tmp_path: Path) -> None:
    library = CLibrary({}, Path(__file__).parents[2])
    library.export("arithmetic", arithmetic)
    main = """#include <stdio.h>
int main(void) {
    double a, b, x, y, out[13];
    while (scanf("%lf %lf %lf %lf", &a, &b, &x, &y) == 4) {
        arithmetic((int64_t)a, (int64_t)b, x, y, (Reals){out, 13});
        for (int i = 0; i < 13; i++) printf("%.17g ", out[i]);
        printf("\\n");
    }
    return 0;
}
"""
    header = Path(sys.modules[CLibrary.__module__].__file__ or "").with_name("native.h")
    source = tmp_path / "main.c"
    source.write_text(header.read_text() + library.text() + main)
    program = tmp_path / "main"
    flags = ("-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror")
    command = [*compiler(), *flags, "-Wconversion", "-Wshadow", "-o", str(program)]
    subprocess.run([*command, str(source), "-lm"], check=True)
    rng = np.random.default_rng(0)
    rows = [
        (int(a), int(b) or 1, float(x), float(y))
        for a, b, x, y in zip(
            rng.integers(-9, 10, 200),
            rng.integers(-4, 5, 200),
            rng.normal(size=200) * 3.0,
            rng.normal(size=200),
            strict=True,
        )
    ]
    given = "\n".join(f"{a} {b} {x!r} {y!r}" for a, b, x, y in rows)
    said = subprocess.run([program], input=given, capture_output=True, text=True)
    for row, line in zip(rows, said.stdout.splitlines(), strict=True):
        right = np.empty(13)
        arithmetic(*row, right)
        found = np.array(line.split(), dtype=float)
        assert np.array_equal(found, right), (row, found, right)


def test_an_array_type_may_be_an_alias_as_from_numpy_2_5_on() -> None:
    element = TypeVar("element", bound=np.generic)
    value = np.ndarray[tuple[Any, ...], np.dtype[element]]
    alias: Any = TypeAliasType("NDArray", value, type_params=(element,))
    for number, kind in ((np.float64, REAL), (np.int64, INT)):
        assert kind_of(alias[number]) == kind_of(value[number])
        assert kind_of(Annotated[alias[number], 2]) == Array(kind, 2)


def test_the_source_is_that_of_this_package_whatever_the_current_folder_holds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("cc_mujoco", "numpy"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise SystemExit(1)")
    monkeypatch.chdir(tmp_path)
    write_source(tmp_path / "source.c")
    assert (tmp_path / "source.c").stat().st_size > 1e5
