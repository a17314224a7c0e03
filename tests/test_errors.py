"""The package's exception says what would have been right."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import pytest

import cc_mujoco
from cc_mujoco import human
from cc_mujoco.envs import IDS
from cc_mujoco.errors import MANY, CableError


def test_an_unknown_name_brings_the_nearest_one_and_all() -> None:
    error = CableError.unknown("trajectory", "sin", {"sweep", "sine"})
    assert isinstance(error, ValueError)
    text = "unknown trajectory 'sin': did you mean 'sine'? Available: sine, sweep."
    assert str(error) == text


def test_of_many_names_only_near_ones_are_told() -> None:
    names = [f"a{number}" for number in range(MANY)] + ["friction"]
    error = CableError.unknown("variable", "frictio", names)
    assert str(error) == "unknown variable 'frictio': did you mean 'friction'?"
    assert names[0] in str(CableError.unknown("variable", "zzz", names))


@pytest.mark.parametrize("name", ["", "zzz", None])
def test_no_near_name_is_no_guess(name: Any) -> None:
    text = str(CableError.unknown("task", name, ["tunnel"]))
    assert text == f"unknown task {name!r}. Available: tunnel."


def test_where_there_are_no_names_that_is_said() -> None:
    assert str(CableError.unknown("cable", "a", [])).endswith("there is none here.")


def test_old_names_are_refused_with_the_new_ones(tmp_path: Path) -> None:
    takers: list[Callable[..., object]] = [
        partial(cc_mujoco.simulate, "wrist"),
        partial(cc_mujoco.study, "wrist", {"loops": [1]}),
        partial(cc_mujoco.optimise, "wrist", {"loops": "1:3"}, ["slack_margin"]),
        *(partial(gymnasium.make, name) for name in IDS),
        *(partial(gymnasium.make_vec, name, 2) for name in IDS),
    ]
    for take in takers:
        with pytest.raises(CableError, match="motion is now trajectory"):
            take(motion="sine")
        with pytest.raises(CableError, match="'trajctory': did you mean 'trajectory'"):
            take(trajctory="sine")
    with pytest.raises(CableError, match="read_motion is now read_trajectory"):
        human.read_motion  # noqa: B018
    for data in (["run.csv"], str(tmp_path)):
        with pytest.raises(CableError, match=r"diagnose\(scene, data, out\)"):
            cc_mujoco.diagnose(data, "bench", tmp_path / "out")  # type: ignore[arg-type]
