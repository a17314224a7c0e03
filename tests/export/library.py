"""Exported controllers, called from Python through a shared library."""

from __future__ import annotations

import ctypes
import functools
import shutil
import subprocess
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

from cc_mujoco.export import ExportPlan

Array = NDArray[np.float64]

COMPILER = shutil.which("gcc") or shutil.which("clang")
GUARD = 64
STRICT = (
    "-std=c99",
    "-ffp-contract=off",
    "-Wall",
    "-Wextra",
    "-Werror",
    "-pedantic",
)

STRICTER = (*STRICT, "-Wconversion", "-Wshadow")

_GIVEN = """#include "cc_controller.h"
void test_given(cc_controller *controller, const double *torques);
void test_given(cc_controller *controller, const double *torques)
{
    cc_controller_given(controller, torques);
}
"""
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="there is no C compiler")


@functools.cache
def device(scene: str) -> Any:
    """Return the environment of a device."""
    return gymnasium.make(
        "cc_mujoco/Device-v1", device=scene, disable_env_checker=True, duration=3.0
    ).unwrapped


def objects(folder: Path) -> list[Path]:
    """Return the object files of a controller and of its parameters, compiled once."""
    assert COMPILER is not None
    made = [folder / "built" / f"cc_{part}.o" for part in ("controller", "parameters")]
    made[0].parent.mkdir(exist_ok=True)
    for path in made:
        if not path.exists():
            source = folder / f"{path.stem}.c"
            # A planner takes seconds at -O2; one of them stands for all.
            whole = folder.name.endswith(("-pi_tuned", "-predictive"))
            level = "-O2" if whole else "-O1"
            run(COMPILER, *STRICTER, level, "-fPIC", "-c", source, "-o", path)
    return made


class Library:
    """Exported controller, called through a shared library."""

    def __init__(self, folder: Path, plan: ExportPlan) -> None:
        assert COMPILER is not None
        parts = objects(folder)
        shared = parts[0].with_name("shared.so")
        if not shared.exists():
            built = [COMPILER, *STRICT, "-I", folder, "-shared", "-fPIC", *parts]
            run(*built, "-o", shared, "-x", "c", "-", "-lm", input=_GIVEN)
        self.library = ctypes.CDLL(str(shared))
        self.library.cc_controller_size.restype = ctypes.c_size_t
        count, self.axes = len(plan.fields), len(plan.axes)
        self.parameters = np.array(
            (ctypes.c_double * count).in_dll(self.library, "cc_controller_parameters")
        )
        # Nothing may be read before it is written, and nothing written beyond.
        self.room = np.full(plan.memory_size + 2 * GUARD, np.nan)
        self.memory = self.room[GUARD:-GUARD]

    def take(self, parameters: Array, how: str = "init") -> int:
        call = getattr(self.library, f"cc_controller_{how}")
        return int(call(self._at(self.memory), self._at(parameters)))

    def reset(self) -> None:
        self.library.cc_controller_reset(self._at(self.memory))

    def step(self, readings: Array) -> Array:
        given, found = np.ascontiguousarray(readings), np.full(self.axes, np.inf)
        call = self.library.cc_controller_step
        self.wrong = call(self._at(self.memory), self._at(given), self._at(found))
        return found

    def given(self, torques: Array) -> None:
        """Tell what the motors got."""
        given = np.ascontiguousarray(torques, dtype=float)
        self.library.test_given(self._at(self.memory), self._at(given))

    def torques(self, readings: Array) -> Array:
        return np.array([self.step(row) for row in readings])

    def motor_torques(self, readings: Array) -> Array:
        """Return the torques of the only motor."""
        return self.torques(readings)[:, 0]

    def _at(self, numbers: Array) -> Any:
        return numbers.ctypes.data_as(ctypes.c_void_p)


def run(*words: Any, **how: Any) -> str:
    done = subprocess.run(
        [str(word) for word in words], capture_output=True, text=True, **how
    )
    assert done.returncode == 0, done.stderr
    return done.stdout
