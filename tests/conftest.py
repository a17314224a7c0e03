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
LONG = (
    "test_wheel.py",
    "test_export.py",
    "test_cli.py",
    "test_cluster.py",
    "test_axes.py",
    "test_study.py",
    "test_search.py",
    "test_guard.py",
    "test_benchmark.py",
    "test_what_runs_code.py",
    "test_plan.py",
    "test_per_trial.py",
    "test_environments.py",
    "test_command.py",
    "test_trust.py",
    "test_plugin_library.py",
    "test_predictive.py",
    "test_implicit_ends.py",
    "test_gait.py",
    "test_effects.py",
    "test_examples.py",
    "test_instruments.py",
    "test_devices.py",
    "test_compiled_episode.py",
    "test_rare_effects.py",
    "test_demo.py",
    "test_vector.py",
    "test_user_effects.py",
    "test_any_device.py",
    "test_generic.py",
    "test_process.py",
    "test_bad_input.py",
    "test_takeover.py",
    "test_report.py",
    "test_video.py",
    "test_kernel_physics.py",
    "test_learning.py",
    "test_registration.py",
    "test_open_energy.py",
    "test_testable.py",
    "test_reason.py",
    "test_survival.py",
    "test_model_based.py",
    "test_signs.py",
    "test_vector_env.py",
    "test_continuum.py",
    "test_unit_check.py",
    "test_page_in_browser.py",
    "test_play_rig.py",
    "test_moving_route.py",
    "test_davinci.py",
    "test_noise.py",
    "test_policy.py",
    "test_led_scenes.py",
    "test_location.py",
    "test_guides.py",
    "test_across.py",
    "test_records.py",
    "test_replay.py",
    "test_requirements.py",
    "test_open_path.py",
    "test_promises.py",
    "test_starting.py",
    "test_agreement.py",
    "test_generate.py",
    "test_sensitivity.py",
    "test_random_cables.py",
    "test_drag.py",
)
"""Files that take two seconds or longer, the longest first."""


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
    """Skip tests that need the folder beside the checkout, and start the longest first.

    A long file that starts last would leave the other workers idle.
    """
    if not SHARED.is_dir():
        for item in items:
            if item.get_closest_marker("shared"):
                item.add_marker(pytest.mark.skip(reason=ABSENT))
    place = {name: number for number, name in enumerate(LONG)}
    items.sort(
        key=lambda item: (
            place.get(item.path.name, len(LONG)),
            item.get_closest_marker("slow") is None,
        )
    )


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
