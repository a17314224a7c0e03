"""One library serves several releases of MuJoCo."""

from __future__ import annotations

from pathlib import Path

import pytest

import cc_mujoco.plugin
from cc_mujoco.plugin import _mj_offsets as mj_offsets

LAYOUTS = Path(mj_offsets.__file__).with_name("native_layouts.h")


def test_the_installed_release_is_known() -> None:
    assert cc_mujoco.plugin.cables  # the library, which names its offsets, is loaded
    assert mj_offsets.row() in LAYOUTS.read_text()


def test_a_layout_or_a_constant_of_another_release_is_refused() -> None:
    paths = list(mj_offsets.LOADED)
    mj_offsets.verify(paths, {"mjtTrn.mjTRN_TENDON": 3})
    with pytest.raises(ImportError, match=r"differently than .*mjtTrn\.mjTRN_TENDON"):
        mj_offsets.verify(paths, {"mjtTrn.mjTRN_TENDON": 4})
