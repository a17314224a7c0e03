"""What a diagnosis writes: an effect that the scene cannot have is never missing."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import mujoco
import pytest

from cc_mujoco.diagnosis.diagnose import diagnose
from cc_mujoco.diagnosis.effects import EFFECTS, Effect
from cc_mujoco.diagnosis.inference.reason import reason
from cc_mujoco.diagnosis.inference.result import DiagnosisResult, Settings
from cc_mujoco.diagnosis.report.output import scene
from cc_mujoco.diagnosis.report.steps import steps
from cc_mujoco.diagnosis.scene.realisation import why_not
from cc_mujoco.diagnosis.scene.repair import added
from cc_mujoco.diagnosis.verdict import FoundEffect
from cc_mujoco.diagnosis.wording import NOT_IN_SCENE, Names
from cc_mujoco.errors import CableError
from diagnosis.recorded import BENCH, dataset

RIPPLE = replace(
    EFFECTS["motor_cogging"],
    id="own_ripple",
    title="a ripple of our own",
    parameters=EFFECTS["motor_cogging"].parameters[:1],
)


@cache
def _nothing() -> DiagnosisResult:
    """A diagnosis in which nothing is missing."""
    data = dataset(duration=1.0, seed=3, chosen=(0, 2))
    return reason(data, BENCH, Settings(("motor_inertia",)))


def test_mujoco_has_every_effect_of_the_library() -> None:
    assert [name for name in EFFECTS if why_not(BENCH, name)] == []


@pytest.mark.parametrize(
    "effect", [RIPPLE, replace(RIPPLE, cables=lambda cables, values, rig: cables)]
)
def test_an_effect_without_realisation_is_stated_wherever_it_lacks(
    effect: Effect, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the file, in the problems of verdict.json, and in the steps of the report."""
    result = _nothing()
    monkeypatch.setitem(EFFECTS, effect.id, effect)
    assert result.problem is not None
    result = replace(result, problem=replace(result.problem, effects=(effect.id,)))
    told = scene(result, tmp_path / "scene.xml")
    assert told[0].startswith(f"{NOT_IN_SCENE} {effect.title}")
    assert "REALISATIONS" in told[0] and "verdict.json" in told[0]
    spec = mujoco.MjSpec.from_file(str(tmp_path / "scene.xml"))
    assert f"not in this scene, {effect.id}" in spec.comment
    assert added(tmp_path / "scene.xml") == ()
    named = replace(
        result.diagnosis,
        verdict="named",
        effects=(FoundEffect(effect.id, {}, 1.0),),
        problems=tuple(told),
    )
    assert told[0] in str(steps(named, Names()))


def test_a_single_path_is_no_list_of_letters(tmp_path: Path) -> None:
    with pytest.raises(CableError, match="nowhere does not exist"):
        diagnose(str(tmp_path / "nowhere"), BENCH.path, tmp_path / "out")
    with pytest.raises(CableError, match="data must be a path or a list of paths"):
        diagnose([b"data"], BENCH.path, tmp_path / "out")  # type: ignore[list-item]
