"""Kernels compile in a third of the time where the compiler does not optimise."""

from __future__ import annotations

import pytest

warp = pytest.importorskip("warp")


@pytest.fixture(autouse=True)
def _quick_compiler(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch):
    if request.node.get_closest_marker("study") is None:
        monkeypatch.setattr(warp.config, "optimization_level", 0)
