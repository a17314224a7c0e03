"""Mode `human`: a window that shows each step, and one sentence without a screen."""

from __future__ import annotations

import json
from typing import Any

import gymnasium
import pytest

from cc_mujoco.errors import CableError
from virtual_screen import run_in_a_window

IN_A_WINDOW = """
import json, time
import cc_mujoco, gymnasium, numpy as np
found = {}
for name in ("cc_mujoco/WristHandle-v1", "cc_mujoco/Walking-v0"):
    shown = gymnasium.make(name, render_mode="human", disable_env_checker=True)
    plain = gymnasium.make(name, disable_env_checker=True)
    action = np.full(shown.action_space.shape, 0.1, np.float32)
    before, equal = time.perf_counter(), []
    for one in range(2):
        a, b = shown.reset(seed=one), plain.reset(seed=one)
        equal.append(np.array_equal(a[0], b[0]))
        while shown.unwrapped.data.time < 0.5:
            a, b = shown.step(action), plain.step(action)
            equal.append(np.array_equal(a[0], b[0]) and a[1] == b[1])
    wall = time.perf_counter() - before
    screen = shown.unwrapped._screen._window._screen
    while not screen.painted:
        time.sleep(0.02)
    seen = screen._frame
    found[name] = {
        "equal": all(equal), "wall": wall, "rendered": shown.render(),
        "cables": len(seen.tensions), "rows": [row[0] for row in seen.texts[0]],
        "camera": int(screen._viewer.cam.type), "painted": screen.painted,
    }
    screen._viewer.close()
    while screen.open:
        time.sleep(0.02)
    shown.step(action)
    shown.close()
left = gymnasium.make("cc_mujoco/WristHandle-v1", render_mode="human")
left.reset(seed=0)
print(json.dumps(found))
"""


def test_each_step_is_shown_in_real_time_and_is_the_same() -> None:
    found = json.loads(run_in_a_window(IN_A_WINDOW))
    cables = {
        "cc_mujoco/WristHandle-v1": ["flexor", "extensor"],
        "cc_mujoco/Walking-v0": ["right_cable", "left_cable"],
    }
    for name, names in cables.items():
        own = found[name]
        assert own["equal"] and own["painted"] and own["rendered"] is None
        assert own["wall"] > 0.98  # two episodes of 0.5 s
        assert own["cables"] == 2
        assert own["rows"] == ["time", *names]
    # MuJoCo's camera of the first is free, that of the second follows the person.
    assert [found[name]["camera"] for name in cables] == [0, 1]


@pytest.mark.parametrize("name", ["cc_mujoco/WristHandle-v1", "cc_mujoco/Walking-v0"])
def test_without_a_screen_it_is_one_sentence(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    for variable in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    with pytest.raises(CableError) as raised:
        gymnasium.make(name, render_mode="human")
    assert str(raised.value) == (
        'render_mode="human" needs a screen, and neither DISPLAY nor WAYLAND_DISPLAY '
        'is set; render_mode="rgb_array" needs none.'
    )


def test_a_vector_has_no_window() -> None:
    mode: Any = "human"
    with pytest.raises(CableError, match="unknown render mode 'human'"):
        gymnasium.make_vec("cc_mujoco/WristHandle-v1", 2, render_mode=mode)
