"""The face of the package: what is in it, and what is not."""

from __future__ import annotations

import importlib
import pkgutil
import re
from pathlib import Path

import pytest

import cc_mujoco


def test_it_shows_what_it_promises_and_nothing_else() -> None:
    assert dir(cc_mujoco) == sorted(cc_mujoco.__all__)
    for name in cc_mujoco.__all__:
        assert getattr(cc_mujoco, name).__doc__, name
    with pytest.raises(AttributeError, match="attribute cables"):
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
    assert "cc_mujoco.cable._kernel" in found
    assert not any(".cc_mujoco" in name or ".tests" in name for name in found)


def test_public_class_names_are_unique() -> None:
    root = Path(__file__).parents[1]
    places: dict[str, list[str]] = {}
    for folder in ("cc_mujoco", "envs"):
        for path in (root / folder).rglob("*.py"):
            for name in re.findall(r"^class ([A-Za-z]\w*)[(:]", path.read_text(), re.M):
                places.setdefault(name, []).append(path.relative_to(root).as_posix())
    assert places["Cable"] == ["cc_mujoco/cable/_cable.py"]
    assert not {name: found for name, found in places.items() if len(found) > 1}


def test_workflows_run_actions_of_one_commit_and_keep_no_credentials() -> None:
    folder = Path(__file__).parents[1] / ".github" / "workflows"
    for path in folder.glob("*.yml"):
        lines = path.read_text(encoding="utf-8").splitlines()
        for number, line in enumerate(lines):
            if "uses:" not in line:
                continue
            assert re.search(r"uses: [\w-]+/[\w-]+@[0-9a-f]{40} # v\d+\.\d", line), line
            if "actions/checkout@" in line:
                assert "persist-credentials: false" in lines[number + 2], path
