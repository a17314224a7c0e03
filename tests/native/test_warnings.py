"""The library's source in C compiles without a warning, on a MuJoCo that is new."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from cc_mujoco.native import _library
from cc_mujoco.native._library import (
    FLAGS,
    NativeLibraryError,
    build_library,
    library,
    write_source,
)

WARNINGS = (
    "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Wvla", "-Werror",
)  # fmt: skip
COMPILERS = [name for name in ("gcc", "clang") if shutil.which(name)]


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the source of the library."""
    path = tmp_path_factory.mktemp("source") / "library.c"
    write_source(path)
    return path


def compiled(source: Path, *command: str) -> str:
    """Return what a compiler says of the source."""
    done = subprocess.run(
        [*command, *FLAGS, *WARNINGS, str(source)], capture_output=True, text=True
    )
    return done.stderr if done.returncode else ""


def test_an_old_mujoco_is_named_before_anything_is_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_library, "version", lambda _: "3.16.2")
    with pytest.raises(NativeLibraryError, match=r"mujoco 3\.17 or newer to compile"):
        build_library(tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.study
def test_source_has_nothing_to_warn_of(source: Path, compiler: str) -> None:
    assert compiled(source, compiler, "-fsyntax-only") == ""


@pytest.mark.study
@pytest.mark.parametrize("compiler", COMPILERS)
def test_optimised_source_has_nothing_to_warn_of(source: Path, compiler: str) -> None:
    made = source.with_suffix(".o")
    assert compiled(source, compiler, "-c", "-o", str(made)) == ""


@pytest.mark.skipif(shutil.which("nm") is None, reason="there is no nm")
def test_library_takes_no_memory() -> None:
    listed = ["nm", "--dynamic", "--undefined-only", library()._name]
    text = subprocess.run(listed, capture_output=True, text=True, check=True).stdout
    needed = {line.split()[-1].partition("@")[0] for line in text.splitlines()}
    assert "exp" in needed
    assert not {"malloc", "calloc", "realloc", "free"} & needed
