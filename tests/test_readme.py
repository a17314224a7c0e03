"""The README's code runs, and its table is that of the package."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import pytest

import cc_mujoco
from cc_mujoco.transmission import PARAMETERS

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def table() -> str:
    """Parameters as Markdown."""
    rows = ["| key | unit | range | default | meaning |", "|---|---|---|---|---|"]
    for p in PARAMETERS:
        opening = "(" if p.low_open else "["
        span = f"{opening}{p.low:g}, {p.high:g}]"
        rows.append(f"| `{p.name}` | {p.unit} | {span} | {p.default:g} | {p.meaning} |")
    return "\n".join(rows)


def test_parameter_table_is_that_of_the_package() -> None:
    assert table() in README, f"paste this into README.md:\n{table()}"


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


def test_scripts_that_it_names_exist() -> None:
    root = Path(__file__).parents[1]
    for name in re.findall(r"scripts/\w+(?:\.\w+)?", README):
        assert (root / name).exists(), name
