"""Curves learned from errors: planted ones are found, chance gives none."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cc_mujoco.diagnosis import LearnedCurve, Signals, rollout
from cc_mujoco.diagnosis._learn.curves import QUANTITIES
from cc_mujoco.diagnosis._learn.formulas import FORMULAS, described
from cc_mujoco.diagnosis._learn.learning import (
    CurveTerm,
    ErrorRecord,
    ErrorRows,
    choose,
    formula_of,
    hats,
)
from cc_mujoco.diagnosis._learn.residual import classes_of, file_text
from cc_mujoco.diagnosis._phrases import MINUS
from cc_mujoco.diagnosis._rig.records import low_pass
from cc_mujoco.diagnosis._scene.repair import repair_scene, write
from cc_mujoco.diagnosis._verdict import Learned, LearnedTable
from cc_mujoco.diagnosis.effects import EFFECTS, effects_in_use
from cc_mujoco.errors import CableError
from diagnosis.rigs import BENCH, JOINT, MOTOR, TIME

DT, BAND, FLOOR = 0.004, 25.0, 0.02
Signal = np.ndarray


def signals(seed: int, seconds: float = 6.0) -> Signals:
    """Return a motion with torques of a spring and of friction."""
    random = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, DT)

    def mixed(size: float) -> Signal:
        waves = random.uniform((1.0, 0.0), (5.0, 6.0), (3, 2))
        return size * sum(np.sin(rate * time + phase) for rate, phase in waves)

    joint, pull = mixed(0.3), mixed(0.7)
    loss = 0.3 * np.tanh(20.0 * np.gradient(joint, DT))
    motor = joint + 0.02 * pull
    ends = np.array([80.0 + 10.0 * pull, 80.0 - 10.0 * pull])
    given = DT, time, motor, joint, pull + loss, pull, 0.0, ends, ends, 0.05, 0.05
    return Signals(*given)


def rows(
    added: dict[str, LearnedCurve], seed: int, scatter: float = FLOOR
) -> ErrorRows:
    """Return the errors of eight trials by side, beside coloured noise."""
    random, stretches = np.random.default_rng(seed), []
    for k in range(8):
        own = signals(100 * seed + k)
        error = random.standard_normal((2, own.time.size))
        error = low_pass(error, BAND, 1.0 / DT)
        error *= scatter / np.std(error)
        for row, side in enumerate(("motor", "joint")):
            if side in added:
                shown = added[side].signals(own, {f"{added[side].id}_share": 1.0})
                error[row] += getattr(shown, side) - getattr(own, side)
        slopes = np.zeros((2, 2, own.time.size))
        slopes[[0, 1], [0, 1]] = 1.0
        weight, noise = np.full_like(error, 1.0 / FLOOR), np.full_like(error, FLOOR)
        stretches.append(
            ErrorRecord(f"trial_{k}", own, error, slopes, weight, noise, BAND)
        )
    return ErrorRows(stretches, ("motor", "joint"), np.zeros(2), np.zeros(2))


def curve(**parts: object) -> LearnedCurve:
    made: LearnedCurve = type("Learned", (LearnedCurve,), parts)()
    return made


BUMP = curve(
    over="joint angle",
    at=(-0.1, 0.0, 0.1, 0.2, 0.3),
    joint_torque=(0.0, 0.1, 0.3, 0.1, 0.0),
)


def closed(found: ErrorRows) -> tuple[list[CurveTerm], float]:
    """Return the curves of all trials, and the gap closed on trials left out."""
    every = np.arange(len(found.names))
    before, after = np.zeros(every.size), np.zeros(every.size)
    for fold in (every[k::4] for k in range(4)):
        train = np.setdiff1d(every, fold)
        for into, terms in ((before, []), (after, choose(found, train))):
            fit = found.fitted(terms, train)
            left = found.squares(terms)[fold]
            into[fold] = np.einsum("gij,i,j->g", left, fit, fit)
    least = np.sqrt(found.noise.sum())
    gap = 1.0 - (np.sqrt(after.sum()) - least) / (np.sqrt(before.sum()) - least)
    return choose(found, every), float(gap)


def test_a_bump_over_the_joint_angle_is_found_and_closes_the_gap() -> None:
    terms, share = closed(rows({"joint": BUMP}, 1))
    assert [(t.over, t.times, t.sides) for t in terms] == [
        ("joint angle", "", ("joint",))
    ]
    assert share > 0.9


def test_a_curve_has_the_factor_and_the_sides_that_were_planted() -> None:
    table = (0.0, 0.0, 0.5, 0.0, 0.0)
    loss = curve(
        over="joint angle", times="friction", at=(-0.5, -0.1, 0.0, 0.1, 0.5),
        motor_torque=table, joint_torque=table,
    )  # fmt: skip
    terms, share = closed(rows({"motor": loss, "joint": loss}, 2))
    assert terms[0].times in ("friction", "direction")
    assert set(terms[0].sides) == {"motor", "joint"} and share > 0.6


def test_a_torque_beyond_its_range_in_one_trial_hides_no_curve_of_the_other() -> None:
    places = np.linspace(-2.0, 2.0, 15)
    cube = curve(over="torque", at=tuple(places), joint_torque=tuple(0.02 * places**3))
    whole = rows({"joint": cube}, 4)
    first, *others = whole.stretches
    far = replace(first.signals, motor=4.0 + first.signals.motor)
    for own in others:
        own.error[0] += 0.1 * np.maximum(own.signals.motor, 0.0) ** 2
    found = replace(whole, stretches=[first._replace(signals=far), *others])
    (term, *_) = choose(found, np.arange(8))
    assert (term.over, term.sides) == ("torque", ("joint",))


def test_a_tension_is_that_of_the_cables_at_the_side() -> None:
    one = signals(5)
    one = replace(one, tension_distal=0.9 * one.tension_proximal)
    motor, joint = (QUANTITIES["tension"].values(one, s) for s in ("motor", "joint"))
    np.testing.assert_allclose(motor, one.tension_proximal.mean(0))
    np.testing.assert_allclose(joint, 0.9 * motor)


def test_a_period_is_found() -> None:
    wave = curve(
        over="joint angle", period=2.0 * np.pi / 23.0, at=(0.0, 0.1, 0.2),
        joint_torque=(0.0, 0.2, -0.1),
    )  # fmt: skip
    terms, share = closed(rows({"joint": wave}, 3))
    assert 2.0 * np.pi / terms[0].period == pytest.approx(23.0, rel=0.01)
    assert terms[0].sides == ("joint",) and share > 0.8


@pytest.mark.parametrize(
    ("name", "shape", "words"),
    [
        ("sine", (1.0 / 7.0,), "a periodic error of the joint angle, 6.99 per turn"),
        ("bump", (0.1, 0.1), "a bump at 0.0997 rad"),
        ("catch", (-0.15, 0.11), f"a catch at {MINUS}0.15"),
        ("stop", (0.2,), "a rise from 0.21"),
    ],
)
def test_a_curve_is_recognised_as_the_formula_that_it_samples(
    name: str, shape: tuple[float, ...], words: str
) -> None:
    at = np.linspace(-1.2, 1.2, 97)
    table = 0.4 * sum(FORMULAS[name].functions(at, *shape))
    planted = curve(
        over="joint angle", at=tuple(at.tolist()), joint_torque=tuple(table.tolist())
    )
    found = rows({"joint": planted}, 30)
    terms = choose(found, np.arange(8))
    formula = formula_of(found, terms, 0)
    assert formula is not None and formula.formula == name
    assert formula.shape == pytest.approx(shape, rel=0.03, abs=0.012)
    text = described(formula.formula, "joint angle", "rad", formula.shape)
    assert text.startswith(words), text


def test_a_curve_without_a_formula_stays_a_curve() -> None:
    random = np.random.default_rng(4)
    table = tuple(random.uniform(-0.3, 0.3, 12).tolist())
    at = tuple(np.linspace(-0.6, 0.6, 12).tolist())
    found = rows({"joint": curve(over="joint angle", at=at, joint_torque=table)}, 31)
    terms = choose(found, np.arange(8))
    assert terms and formula_of(found, terms, 0) is None


@pytest.mark.parametrize("seed", range(8))
def test_chance_gives_no_curve_however_large(seed: int) -> None:
    assert choose(rows({}, 10 + seed, 5.0 * FLOOR), np.arange(8)) == []


def test_what_tuning_takes_gives_no_curve() -> None:
    offset = curve(over="time", at=(0.0, 9.0), motor_torque=(0.3, 0.3))
    assert choose(rows({"motor": offset}, 20), np.arange(8)) == []


def test_one_trial_alone_gives_no_curve() -> None:
    """An error of one trial is not of the rig, whatever it lies along."""
    plain, odd = rows({}, 21, 3.0 * FLOOR), rows({"joint": BUMP}, 21)
    some = [*plain.stretches[:7], odd.stretches[7]]
    assert choose(replace(plain, stretches=some), np.arange(8)) == []


def test_a_table_is_linear_between_its_points_and_holds_or_repeats() -> None:
    at, table = np.array([0.0, 1.0, 3.0]), np.array([1.0, 2.0, -2.0])
    values = np.linspace(-2.0, 6.0, 41)
    assert table @ hats(values, at, 0.0) == pytest.approx(np.interp(values, at, table))
    again = np.interp(values, at, table, period=4.0)
    assert table @ hats(values, at, 4.0) == pytest.approx(again)


def learned() -> Learned:
    at = tuple(np.linspace(-0.6, 0.6, 13).tolist())
    bump = tuple((0.4 * np.exp(-np.square(np.array(at) / 0.2))).tolist())
    wave = tuple((0.1 * np.sin(np.arange(8) * np.pi / 4.0)).tolist())
    period = 2.0 * np.pi / 7.0
    phases = tuple((period * np.arange(8) / 8).tolist())
    motor = "motor_torque_nm"
    tables = (
        ("joint angle", "rad", "", 0.0, at, "N m", {"joint_torque_nm": bump}),
        ("motor angle", "rad", "", period, phases, "N m", {motor: wave}),
        ("tension", "N", "friction", 0.0, (50.0, 90.0), "1", {motor: (0.0, 0.2)}),
    )
    names = "joint_angle", "motor_angle", "tension_times_friction"
    pairs = zip(names, tables, strict=True)
    curves = tuple(LearnedTable(f"learned_{name}", *each) for name, each in pairs)
    return Learned("", curves, {}, 0.9, (0.8, 1.0))


def test_the_file_has_the_curves_as_effects(tmp_path: Path) -> None:
    path, found = tmp_path / "learned.py", learned()
    path.write_text(file_text(found), encoding="utf-8")
    names = [f"{path}:{kind.__name__}" for kind in classes_of(found)]
    assert "learned.py:LearnedTensionTimesFriction" in path.read_text(encoding="utf-8")
    own = signals(5)
    with effects_in_use(names) as ids:
        effects = [EFFECTS[name] for name in ids]
        for effect, kind in zip(effects, classes_of(found), strict=True):
            assert effect.torques is not None
            off, on = (
                effect.torques(own, {f"{effect.id}_share": share})
                for share in (0.0, 1.0)
            )
            expected = kind().signals(own, {f"{effect.id}_share": 1.0})
            for side in ("motor", "joint"):
                assert np.array_equal(getattr(off, side), getattr(own, side))
                added = getattr(expected, side)
                assert getattr(on, side) == pytest.approx(added, abs=1e-5)
    assert not set(ids) & set(EFFECTS)


def test_curves_over_angles_act_in_a_scene(tmp_path: Path) -> None:
    """Played by MuJoCo, torques differ from those of the scene by the tables."""
    kinds, path = classes_of(learned())[:2], tmp_path / "scene.xml"
    shares = {f"{kind.id}_share": 1.0 for kind in kinds}
    with effects_in_use(kinds) as ids:
        values = {name: {f"{name}_share": 1.0} for name in ids}
        values["learned_joint_angle"]["joint_angle_offset"] = 0.05
        write(path, repair_scene(BENCH, BENCH.cables, values))
    assert "learned, from the error" in path.read_text(encoding="utf-8")
    motor, joint = rollout(path, TIME, MOTOR, JOINT)
    plain = BENCH.replay(TIME[1], MOTOR, JOINT)
    own = Signals(
        TIME[1], TIME, MOTOR, JOINT - 0.05, plain.motor_torque, plain.joint_torque
    )
    for kind in kinds:
        own = kind().signals(own, shares)
    # A series of as many waves as points equals the table at the points only.
    assert joint == pytest.approx(own.joint, abs=0.03)
    assert motor == pytest.approx(own.motor, abs=0.03)
    assert np.ptp(joint - plain.joint_torque) > 0.35


@pytest.mark.parametrize(
    ("parts", "expected"),
    [
        ({"over": "joint angel"}, "unknown quantity 'joint angel'"),
        ({"times": "load"}, "unknown quantity 'load'"),
        ({"joint_torque": (0.0, 1.0)}, "`joint_torque` has 2 values; it takes one for"),
        ({"at": (0.0, 0.0, 1.0, 2.0, 3.0)}, "points in `at` must be finite and rise"),
        ({"joint_torque": ()}, "must have `motor_torque` or `joint_torque`"),
    ],
)
def test_a_wrong_table_is_refused_in_a_sentence(
    parts: dict[str, object], expected: str
) -> None:
    kind = type("Mine", (type(BUMP),), {**parts, "id": "mine"})
    with pytest.raises(CableError, match=re.escape(expected)), effects_in_use([kind]):
        pass


def test_every_quantity_is_finite_at_rest() -> None:
    own = replace(signals(0), motor_angle=np.zeros(1500), joint_angle=np.zeros(1500))
    own = replace(own, motor=np.zeros(1500), joint=np.zeros(1500))
    for quantity in QUANTITIES.values():
        assert np.isfinite(quantity.values(own, "motor")).all()
