"""The README's code runs, and its table is that of the package."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

import cc_mujoco
from cc_mujoco.transmission import PARAMETERS
from cc_mujoco.transmission.parameter import as_table

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def test_parameter_table_is_that_of_the_package() -> None:
    written = f"<!-- parameters: begin -->\n{as_table(PARAMETERS)}\n"
    assert written in README, "run `python scripts/fill_readme.py parameters`"


@pytest.mark.parametrize("code", re.findall(r"```python\n(.*?)```", README, re.S))
def test_python_runs(
    code: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "README.md", "exec"), {})


def test_mjcf_loads_and_pulls() -> None:
    (xml,) = re.findall(r"```xml\n(.*?)```", README, re.S)
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data)
    reading = cc_mujoco.engine.read(model, data, "flexor")
    assert reading.tension_proximal == pytest.approx(10.0)
    mujoco.mj_step(model, data, round(2.0 / model.opt.timestep))
    assert np.abs(data.qvel).max() < 1e-6
    assert np.abs(data.qpos).max() < 0.02
    reading = cc_mujoco.engine.read(model, data, "flexor")
    assert reading.tension_distal == pytest.approx(10.0, rel=0.05)
    assert reading.dissipated < 1e-3
    limits = cc_mujoco.engine.step_limits(model)["flexor"]
    assert model.opt.timestep < 0.5 * min(limits)


def test_scripts_that_it_names_exist() -> None:
    root = Path(__file__).parents[1]
    for name in re.findall(r"scripts/\w+(?:\.\w+)?", README):
        assert (root / name).exists(), name
