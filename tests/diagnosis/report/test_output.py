"""Output of a diagnosis: an effect that the scene cannot realise is always reported."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from cc_mujoco.diagnosis import (
    EFFECTS,
    Diagnosis,
    DiagnosisResult,
    Effect,
    Options,
    _diagnose,
    diagnose,
    run_inference,
)
from cc_mujoco.diagnosis._phrases import NOT_IN_SCENE_PREFIX
from cc_mujoco.diagnosis._propose.experiment import CataloguedTrial, trial_table
from cc_mujoco.diagnosis._report.output import write_and_compare_scene
from cc_mujoco.diagnosis._report.sections import next_steps
from cc_mujoco.diagnosis._scene.realisation import unrealisable_reason
from cc_mujoco.diagnosis._scene.repair import existing_effects
from cc_mujoco.diagnosis._verdict import FoundEffect, NextExperiment
from cc_mujoco.diagnosis.effects import usual_effects
from cc_mujoco.errors import CableError
from diagnosis.recorded import BENCH, dataset

RIPPLE = replace(
    EFFECTS["motor_cogging"],
    id="own_ripple",
    title="a ripple of our own",
    parameters=EFFECTS["motor_cogging"].parameters[:1],
    scene_note="",
)


@cache
def _nothing() -> DiagnosisResult:
    """Return a diagnosis without missing effects."""
    data = dataset(duration=1.0, seed=3, chosen=(0, 2))
    return run_inference(data, BENCH, Options(("motor_inertia",)))


def test_mujoco_has_every_usual_effect_of_the_library() -> None:
    assert [n for n in usual_effects() if unrealisable_reason(BENCH, n)] == []


def test_no_method_of_a_class_is_advised_for_effects_of_the_library() -> None:
    reasons = [unrealisable_reason(BENCH, name) for name in EFFECTS]
    assert "this package has no form of it in MuJoCo" in reasons
    assert not any("edit_spec" in reason for reason in reasons)


@pytest.mark.parametrize(
    "effect", [RIPPLE, replace(RIPPLE, cables=lambda cables, values, rig: cables)]
)
def test_an_effect_without_realisation_is_stated_wherever_it_lacks(
    effect: Effect, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is stated in the file, the problems of verdict.json and the report's steps."""
    result = _nothing()
    monkeypatch.setitem(EFFECTS, effect.id, effect)
    assert result.problem is not None
    result = replace(result, problem=replace(result.problem, effects=(effect.id,)))
    told = write_and_compare_scene(result, tmp_path / "scene.xml")
    assert told[0].startswith(f"{NOT_IN_SCENE_PREFIX} {effect.title}")
    assert "edit_spec" in told[0] and "verdict.json" in told[0]
    spec = mujoco.MjSpec.from_file(str(tmp_path / "scene.xml"))
    assert f"not in this scene, {effect.id}" in spec.comment
    assert existing_effects(tmp_path / "scene.xml") == ()
    named = replace(
        result.diagnosis,
        verdict="named",
        effects=(FoundEffect(effect.id, {}, 1.0),),
        problems=tuple(told),
    )
    assert told[0] in str(next_steps(named))


@pytest.mark.parametrize("interrupted", [False, True])
def test_the_report_does_not_wait_for_the_proposal_and_does_not_lose_it(
    interrupted: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found: Any = SimpleNamespace(ties=(("joint_gravity", "joint_stiffness"),))
    tied = replace(_nothing().diagnosis, verdict="tie", statement="A tie.")
    given = replace(_nothing(), diagnosis=tied, found=found)
    still = np.zeros(200)
    motion = CataloguedTrial("cables off", still, still, 0.0)
    facts = tuple(trial_table("trial_03", motion, 0.0))
    ids = found.ties[0]
    planned = NextExperiment("cables off", ids, "by far", ("trial_03",), facts)
    out, seen = tmp_path / "out", []

    def propose(_: Any, judged: Diagnosis) -> tuple[Diagnosis, Any]:
        assert seen == ["A tie. The trial that would separate them is worked out next."]
        assert judged.statement == "A tie."
        if interrupted:
            raise KeyboardInterrupt
        return replace(judged, next_experiment=planned), (motion,)

    def reported(diagnosis: Diagnosis) -> None:
        written = json.loads((out / "verdict.json").read_text(encoding="utf-8"))
        assert written["statement"] == diagnosis.statement
        page = (out / "report.html").read_text(encoding="utf-8")
        assert "worked out next" in page and "trial_03" not in page
        assert not (out / planned.folder).exists()
        seen.append(diagnosis.statement)

    monkeypatch.setattr(_diagnose, "propose", propose)
    data = dataset(duration=1.0, seed=3, chosen=(0, 2))
    monkeypatch.setattr(_diagnose, "infer", lambda *_, **__: (given, data))
    said = diagnose(BENCH.path, tmp_path, out, reported=reported)
    written = json.loads((out / "verdict.json").read_text(encoding="utf-8"))
    page = (out / "report.html").read_text(encoding="utf-8")
    assert written["statement"] == said.statement
    assert (said.next_experiment is None) is interrupted
    assert (out / planned.folder).is_dir() is not interrupted
    assert ("trial_03" in page) is ("worked out next" not in page) is not interrupted
    assert "data:image/png" in page and said.provenance["seed"] == 0


def test_a_single_path_is_no_list_of_letters(tmp_path: Path) -> None:
    with pytest.raises(CableError, match="nowhere does not exist"):
        diagnose(BENCH.path, str(tmp_path / "nowhere"), tmp_path / "out")
    with pytest.raises(CableError, match="data must be a path or a list of paths"):
        diagnose(BENCH.path, [b"data"], tmp_path / "out")  # type: ignore[list-item]
