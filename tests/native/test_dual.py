"""Dual numbers in C: values of the plain functions, and their derivatives."""

from __future__ import annotations

import math
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cc_mujoco.cable import _sensitivity as sensitivity
from cc_mujoco.native import FloatArray
from cc_mujoco.native import _library as native_library
from cc_mujoco.native._dual import build, slope, with_slope
from native.test_warnings import COMPILERS, compiled

TABLE = (0.5, 2.0)


def several(x: FloatArray, n: int, out: FloatArray) -> None:
    """Write functions of `x` > 0, most of them two at a time."""
    a, b = x[0], x[1]
    out[0] = a + 2 * b - a * b / 3.0
    out[1] = math.exp(-a) + math.expm1(b)
    out[2] = math.log(a) + math.log1p(b)
    out[3] = math.sqrt(a) * math.sin(b) + math.cos(a)
    out[4] = a**b + a**2
    out[5] = min(a, b) + 3.0 * max(a, 0.25, b)
    out[6] = abs(-a) + np.sign(a) - (-b)
    out[7] = 0.0
    for k in range(n):
        out[7] += TABLE[k] * a + k * b
    out[8] = a if a < b else b
    held = np.zeros(2)
    held[1] = a
    held[:] = held[1] * b
    out[9] = held[0] + held[1] if b else 0.0
    out[10] = int(a) + float(n)
    out[11] = with_slope(a, slope(b) * 2.0)
    out[12] = b - 1.0 if a > 0.0 and not b == a else a


def abs_and_limits(x: FloatArray, n: int, out: FloatArray) -> None:
    out[0], out[1], out[2] = abs(x[0]), max(x[0], 0.0), min(x[0], 0.0)
    out[3] = math.sqrt(x[1])


@pytest.fixture(scope="module")
def dual(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Callable[..., None]]:
    made = build(tmp_path_factory.mktemp("dual"), (several, abs_and_limits))
    return native_library.methods(native_library.load(made))


@pytest.mark.parametrize(("a", "b"), [(0.7, 1.9), (1.9, 0.7), (3.2, 0.01)])
def test_values_and_derivatives(
    dual: dict[str, Callable[..., None]], a: float, b: float
) -> None:
    for way in ((1.0, 0.0), (0.0, 1.0), (0.3, -2.0)):
        out, plain, ends = np.zeros((13, 2)), np.zeros(13), np.zeros((2, 13))
        dual["several"](np.stack([(a, b), way], -1), 2, out)
        several(np.array([a, b]), 2, plain)
        assert np.array_equal(out[:, 0], plain)
        for end, step in zip(ends, (1e-6, -1e-6), strict=True):
            several(np.array([a, b]) + step * np.array(way), 2, end)
        right = (ends[0] - ends[1]) / 2e-6
        right[11] = 2.0 * way[1]
        np.testing.assert_allclose(out[:, 1], right, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("way", [1.0, -2.0])
def test_kinks_take_the_side_of_growing_parameters(
    dual: dict[str, Callable[..., None]], way: float
) -> None:
    out = np.zeros((4, 2))
    dual["abs_and_limits"](np.array([[0.0, way], [0.0, 0.0]]), 0, out)
    right = [abs(way), max(way, 0.0), min(way, 0.0), 0.0]
    assert out[:, 1].tolist() == right


@pytest.mark.study
@pytest.mark.parametrize("compiler", COMPILERS)
def test_dual_source_has_nothing_to_warn_of(tmp_path: Path, compiler: str) -> None:
    build(tmp_path, (sensitivity._drive,))
    source = tmp_path / "cc_mujoco_dual.c"
    assert compiled(source, compiler, "-fsyntax-only") == ""


@pytest.mark.skipif(shutil.which("nm") is None, reason="there is no nm")
def test_plain_library_has_no_dual_code() -> None:
    """Who asks for no derivatives compiles none."""
    listed = ["nm", "--dynamic", native_library.library()._name]
    done = subprocess.run(listed, capture_output=True, text=True, check=True)
    assert "dual" not in done.stdout
