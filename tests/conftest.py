"""Settings that all tests share."""

from __future__ import annotations

import gc
import hashlib
import os
import subprocess
import sys
from collections.abc import Generator
from importlib.metadata import version
from pathlib import Path

import pytest
from hypothesis import settings

from shared_folder import ABSENT, SHARED

# The same examples in every run, so more of them find nothing in the next one; and no
# deadline: the first call of a compiled function includes its compilation.
settings.register_profile(
    "repeatable", derandomize=True, deadline=None, max_examples=40
)
settings.load_profile("repeatable")

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "cc_mujoco"
STUDY = ROOT / "scripts" / "diagnosis_study"
COMPILE_RIGS = """
import dataclasses
from rig.dataset import make_trials, run, truth_of
from rig.makes import MAKES
from rig.nominal import make_rig
trial = make_trials("rich", 0)[0]
trial = dataclasses.replace(trial, command=trial.command[:2], target=trial.target[:2])
for make in MAKES:
    rig = make_rig(0, make=make)
    run(truth_of(rig, {}, 0), rig, trial)
"""
LONG = (
    "test_davinci.py",
    "test_instruments.py",
    "test_benchmark.py",
    "test_cluster.py",
    "test_study.py",
    "test_reason.py",
    "test_cli.py",
    "test_vector.py",
    "test_predictive.py",
    "test_learning.py",
    "test_web_page.py",
    "test_compare.py",
    "test_environments.py",
    "test_thesis_case.py",
    "test_per_trial.py",
    "test_page_benchmark.py",
    "test_continuum.py",
    "test_kernel_physics.py",
    "test_generate.py",
    "test_wheel.py",
    "test_model_based.py",
    "test_process.py",
    "test_random_cables.py",
    "test_page_claims.py",
    "test_kernel_accuracy.py",
    "test_report.py",
    "test_arrival.py",
    "test_pages.py",
    "test_sensitivity.py",
    "test_experiments_1_and_3.py",
    "test_calibration.py",
    "test_survival.py",
    "test_yielding.py",
)
"""Files that take five seconds or longer, the longest first."""


def pytest_configure(config: pytest.Config) -> None:
    """Compile what is kept on disk once, before workers start that would each do it.

    Not if that was done for these sources: even what is kept takes seconds to load,
    in which no test runs.
    """
    if hasattr(config, "workerinput"):
        return
    cache, now = getattr(config, "cache", None), _sources()
    if cache is None or cache.get("cc_mujoco/compiled", "") != now:
        _compile()
        if cache is not None:
            cache.set("cc_mujoco/compiled", _sources())


def _sources() -> str:
    """Of what is compiled and by what: versions, and every file's size and time."""
    digest = hashlib.sha256(sys.version.encode())
    for name in ("mujoco", "numba", "numpy"):
        digest.update(version(name).encode())
    for path in sorted([*PACKAGE.rglob("*.py"), *STUDY.rglob("*.py")]):
        about = path.stat()
        digest.update(f"{path} {about.st_size} {about.st_mtime_ns}".encode())
    kept = any((PACKAGE / "engine" / "__pycache__").glob("*.nbi"))
    kept = kept and any((STUDY / "rig" / "__pycache__").glob("*.nbi"))
    return digest.hexdigest() if kept else "nothing is kept"


def _compile() -> None:
    # The rigs' equations are compiled apart from the package's, so beside them.
    rigs = subprocess.Popen(
        [sys.executable, "-c", COMPILE_RIGS],
        env=os.environ | {"PYTHONPATH": str(STUDY)},
    )
    import gymnasium

    import cc_mujoco.envs  # noqa: F401, compiles the plugin
    from cc_mujoco.control import controller
    from cc_mujoco.transmission import Cable, Transmission, replay

    cable, still = Cable(), [0.0, 0.0]
    replay(cable, 1e-3, u_proximal=still, u_distal=still)
    pulleys = Transmission.pull_pull(cable, motor_radius=0.02, joint_radius=0.05)
    pulleys.replay(1e-3, motor_angle=still, joint_angle=still)
    with gymnasium.make("cc_mujoco/WristHandle-v1") as env:
        _, seen = env.reset(seed=0)
        for name in ("model", "stiction"):
            controller(name, env.unwrapped.drive).torque(seen)
    if rigs.wait() != 0:
        pytest.exit("the rigs of the diagnosis study do not run: see above", 1)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Look for no garbage among what the tests import: it stays, and looking costs."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip what needs the folder beside the checkout; begin with what takes longest.

    A long file that begins last would leave the other workers idle.
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


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Count the tests of the folder beside the checkout apart from all others."""
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
