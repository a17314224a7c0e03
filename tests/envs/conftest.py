"""The environments that every test of this folder runs on."""

from __future__ import annotations

import sys
import types
from pathlib import Path
from typing import Any

import mujoco
import pytest

import cc_mujoco  # noqa: F401, registers the environments
from cc_mujoco.envs import IDS

SINGLE = [name for name, device in IDS.items() if device != "exosuit"]
"""Environments of one axis."""


@pytest.fixture(params=SINGLE)
def name(request: pytest.FixtureRequest) -> str:
    """Id of an environment."""
    return str(request.param)


@pytest.fixture(scope="session")
def _gl() -> None:
    try:
        renderer = mujoco.Renderer(mujoco.MjModel.from_xml_string("<mujoco/>"), 8, 8)
    except Exception as error:
        pytest.skip(f"OpenGL is not available: {error}")
    renderer.close()


@pytest.fixture
def gl(_gl: None) -> None:
    """Skip where nothing can be drawn."""


class Clip:
    """Stand-in for moviepy's clip that keeps its frames instead of encoding them."""

    def __init__(self, frames: list[Any], fps: float) -> None:
        self.frames, self.seconds = list(frames), len(frames) / fps

    def write_videofile(self, path: str, logger: Any) -> None:
        Path(path).write_bytes(b"")


@pytest.fixture
def clips(monkeypatch: pytest.MonkeyPatch) -> list[Clip]:
    """Films that Gymnasium has written since the test began."""
    written: list[Clip] = []

    def clip(frames: list[Any], fps: float) -> Clip:
        written.append(Clip(frames, fps))
        return written[-1]

    for name in ("moviepy", "moviepy.video", "moviepy.video.io"):
        monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
    module: Any = types.ModuleType("moviepy.video.io.ImageSequenceClip")
    module.ImageSequenceClip = clip
    monkeypatch.setitem(sys.modules, module.__name__, module)
    return written
