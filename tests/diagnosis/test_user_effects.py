"""Effects of the user's own: named like those of the library, or refused in words."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cc_mujoco.diagnosis import (
    EFFECTS,
    Options,
    Shape,
    Signals,
    Size,
    _diagnose,
    load,
    prepare,
    run_inference,
)
from cc_mujoco.diagnosis._fit.fit import BaselineFit, check_effects
from cc_mujoco.diagnosis._report.output import write_and_compare_scene
from cc_mujoco.diagnosis._rig.simulation import SimulatedRig
from cc_mujoco.diagnosis._scene.repair import existing_effects
from cc_mujoco.diagnosis._thresholds import Limit
from cc_mujoco.diagnosis.effects import effects_in_use
from cc_mujoco.diagnosis.effects._effect import effect_of_class
from cc_mujoco.errors import CableError
from diagnosis import bench
from diagnosis.recorded import BENCH, dataset

PAGE = Path(__file__).parents[2] / "cc_mujoco" / "diagnosis" / "README.md"
DRAG = {"joint_drag": {"joint_drag": 0.3}}


def page_example(folder: Path) -> str:
    """Write the class of the page to a file; return its name."""
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.S)
    (code,) = [block for block in blocks if "class JointDrag" in block]
    path = folder / "my.py"
    path.write_text(code, encoding="utf-8")
    return f"{path}:JointDrag"


class Pull:
    """Torque at the joint, in two forms."""

    needs = "motion"

    def parameters(self) -> list[Size | Shape]:
        return [Size("pull", "N m", 0.1)]

    def signals(self, signals: Signals, values: dict[str, float]) -> Signals:
        return signals.added(joint=values["pull"] * np.sin(signals.joint_angle))


def with_parts(**parts: Any) -> type:
    """Return the class with other parts; None takes one out."""
    known = {k: v for k, v in vars(Pull).items() if not k.startswith("__")}
    known["__doc__"] = Pull.__doc__
    kept = {k: v for k, v in {**known, **parts}.items() if v is not None}
    return type("Pull", (), kept)


def changing(change: Callable[[Signals, Any], Any]) -> type:
    return with_parts(signals=lambda self, signals, values: change(signals, values))


def checked(given: Any) -> tuple[str, ...]:
    """Check an effect on a short recording."""
    records, _ = prepare(dataset(duration=1.5, chosen=(0,)), BENCH)
    with effects_in_use([given]) as requested:
        return check_effects(SimulatedRig(BENCH, records, 4), {}, requested)


def test_the_example_of_the_page_is_named_and_in_the_scene(tmp_path: Path) -> None:
    with effects_in_use([page_example(tmp_path)]) as requested:
        ids = (*requested, "joint_inertia")
        found = run_inference(
            dataset(DRAG, 2.0), BENCH, Options(ids, requested=requested)
        )
        (named,) = found.diagnosis.effects
        assert (named.id, found.diagnosis.verdict) == ("joint_drag", "named")
        assert "Viscous drag on the joint" in found.diagnosis.statement
        assert named.parameters["joint_drag"].holds(0.3)
        scene = tmp_path / "scene.xml"
        (expected,) = write_and_compare_scene(found, scene)
        difference = re.search(
            r"by ([\d.e-]+) N m RMS, with torques of ([\d.]+)", expected
        )
        assert difference is not None
        assert float(difference[1]) < 1e-3 * float(difference[2])
    assert "joint_drag" not in EFFECTS
    assert existing_effects(scene) == ("joint_drag",)


def test_an_interrupted_search_ends_with_what_it_found() -> None:
    rounds = []

    def interrupt(share: float, doing: str) -> None:
        rounds.append(doing)
        if sum(each.startswith("screening") for each in rounds) == 2:
            rounds.clear()
            raise KeyboardInterrupt

    hidden = {**DRAG, "torque_sensor_offset": {"motor_torque_bias": 0.5}}
    hidden["torque_sensor_offset"] |= {
        "joint_torque_bias": 0.5,
        "motor_torque_drift": 0.0,
        "joint_torque_drift": 0.0,
    }
    drag = with_parts(
        id="joint_drag",
        parameters=lambda self: [Size("joint_drag", "N m s/rad", 0.05)],
        signals=lambda self, signals, values: signals.added(
            joint=-values["joint_drag"] * signals.joint_speed
        ),
    )
    with effects_in_use([drag]):
        ids = ("joint_drag", "torque_sensor_offset")
        found = run_inference(dataset(hidden, 2.0), BENCH, Options(ids), interrupt)
    assert len(found.diagnosis.effects) == 1
    assert found.diagnosis.statement.startswith("Stopped before all effects were tried")


def test_a_search_that_is_interrupted_at_once_says_that_nothing_was_added() -> None:
    def interrupt(share: float, doing: str) -> None:
        if doing.startswith("refitting"):
            raise KeyboardInterrupt

    hidden = {"joint_stiffness": {"joint_stiffness": 3.0, "joint_stiffness_moment": 0}}
    data = dataset(hidden, 1.5)
    found = run_inference(data, BENCH, Options(tuple(hidden)), interrupt)
    assert found.diagnosis.verdict == "unknown" and not found.diagnosis.effects
    assert "no effect had been added" in found.diagnosis.statement


def test_an_interrupted_search_is_not_repeated(monkeypatch: pytest.MonkeyPatch) -> None:
    interrupts, looked = [KeyboardInterrupt], []

    def interrupt(share: float, doing: str) -> None:
        if doing.startswith("refitting"):
            raise interrupts.pop()

    def find_events(*_: object, **__: object) -> list[object]:
        looked.append(_)
        return []

    # A thinned search is repeated, and one with effects looks for events again.
    monkeypatch.setattr(Limit, "long_trial", 1.0)
    monkeypatch.setattr(BaselineFit, "resolves", lambda *_: False)
    monkeypatch.setattr(_diagnose, "find_events", find_events)
    hidden = {"joint_stiffness": {"joint_stiffness": 3.0, "joint_stiffness_moment": 0}}
    found = run_inference(
        dataset(hidden, 2.0), BENCH, Options(tuple(hidden)), interrupt
    )
    assert found.diagnosis.interrupted and len(looked) == 1


def test_the_best_form_is_fitted_and_the_family_is_named() -> None:
    def signals(self: Any, given: Signals, values: dict[str, float]) -> Signals:
        law = (np.sin, np.cos)[round(values["pull_form"])]
        return given.added(joint=values["pull"] * law(3.0 * given.joint_angle))

    family = with_parts(forms=("sine", "cosine"), signals=signals)
    with effects_in_use([family]) as requested:
        data = dataset({"pull": {"pull": 0.4, "pull_form": 1.0}}, 2.0)
        found = run_inference(data, BENCH, Options(requested, requested=requested))
    (named,) = found.diagnosis.effects
    assert (named.id, named.form) == ("pull", "cosine")
    assert named.parameters["pull"].holds(0.4)


def test_a_shape_may_be_negative() -> None:
    stop = with_parts(
        parameters=lambda self: [
            Size("pull", "N m/rad", 5.0),
            Shape("place", "rad", (-0.6, -0.3), -2.0, 2.0),
        ],
        signals=lambda self, given, values: given.added(
            joint=values["pull"] * np.maximum(values["place"] - given.joint_angle, 0.0)
        ),
    )
    with effects_in_use([stop]) as requested:
        data = dataset({"pull": {"pull": 8.0, "place": -0.2}}, 3.0)
        found = run_inference(data, BENCH, Options(requested, requested=requested))
    (named,) = found.diagnosis.effects
    assert named.parameters["place"].value == pytest.approx(-0.2, abs=0.01)


def test_cables_know_the_order_and_the_temperature_of_their_trial() -> None:
    """Friction that falls from trial to trial is found by it, and not without it."""
    seen = set()

    def cables(self: Any, given: Any, values: dict[str, float], rig: Any) -> Any:
        seen.add((rig.conditions.order, rig.conditions.temperature))
        scale = 1.0 + values["wear"] * rig.conditions.order
        return tuple(c.replace(friction=max(c.friction * scale, 0.0)) for c in given)

    wear = with_parts(
        parameters=lambda self: [Size("wear", "1", 0.05)], signals=None, cables=cables
    )
    data = dataset(duration=1.5)
    data = replace(
        data,
        trials=tuple(
            replace(trial, temperature=np.full(trial.time.size, celsius))
            for trial, celsius in zip(data.trials, (20.0, 20.0, 26.0), strict=True)
        ),
    )
    records, _ = prepare(data, BENCH)
    with effects_in_use([wear]):
        plant = SimulatedRig(BENCH, records, 4)
        plain, worn = plant.simulate({}), plant.simulate({"wear": 0.2}, ("pull",))
    same = [np.array_equal(a, b) for a, b in zip(plain, worn, strict=True)]
    assert same == [False, True, False]
    assert seen == {(-1.0, -2.0), (0.0, -2.0), (1.0, 4.0)}


def test_further_columns_of_the_files_are_read(tmp_path: Path) -> None:
    columns = bench.recording(seconds=3.0)
    columns["neighbour"] = np.sin(columns["time_s"])
    pq.write_table(pa.table(columns), tmp_path / "run.parquet")
    data, _ = load(tmp_path / "run.parquet", columns=["neighbour", "other"])
    (trial,) = data.trials
    assert set(trial.columns) == {"neighbour"}
    assert np.allclose(trial.columns["neighbour"], np.sin(trial.time), atol=1e-6)
    assert "not looked for: it takes the column neighbour" in "".join(
        checked(with_parts(columns=("neighbour",)))
    )


def test_an_effect_that_changes_nothing_is_reported_with_what_it_needs() -> None:
    (note,) = checked(
        changing(
            lambda s, v: s.added(joint=v["pull"] * np.maximum(s.joint_angle - 9.0, 0))
        )
    )
    assert note == "Effect 'pull' changes nothing in these data; it takes motion."


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("nowhere.py:Pull", "there is no file 'nowhere.py'"),
        (f"{__file__}:Push", "has no class 'Push'"),
        ("nowhere:Pull", "there is no module 'nowhere'"),
        ("stribeck", "did you mean 'stribeck_friction'?"),
        (with_parts(parameters=None), "has no method `parameters`"),
        (with_parts(signals=None), "give it one of the methods signals, cables"),
        (with_parts(needs=None), "give the class a text `needs`"),
        (with_parts(signal=lambda self: None), "did you mean 'signals'?"),
        (with_parts(signals=lambda self: None), "it must be signals(self, signals,"),
        (with_parts(friction=lambda self, v: v), "a friction law as a function"),
        (with_parts(id="backlash"), "is in the library already"),
        (with_parts(parameters=lambda self: 3.0), "must be a list of Size and Shape"),
        (with_parts(parameters=lambda self: ["pull"]), "entries must be Size or Shape"),
        (
            with_parts(parameters=lambda self: [Shape("pull", "1", 1.0, 0.5, 2.0)]),
            "lists no Size",
        ),
        (
            with_parts(parameters=lambda self: [Size("backlash", "rad", 1.0)]),
            "is one of effect 'backlash'",
        ),
        (
            with_parts(parameters=lambda self: [Size("pull", "1", 0.0)]),
            "it must be a number other than 0",
        ),
        (with_parts(where="elbow"), "unknown where 'elbow'"),
        (changing(lambda s, v: s.added(joint=0.1)), "is not off where its sizes are 0"),
        (changing(lambda s, v: s.motor), "it must return the signals"),
        (changing(lambda s, v: replace(s, joint=s.joint[1:])), "has shape (374,)"),
        (changing(lambda s, v: s.added(joint=1.0 / v["pull"])), "ZeroDivisionError"),
        (changing(lambda s, v: s.added(joint=v["pul"])), "raised KeyError in"),
        (
            changing(lambda s, v: s.added(joint=v["pull"] * np.inf * s.joint)),
            "the torque `joint` is nan at 0 s",
        ),
        (changing(lambda s, v: s.added(joint=v["pull"] ** 2)), "use its root"),
        (
            changing(lambda s, v: s.added(joint=abs(v["pull"]) ** 0.5)),
            "use a power of it",
        ),
        (
            with_parts(
                signals=None, cables=lambda self, cables, values, rig: cables[0]
            ),
            "must return as many cables as it is given, 2",
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_is_wrong_is_said_in_one_sentence(given: Any, expected: str) -> None:
    with (
        np.errstate(all="ignore"),
        pytest.raises(CableError, match=re.escape(expected)) as caught,
    ):
        checked(given)
    assert "\n" not in str(caught.value)


def test_an_error_in_the_file_is_blamed_on_its_line(tmp_path: Path) -> None:
    path = tmp_path / "my.py"
    for code, expected in (
        (
            "import numpy\nnumpy.zeros(-1)\n",
            "raised ValueError in .*my.py, line 2: neg",
        ),
        ("def f(:\n", "raised SyntaxError in .*my.py, line 1"),
    ):
        path.write_text(code, encoding="utf-8")
        with (
            pytest.raises(CableError, match=expected),
            effects_in_use([f"{path}:Pull"]),
        ):
            pass


def test_a_class_becomes_an_effect_with_its_words() -> None:
    effect = effect_of_class(Pull)
    assert effect.id == "pull" and effect.title == "torque at the joint, in two forms"
    assert effect.where == "joint" and effect.required_excitation == "motion"
