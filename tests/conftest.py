"""Settings that all tests share."""

from __future__ import annotations

import gc
import os
import shlex
import shutil
from collections.abc import Generator
from pathlib import Path

import pytest
from hypothesis import settings

from cc_mujoco.native._library import compiler, digest, library
from shared_folder import ABSENT, SHARED

# The same examples in every run, so more of them find nothing in the next one; and no
# deadline: the first call of a compiled function includes its compilation.
settings.register_profile(
    "repeatable", derandomize=True, deadline=None, max_examples=25
)
settings.load_profile("repeatable")

ROOT = Path(__file__).parents[1]


def pytest_configure(config: pytest.Config) -> None:
    """Compile the native library once, before workers start that would each do so."""
    if not hasattr(config, "workerinput"):
        library()


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Disable garbage collection during collection, because imported modules stay."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip tests that need the folder beside the checkout."""
    if not SHARED.is_dir():
        for item in items:
            if item.get_closest_marker("shared"):
                item.add_marker(pytest.mark.skip(reason=ABSENT))


@pytest.fixture(scope="session")
def quick_compiler(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return a compiler for `CC`, with an argument, that takes no time to optimise."""
    if os.name == "nt":
        return ""
    script = tmp_path_factory.mktemp("compiler") / "quick.sh"
    script.write_text(f'exec {shlex.join(compiler())} "$@" -O0\n')
    return shlex.join([shutil.which("sh") or "sh", str(script)])


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave figures and recordings empty, most of the work of a short command."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    from cc_mujoco.viz import _episode_files, _rerun_file

    monkeypatch.setattr(FigureCanvasAgg, "draw", FigureCanvasAgg.get_renderer)
    for module, name in (
        (_episode_files, "write_summary"),
        (_rerun_file, "write_recording"),
    ):
        monkeypatch.setattr(module, name, lambda path, *_: path.touch())


@pytest.fixture
def unmeasured(monkeypatch: pytest.MonkeyPatch) -> None:
    """Export controllers without compiling them for their stack and work."""
    monkeypatch.setattr("cc_mujoco.export._measures.shutil.which", lambda _: None)


@pytest.fixture(scope="session")
def plugin_library(pytestconfig: pytest.Config, quick_compiler: str) -> Path:
    """Write the plugin as a shared library once per version.

    It takes seconds, so it is kept for other workers and later runs.
    """
    from cc_mujoco.export import write_plugin
    from cc_mujoco.plugin._registration import PLUGIN_LIBRARY

    folder = pytestconfig.cache.mkdir("plugin")
    kept = folder / PLUGIN_LIBRARY
    if not kept.exists() or digest().encode() not in kept.read_bytes():
        partial = folder / f"of {os.getpid()}"
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("CC", quick_compiler)
            write_plugin(partial).replace(kept)
        partial.rmdir()
    return kept


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Count the tests of the folder beside the checkout separately."""
    stats = terminalreporter.stats
    of_shared = {
        kind: sum(
            # What is skipped as a whole file has no keywords.
            "shared" in getattr(report, "keywords", ())
            for report in stats.get(kind, ())
        )
        for kind in ("passed", "failed", "skipped")
    }
    if not any(of_shared.values()):
        return
    ran, skipped = of_shared["passed"] + of_shared["failed"], of_shared["skipped"]
    terminalreporter.write_line(
        f"shared: {ran} ran, {skipped} skipped"
        if SHARED.is_dir()
        else f"{skipped} tests of measured data skipped: {ABSENT}"
    )
