"""Events: something that happens once, in a trial or between two trials."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cc_mujoco.datasets import Dataset, Trial
from cc_mujoco.datasets._dataset_file import DatasetFile, read_dataset_file
from cc_mujoco.diagnosis import BaselineFit, Options, run_inference
from cc_mujoco.diagnosis._events import _is_comparable, find_events, leave_out
from cc_mujoco.diagnosis._verdict import Event
from diagnosis.inference.test_per_trial import baseline_fit
from diagnosis.recorded import BENCH, dataset

USUAL = {"friction": 0.13, "axial_stiffness": 47e3, "pretension": 82.0}
LENGTH, WHEN = 4.0, 2.3
EVENT_TRIAL = 3


def session(
    *, hidden: dict[str, float] | None = None, later: dict[str, float] | None = None
) -> Dataset:
    """Return six trials; those from the fourth on may have other cables."""
    trials: list[Trial] = []
    for seed in (0, 1):
        changes = USUAL | (hidden or {}) | ((later or {}) if seed else {})
        for trial in dataset(changes=changes, seed=seed, duration=LENGTH).trials:
            name = f"run_{len(trials)}"
            trials.append(replace(trial, name=name, path=f"{name}.csv"))
    return replace(dataset(duration=0.1), trials=tuple(trials))


def found_in(data: Dataset) -> tuple[BaselineFit, Event | None]:
    fitted = baseline_fit(data)
    found = find_events(fitted.problem, fitted.whole.x, data)
    return fitted, found[0] if found else None


def changed(data: Dataset, change: Callable[[Trial, np.ndarray], Trial]) -> Dataset:
    """Return the data with a change of the fourth trial from a moment on."""
    trials = [
        change(trial, trial.time - trial.time[0] > WHEN) if k == EVENT_TRIAL else trial
        for k, trial in enumerate(data.trials)
    ]
    return replace(data, trials=tuple(trials))


def declared(folder: Path, event: Event) -> DatasetFile:
    """Return the `dataset.toml` that the event asks for."""
    path = folder / "dataset.toml"
    path.write_text("\n".join(event.declaration), encoding="utf-8")
    return read_dataset_file(path)


def noise(count: int) -> np.ndarray:
    return 0.01 * np.random.default_rng(1).standard_normal(count)


def silent(trial: Trial, off: np.ndarray) -> Trial:
    torques = (trial.motor_torque, trial.joint_torque)
    motor, joint = (np.where(off, noise(off.size), t) for t in torques)
    return replace(trial, motor_torque=motor, joint_torque=joint)


def dead(trial: Trial, off: np.ndarray) -> Trial:
    joint = np.where(off, noise(off.size), trial.joint_torque)
    return replace(trial, joint_torque=joint)


def gained(trial: Trial, off: np.ndarray) -> Trial:
    joint = np.where(off, 0.8, 1.0) * trial.joint_torque
    return replace(trial, joint_torque=joint)


def drifted(trial: Trial, size: np.ndarray | float) -> Trial:
    return replace(trial, joint_torque=trial.joint_torque + size)


def zeroed(trial: Trial, size: np.ndarray | float) -> Trial:
    return replace(trial, motor_angle=trial.motor_angle + size)


@pytest.mark.parametrize(
    ("change", "kind", "size"),
    [(silent, "silent", 0.0), (dead, "dead", 0.0), (gained, "gain", 0.8)],
)
def test_what_happens_in_a_trial_is_named_with_its_time(
    tmp_path: Path, change: Callable[[Trial, np.ndarray], Trial], kind: str, size: float
) -> None:
    data = changed(session(), change)
    fitted, event = found_in(data)
    assert fitted.crossed.misfit > 1.5
    assert event is not None and event.kind == kind
    name = f"run_{EVENT_TRIAL}"
    assert event.file == f"{name}.csv" and list(event.spans) == [name]
    start = float(data.trials[EVENT_TRIAL].time[0]) + WHEN
    assert event.time == pytest.approx(start, abs=0.1)
    assert event.size.value == pytest.approx(size, abs=0.02)
    facts = declared(tmp_path, event).facts_of(Path(f"{name}.csv"))
    ((low, high),) = facts.valid or ()
    assert low == float(data.trials[EVENT_TRIAL].time[0])
    assert high == pytest.approx(event.time, abs=1e-3)
    rest = leave_out(data, event)
    assert rest.trials[EVENT_TRIAL].duration == pytest.approx(WHEN, abs=0.1)
    again, other = found_in(rest)
    assert again.crossed.misfit < 1.3 and other is None


@pytest.mark.parametrize("start", [1.4, 3.3])
def test_a_torque_that_drifts_is_found_where_it_begins_and_ends(start: float) -> None:
    size = 0.3
    data = changed(
        session(),
        lambda trial, _: drifted(
            trial,
            size * np.clip((trial.time - start) / (trial.time[-1] - start), 0.0, None),
        ),
    )
    late = tuple(drifted(trial, size) for trial in data.trials[EVENT_TRIAL + 1 :])
    data = replace(data, trials=data.trials[: EVENT_TRIAL + 1] + late)
    _, event = found_in(data)
    assert event is not None and event.kind == "drift"
    assert event.file == f"run_{EVENT_TRIAL}.csv"
    assert list(event.spans) == [f"run_{k}" for k in range(EVENT_TRIAL, 6)]
    assert event.time == pytest.approx(start, abs=0.2)
    assert event.interval[0] <= start <= event.interval[1]
    assert event.size.value == pytest.approx(size, abs=0.02)
    again, other = found_in(leave_out(data, event))
    assert other is None and again.crossed.misfit < 1.3


def test_of_two_gains_that_of_the_scene_stays() -> None:
    """The trials with the other gain are more."""
    data = session()
    first = data.trials[1]
    late = first.time - first.time[0] > WHEN
    trials = [gained(trial, trial.time > -math.inf) for trial in data.trials[2:]]
    data = replace(data, trials=(data.trials[0], gained(first, late), *trials))
    fitted = baseline_fit(data)
    pair = find_events(fitted.problem, fitted.whole.x, data)
    assert [event.kind for event in pair] == ["gain", "gain"]
    assert sorted({*pair[0].spans} & {*pair[1].spans}) == ["run_1"]
    settings = Options(("torque_sensor_gain", "viscous_friction"))
    found = run_inference(data, BENCH, settings).diagnosis
    assert found.verdict == "none", found.statement
    (event,) = found.events
    assert list(event.spans) == [f"run_{k}" for k in range(1, 6)]
    assert event.size.value == pytest.approx(0.8, abs=0.02)


def test_trials_of_another_cable_are_judged_as_an_occasion(tmp_path: Path) -> None:
    data = session(later={"friction": 0.09})
    settings = Options(("backlash", "viscous_friction"))
    found = run_inference(data, BENCH, settings).diagnosis
    assert found.verdict == "none", found.statement
    (event,) = found.events
    assert event.kind == "friction" and math.isnan(event.time)
    assert event.size.holds(0.09 / 0.13)
    assert "0.69" in event.statement and "oiled" in event.statement
    assert found.occasions is not None
    file = declared(tmp_path, event)
    occasions = [file.facts_of(Path(trial.path)).occasion for trial in data.trials]
    assert len(set(occasions)) == 2 and all(occasions)
    assert [own == event.occasion for own in occasions] == [
        trial.name in event.spans for trial in data.trials
    ]


def test_the_slowest_trial_is_an_event_by_a_constant_that_fits_it() -> None:
    slow = dataset(changes=USUAL | {"pretension": 41.0}, duration=LENGTH).trials[0]
    late = replace(slow, name="run_6", path="run_6.csv", time=20.0 * slow.time)
    data = session()
    data = replace(data, trials=(*data.trials, late))
    fitted = baseline_fit(data)
    model = fitted.problem, fitted.whole.x
    (event,) = find_events(*model, data, any_motion=True)
    assert event.kind == "pretension" and list(event.spans) == ["run_6"]
    assert event.size.value == pytest.approx(0.5, abs=0.02)


def test_an_encoder_that_is_zeroed_in_a_trial_divides_it_and_the_later_ones(
    tmp_path: Path,
) -> None:
    data = changed(session(), lambda trial, off: zeroed(trial, 0.02 * off))
    later = tuple(zeroed(trial, 0.02) for trial in data.trials[EVENT_TRIAL + 1 :])
    trials = data.trials[: EVENT_TRIAL + 1] + later
    data = replace(data, trials=trials)
    _, event = found_in(data)
    assert event is not None and event.kind == "joint_angle_offset"
    assert event.size.value == pytest.approx(0.02, abs=1e-3)
    file = declared(tmp_path, event)
    facts = [file.facts_of(Path(trial.path)) for trial in data.trials]
    assert [each.valid is not None for each in facts] == [
        k == EVENT_TRIAL for k in range(len(facts))
    ]
    later_ones = [each.occasion == event.occasion for each in facts]
    assert later_ones == [k > EVENT_TRIAL for k in range(len(facts))]
    again, other = found_in(leave_out(data, event))
    assert other is None and again.crossed.misfit < 1.3


def test_a_zero_that_moves_with_the_declared_pretension_is_no_event() -> None:
    """Cables that are off have no pretension that others could have in common."""
    facts = [(80.0, False), (52.0, False), (80.0, False), (0.0, True)]
    records = [
        SimpleNamespace(
            trial=f"run_{k}", pretension=tight, unhooked=off, tilt=0.0,
            known_torques=(0.0, 0.0),
        )
        for k, (tight, off) in enumerate(facts)
    ]  # fmt: skip
    speeds = dict(zip([r.trial for r in records], (1.0, 1.0, 9.0, 1.0), strict=True))
    tracks: Any = {
        name: SimpleNamespace(conditions=np.full((4, 5), speed))
        for name, speed in speeds.items()
    }
    problem: Any = SimpleNamespace(plant=SimpleNamespace(records=records))

    def comparable(name: str, any_motion: bool) -> bool:
        others = [other for other in tracks if other != name]
        return _is_comparable(problem, tracks, [name], others, any_motion)

    assert [comparable(name, False) for name in tracks] == [True, False, False, True]
    assert [comparable(name, True) for name in tracks] == [True, False, True, True]


@pytest.mark.parametrize("hidden", [{}, {"end_compliance": 2e-5}])
def test_nothing_happens_in_trials_of_one_rig(hidden: dict[str, float]) -> None:
    fitted, event = found_in(session(hidden=hidden))
    assert event is None
    assert (fitted.crossed.misfit > 1.5) == bool(hidden)
