"""Cables in newton, as the page shows; it needs an environment of its own."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("newton")

PAGE = Path(__file__).parents[2] / "cc_mujoco" / "warp" / "README.md"


@pytest.mark.study
def test_the_example_of_the_page():
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.S)
    (code,) = [block for block in blocks if "import newton" in block]
    names = {}
    exec(compile(code, str(PAGE), "exec"), names)
    tensions = names["cables"].tensions.numpy()[:, 0]
    assert np.isfinite(tensions).all()
    losses = np.abs(np.diff(np.log(tensions), axis=1))[:, 0]
    assert (np.diff(losses) > 0.0).all()  # with friction, from world to world
