"""The face of the package: what is in it, and what is not."""

from __future__ import annotations

import importlib
import pkgutil

import pytest

import cc_mujoco


def test_it_shows_what_it_promises_and_nothing_else() -> None:
    assert dir(cc_mujoco) == sorted(cc_mujoco.__all__)
    for name in cc_mujoco.__all__:
        assert getattr(cc_mujoco, name).__doc__, name
    with pytest.raises(AttributeError, match="no attribute 'cables'"):
        _ = cc_mujoco.cables


@pytest.mark.parametrize("name", ["tests", "scripts", "cc_mujoco", "runs"])
def test_the_rest_of_a_checkout_is_no_part_of_it(name: str) -> None:
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module(f"cc_mujoco.{name}")


def test_its_modules_are_found_once() -> None:
    found = [
        module.name
        for module in pkgutil.walk_packages(cc_mujoco.__path__, "cc_mujoco.")
    ]
    assert len(found) == len(set(found))
    assert "cc_mujoco.transmission.kernel" in found
    assert not any(".cc_mujoco" in name or ".tests" in name for name in found)
