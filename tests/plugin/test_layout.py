"""One library serves several releases of MuJoCo."""

from __future__ import annotations

from pathlib import Path

import pytest

from cc_mujoco.plugin import _mj_offsets as mj_offsets
from cc_mujoco.plugin._mj_struct import timestep

LAYOUTS = Path(mj_offsets.__file__).with_name("native_layouts.h")


def test_the_installed_release_is_known() -> None:
    assert timestep is not None  # all modules of the plugin are loaded
    assert mj_offsets.row() in LAYOUTS.read_text()


def test_a_layout_or_a_constant_of_another_release_is_refused() -> None:
    paths = list(mj_offsets.LOADED)
    mj_offsets.verify(paths, {"mjtTrn.mjTRN_TENDON": 3})
    with pytest.raises(ImportError, match=r"differently than .*mjtTrn\.mjTRN_TENDON"):
        mj_offsets.verify(paths, {"mjtTrn.mjTRN_TENDON": 4})
