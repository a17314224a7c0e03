"""The environments that every test of this folder runs on."""

from __future__ import annotations

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
