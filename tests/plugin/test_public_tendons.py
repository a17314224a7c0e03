"""Tendons of public models that become cables; skipped where one is not installed."""

from __future__ import annotations

import importlib.util
import math
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

SCRIPT = Path(__file__).parents[2] / "scripts" / "benchmarks" / "check_takeover.py"


@pytest.fixture(scope="module")
def study() -> ModuleType:
    """Return the script that plays these models."""
    found = importlib.util.spec_from_file_location("check_takeover", SCRIPT)
    assert found is not None and found.loader is not None
    module = importlib.util.module_from_spec(found)
    sys.modules[found.name] = module
    found.loader.exec_module(module)
    return module


def installed(package: str, file: str) -> Path:
    """Return a file of a package; skips the test where it is not installed."""
    found = importlib.util.find_spec(package)
    if found is None or found.origin is None:
        pytest.skip(f"{package} is not installed")
    place = Path(found.origin).parent / file
    if not place.exists():
        pytest.skip(f"{package} has no {file}")
    return place


def test_a_spiral_arm_curls_as_before_and_loses_the_capstan_s_share(
    study: ModuleType,
) -> None:
    spec, command = study.spiral(links=5), np.array([[0.0], [4.0]])
    before = study.play(spec.compile(), command, 0.2)
    after = study.play(study.taken(spec, ("cord",), 0.0), command, 0.2)
    assert np.ptp(before) > 0.2
    assert np.abs(after[:, : before.shape[1]] - before).max() < 1e-3
    assert study.capstan_error(study.taken(spec, ("cord",), 0.1), command, 0.1) < 1e-4


@pytest.mark.filterwarnings("ignore::cc_mujoco.errors.CableWarning")
def test_an_aero_hand_closes_as_before_and_loses_the_capstan_s_share(
    study: ModuleType,
) -> None:
    place = "_src/manipulation/aero_hand/xmls/right_hand.xml"
    spec = study.load(installed("mujoco_playground", place))
    command = study.closing(spec.compile())
    before = study.play(spec.compile(), command)
    after = study.play(study.taken(spec, study.HAND, 0.0), command)
    assert np.ptp(before[:, 0]) > 1.5
    assert np.abs(after[-1, : before.shape[1]] - before[-1]).max() < 0.02
    error = study.capstan_error(study.taken(spec, study.HAND, 0.1), command, 0.1)
    assert error < 2e-3


def test_the_bands_of_an_exosuit_hold_a_torso_as_before(study: ModuleType) -> None:
    spec = study.load(
        installed("myosuite", "simhive/myo_sim/torso/myotorso_exosuit.xml")
    )
    command = np.zeros((2, 0))
    before = study.play(spec.compile(), command)
    after = study.play(study.taken(spec, study.BANDS, 0.0), command)
    assert np.abs(after[:, : before.shape[1]] - before).max() < 1e-3
    assert math.isfinite(before.max())
