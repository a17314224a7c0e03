"""The command: whole data sets, the same each time, that do not betray their label."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from rig import dataset, generate, strength
from rig.makes import MAKES
from rig.trials import SETS, Trial, ramps

EFFECTS = MAKES["bristles"].effects

OPTIONS = ["--trials", "ramps", "--seed", "4"]


@pytest.fixture(autouse=True, scope="module")
def two_trials(shortened: Callable[[Trial, float], Trial]) -> Iterator[None]:
    """Two trials of 2.5 s instead of eight of 8 s, which is quicker."""
    strength.forget()
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(
            SETS,
            "ramps",
            lambda rng: [shortened(each, 2.5) for each in ramps(rng)[1:3]],
        )
        patch.setitem(strength.LOOKED_AT, "ramps", (0,))
        yield
    strength.forget()


def made(folder: Path, effect: str, strength: str = "3") -> Path:
    generate.main(
        ["--out", str(folder), "--effect", effect, "--strength", strength, *OPTIONS]
    )
    return folder


@pytest.fixture(scope="module")
def nothing(two_trials: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a data set without hidden effects."""
    return made(tmp_path_factory.mktemp("nothing") / "set", "none")


@pytest.fixture(scope="module")
def two(two_trials: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One that hides two effects, in a folder that was not there."""
    folder = tmp_path_factory.mktemp("two") / "new" / "set"
    return made(folder, "joint_gravity,torque_sensor_gain")


@pytest.mark.study
def test_data_betray_nothing_but_their_numbers(nothing: Path, two: Path) -> None:
    plain, hidden = nothing / "data", two / "data"
    names = sorted(path.name for path in plain.iterdir())
    assert names == ["dataset.toml", "trial_00.csv", "trial_01.csv"]
    assert sorted(path.name for path in hidden.iterdir()) == names
    assert (plain / names[0]).read_text() == (hidden / names[0]).read_text()
    for name in names[1:]:
        one, other = (
            (folder / name).read_text().splitlines() for folder in (plain, hidden)
        )
        assert one[0] == other[0]
        assert len(one) == len(other) == 1251
        for left, right in zip(one[1:50], other[1:50], strict=True):
            shape = [len(text.split(".")[-1]) for text in left.split(",")]
            assert shape == [len(text.split(".")[-1]) for text in right.split(",")]
        assert one[1:] != other[1:]
    everything = "".join(path.read_text() for path in hidden.iterdir())
    assert not any(name in everything for name in EFFECTS)


def test_label_says_what_is_hidden(two: Path) -> None:
    assert sorted(path.name for path in two.parent.iterdir()) == ["set"]
    label = json.loads((two / "sealed" / "label.json").read_text())
    effect, other = label["effects"]
    assert (effect["id"], other["id"]) == ("joint_gravity", "torque_sensor_gain")
    assert other["strength"]["refit"] == pytest.approx(3, rel=0.1)
    assert effect["unit"] == "N m"
    assert effect["strength"]["refit"] == pytest.approx(3, rel=0.1)
    assert effect["details"]["unbalance"] == effect["amount"]
    assert label["rig"]["seed"] == label["seed"] == 4


def test_files_hold_what_the_function_returns(nothing: Path) -> None:
    table = np.loadtxt(nothing / "data" / "trial_01.csv", delimiter=",", skiprows=1)
    rig = generate.make_rig(4)
    columns = dataset.make_dataset(rig, {}, "ramps", seed=4)[1]
    assert np.abs(table - np.stack(list(columns.values()), axis=1)).max() < 1e-6


def test_same_seed_same_bytes(nothing: Path, tmp_path: Path) -> None:
    again = made(tmp_path / "again", "none")
    for path in nothing.rglob("*.*"):
        assert path.read_bytes() == (again / path.relative_to(nothing)).read_bytes()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--effect", "magic"], "no effect 'magic'; there are none, viscous_friction"),
        (["--strength", "-1"], "finite and not negative"),
        (["--strength", "nan"], "finite and not negative"),
        (["--trials", "poor"], "invalid choice"),
    ],
)
def test_bad_options_are_one_sentence(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    options: list[str],
    said: str,
) -> None:
    with pytest.raises(SystemExit) as stop:
        generate.main(["--out", str(tmp_path / "x"), *options])
    assert stop.value.code == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "x").exists()


def test_nothing_is_overwritten_or_left_half_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(SystemExit):
        generate.main(["--out", str(tmp_path)])

    def fail(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(generate, "label_of", fail)
    with pytest.raises(KeyboardInterrupt):
        made(tmp_path / "x", "none")
    assert list(tmp_path.iterdir()) == []
