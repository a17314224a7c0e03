"""Every example runs, finds what its text says, and uses public names only."""

from __future__ import annotations

import ast
import runpy
from pathlib import Path
from typing import Any

import draw_examples
import numpy as np
import pytest
from PIL import Image

from cc_mujoco.control import read_policy

EXAMPLES = Path(__file__).parents[1] / "scripts" / "examples"
FILES = [EXAMPLES / f"{name}.py" for name in draw_examples.NAMES]
PUBLIC = "cc_mujoco"


def curves(name: str) -> dict[str, tuple[Any, Any]]:
    """Return the curves that an example draws, by their labels."""
    (axes,) = draw_examples.drawn(name).axes
    found = {str(line.get_label()): line.get_data() for line in axes.lines}
    assert all(x.shape == y.shape and np.isfinite(y).all() for x, y in found.values())
    return found


def error(found: dict[str, tuple[Any, Any]], name: str) -> float:
    """Return the RMS of a curve less the desired one."""
    return float(np.sqrt(np.mean((found[name][1] - found["desired"][1]) ** 2)))


def test_the_list_of_examples_is_whole_and_each_has_its_picture() -> None:
    scripts = {path.stem for path in EXAMPLES.glob("*.py")}
    assert scripts == {*draw_examples.NAMES, "knee_trials"}
    for path in FILES:
        with Image.open(path.with_suffix(".webp")) as picture:
            assert picture.size == (480, 270)
        assert path.with_suffix(".webp").stat().st_size < 30e3


@pytest.mark.parametrize("path", FILES, ids=draw_examples.NAMES)
def test_an_example_is_short_and_uses_public_names_only(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert 20 <= len(text.splitlines()) <= 85
    for node in ast.walk(ast.parse(text)):
        names = []
        if isinstance(node, ast.ImportFrom):
            names = [*(node.module or "").split("."), *(n.name for n in node.names)]
        elif isinstance(node, ast.Import):
            names = [part for n in node.names for part in n.name.split(".")]
        elif isinstance(node, ast.Attribute):
            names = [node.attr]
        assert not [n for n in names if n.startswith("_") and n != "__name__"], path


def test_friction_takes_tension_on_the_way() -> None:
    found = curves("cable_in_mjcf")
    assert found["at the motor"][1].max() > 1.5 * found["at the joint"][1].max()


def test_friction_of_a_tendon_makes_a_loop() -> None:
    found = curves("tendon_friction")
    middle = len(found["friction 0"][0]) // 2

    def width(name: str) -> float:
        out, back = found[name][1][:middle], found[name][1][middle:][::-1]
        return float(np.abs(out - back[: len(out)]).mean())

    assert width("friction 0.15") > 2.0 * width("friction 0")


@pytest.mark.study
def test_a_model_of_friction_helps_at_the_knee() -> None:
    found = curves("own_exoskeleton")
    assert error(found, "predictive") < error(found, "none")


def test_every_seed_is_another_plant() -> None:
    found = curves("own_environment")
    (_, one), (_, other), *_ = found.values()
    assert np.abs(one - other).max() > 1e-3


def test_an_own_controller_and_a_policy_do_better_than_none() -> None:
    found = curves("own_controller")
    assert error(found, "pi_tuned") < error(found, "lead") < error(found, "none")
    found = curves("play_policy")
    assert error(found, "policy") < 0.6 * error(found, "none")


@pytest.mark.study
def test_detents_are_felt() -> None:
    found = curves("own_task")
    assert error(found, "delivered") < 0.5 * np.sqrt(np.mean(found["desired"][1] ** 2))


def test_friction_raises_the_own_metric() -> None:
    for _, values in curves("own_metric").values():
        assert np.all(np.diff(values) > 0.0)


def test_the_own_effect_opposes_the_motion() -> None:
    found = curves("own_effect")
    assert np.abs(found["with the drag"][1] - found["without"][1]).max() > 0.3


def test_loops_and_friction_cost_accuracy() -> None:
    found = curves("what_if")
    assert np.all(
        np.diff([found[f"{loops} loops"][1] for loops in (1, 2, 3)], axis=0) > 0
    )


def test_a_search_finds_designs_that_keep_the_limit() -> None:
    pytest.importorskip("optuna")
    assert curves("search")["keeps the limit"][0].size


def test_ppo_learns_and_its_policy_plays(tmp_path: Path) -> None:
    pytest.importorskip("torch")
    path = tmp_path / "policy.safetensors"
    train = runpy.run_path(str(EXAMPLES / "train_ppo.py"))["train"]
    _, returns = train(updates=14, path=path)
    assert returns[-1] > 0.6 * returns[0]
    policy = read_policy(path)[0]
    assert policy.motors == 1


def test_a_rig_runs_to_its_end_within_limits(
    capsys: pytest.CaptureFixture[str],
) -> None:
    found = curves("rig_in_the_loop")
    assert "are over" in capsys.readouterr().out
    assert error(found, "at the joint") < 0.1
