"""Imitation of a controller that knows the plants, `scripts/imitate.py`."""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from pathlib import Path

import imitate
import numpy as np
import pytest
import train_policy

from cc_mujoco.benchmark import trained_on
from cc_mujoco.control import Network, read_policy
from cc_mujoco.simulation._worn_device import Ranges


def classroom(scene: str, seconds: float = 0.02) -> imitate.Classroom:
    """Return a few short environments of the script."""
    options = argparse.Namespace(
        scene=scene,
        envs=4,
        seconds=seconds,
        fixed=False,
        smoothness=0.0,
    )
    observed = imitate.observation(imitate.HOLD)
    env = train_policy.make(options, imitate.RANGES, observed)[0]
    return imitate.Classroom(env, 0)


def test_the_teacher_knows_the_plant_of_every_environment() -> None:
    env = classroom("exosuit").env
    law = imitate.teacher(env)
    for plant, of_axes in zip(env.plants, law.laws, strict=True):
        for own, names in zip(of_axes.laws, env.exo.device.driven, strict=True):
            known = [one.cable for one in own.drive.cables]
            assert known == [plant.cables[name] for name in names]


def test_the_bench_plays_the_motions_of_its_other_training() -> None:
    assert imitate.motions(train_policy.BENCH) == train_policy.PLAYED["bench"]
    assert imitate.structure(train_policy.bench())


@pytest.mark.parametrize("scene", ["wrist", "exosuit"])
def test_every_effect_is_in_some_plants_alone_and_in_all_cables(scene: str) -> None:
    device = train_policy.device_of(scene)
    effects = imitate.structure(device)
    ranges = {name: own for each in effects.values() for name, own in each.items()}
    fewer = imitate.structure(device, ["viscous"])
    assert fewer == {name: own for name, own in effects.items() if name != "viscous"}
    assert {"viscous_friction", "bristle_length", "stribeck_friction"} <= {
        name.partition(".")[2] for name in ranges
    }
    drawn = Ranges(ranges, device)
    random = np.random.default_rng(0)
    plants = [drawn.draw(random, {}) for _ in range(400)]
    for name, (low, high, _) in ranges.items():
        assert all(low <= p.values.get(name, low) <= high for p in plants)
        share = np.mean([name in plant.values for plant in plants])
        assert share == pytest.approx(imitate.PROBABILITY, abs=0.06)
    slid = [n for n in ranges if n.endswith(".bristle_length")]
    assert all(len(set(slid) & p.values.keys()) in (0, len(slid)) for p in plants)


def test_a_third_of_the_motions_tremble_at_every_axis() -> None:
    device = train_policy.device_of("exosuit")
    (_, _, often), (tremor, _, seldom) = imitate.motions("exosuit")
    assert (often, seldom) == (2, 1)
    moved = tremor.sample(2.0, 1e-3, np.random.default_rng(0)).companions
    for axis, (joint, shaken) in zip(
        device.description.axes, tremor.parts, strict=True
    ):
        motion = shaken.base.sample(2.0, 1e-3, np.random.default_rng(0))
        still = motion.companions.get(joint, motion)
        off = moved[joint].angle - still.angle
        assert joint == axis.limb
        assert np.ptp(off[1000:]) == pytest.approx(0.1 * axis.reach, rel=0.05)


@pytest.mark.parametrize("scene", ["finger", "exosuit"])
def test_samples_are_what_the_student_sees_and_what_the_teacher_does(
    scene: str,
) -> None:
    room = classroom(scene)
    seen, taught, errors = room.play()
    axes = len(room.env.exo.observed)
    size = sum(own.space.shape[0] for own in room.env.exo.observed)
    steps = round(0.02 / 1e-3) // imitate.HOLD
    assert seen.shape == (room.env.num_envs * steps, size)
    assert taught.shape == (len(seen), axes)
    assert errors.shape == (axes,) and np.isfinite(errors).all()
    # Every frame of the history ends with the action that followed it.
    last = seen[-room.env.num_envs :, : room.env.exo.observed[0].space.shape[0]]
    frame = room.env.exo.observed[0].frame
    past = last[:, -(frame + 1) * imitate.HISTORY :]
    earlier = taught[-2 * room.env.num_envs : -room.env.num_envs, 0]
    assert past[:, frame] == pytest.approx(earlier)


def test_a_student_plays_some_environments_alone() -> None:
    room = classroom("finger")
    played: list[np.ndarray] = []
    step = room.env.step

    def watched(actions: np.ndarray) -> object:
        played.append(actions.copy())
        return step(actions)

    room.env.step = watched  # type: ignore[method-assign]
    for _ in range(2):  # the second begins with the `info` of an end
        played.clear()
        room.play(lambda seen: np.full((len(seen), 1), 0.25, np.float32))
    alone = np.all(np.array(played) == 0.25, axis=(0, 2))
    assert alone.sum() == room.env.num_envs // 2


def test_the_script_writes_a_policy_that_reads_what_the_student_saw(
    tmp_path: Path,
) -> None:
    script = Path(imitate.__file__)
    words = [sys.executable, str(script), "--scene", "finger", "--out", str(tmp_path)]
    more = ["--rounds", "3", "--updates", "5", "--envs", "6", "--seconds", "0.6"]
    more += ["--without", "viscous"]
    done = subprocess.run(
        [*words, *more], check=True, capture_output=True, cwd=script.parents[1]
    )
    teacher, *rounds, kept, written = done.stdout.decode().splitlines()
    errors = [[float(x) for x in re.findall("([0-9.]+) N m", line)] for line in rounds]
    reachable = [float(x) for x in re.findall("([0-9.]+) N m", teacher)]
    assert len(errors) == 3 and len(reachable) == 2
    best = int(np.argmin(np.mean(np.divide(errors, reachable), axis=1)))
    assert kept.startswith(f"round {best + 1} is kept: ")
    assert rounds[best].startswith(f"round {best + 1} of 3, RMS torque error: own moti")
    assert "--controller" in written
    network, observed = read_policy(tmp_path / "0.safetensors")
    room = classroom("finger")
    assert tuple(observed) == room.env.exo.observed
    assert network.motors == 1
    again = subprocess.run(words, capture_output=True, cwd=script.parents[1])
    assert b"is there already" in again.stderr
    stated = trained_on(str(tmp_path / "0.safetensors")).split(", ")
    assert {"presliding", "tremor"} <= set(stated) and "viscous" not in stated


def test_a_network_of_the_file_acts_like_the_student() -> None:
    random = np.random.default_rng(0)
    seen = random.normal(2.0, 3.0, (200, 5)).astype(np.float32)
    taught = (0.02 * seen[:, :2] + 0.1).astype(np.float32)
    student = imitate.Student(seen, taught, 0)
    before = student.fit(seen, taught, 5, (1e-3, 1e-3), 1024)
    assert student.fit(seen, taught, 50, (1e-2, 0.0), 1024) < before
    network: Network = student.network()
    for row, own in zip(seen[:20], student(seen[:20]), strict=True):
        assert network(row.astype(float)) == pytest.approx(own, abs=1e-6)


def test_a_student_follows_the_slope_of_its_loss() -> None:
    random = np.random.default_rng(1)
    seen = random.normal(size=(40, 3)).astype(np.float32)
    student = imitate.Student(seen, seen[:, :2], 0)
    values = student._values

    def loss() -> tuple[float, np.ndarray]:
        outputs = student._outputs(seen)
        return 0.5 * float(np.square(outputs[-1], dtype=float).sum()), outputs[-1]

    slope = student._slope(student._outputs(seen), loss()[1])
    for place in random.integers(values.size, size=20):
        kept, ends = values[place], []
        for change in (-1e-2, 1e-2):
            values[place] = kept + np.float32(change)
            ends.append(loss()[0])
        values[place] = kept
        assert slope[place] == pytest.approx((ends[1] - ends[0]) / 2e-2, abs=2e-2)


def test_numbers_of_which_nothing_is_learnt_are_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["imitate.py", "--rounds", "0"])
    with pytest.raises(SystemExit):
        imitate.main()
    assert "--rounds must be above 0" in capsys.readouterr().err
