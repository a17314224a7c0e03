"""Policies: played as their environment would, read from files that execute nothing."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from cc_mujoco.assets import POLICIES, policy_file
from cc_mujoco.control import (
    Controller,
    Network,
    axes_controller,
    controller,
    read_policy,
    write_policy,
)
from cc_mujoco.control import _guard as guard
from cc_mujoco.control._cable_model import joint_spring
from cc_mujoco.control._controller import motor_limits
from cc_mujoco.device import CableDrive, Drive, Observed, find_device
from cc_mujoco.device._sensors import MEASURED_COLUMNS
from cc_mujoco.envs import IDS as ENVIRONMENTS
from cc_mujoco.errors import CableError
from cc_mujoco.simulation import simulate
from control.devices import cable

IDS = list(ENVIRONMENTS)
WRIST = "cc_mujoco/WristHandle-v1"
UNITS = (0.02, 2.0, 0.5, 2.0, 1.0, 1.0)
OBSERVED = Observed("wrist", MEASURED_COLUMNS[:6], UNITS, 5.2, 1e-3, 1.0, 2, 3, True)
DRIVE = Drive(5.2, -1.0, 1.0, 1e-3, observed=OBSERVED)


def network(*observed: Observed, squashed: bool = True, seed: int = 0) -> Network:
    """Return a network with a hidden layer for the observation of all axes."""
    random = np.random.default_rng(seed)
    size, axes = sum(own.space.shape[0] for own in observed), len(observed)
    return Network(
        (random.normal(size=(8, size)), random.normal(size=(axes, 8))),
        (random.normal(size=8), random.normal(size=axes)),
        "tanh",
        squashed,
        random.normal(size=size),
        random.uniform(0.5, 2.0, size),
        5.0,
    )


def written(path: Path, *observed: Observed, **given: Any) -> str:
    """Return the file of a network."""
    name = str(path / "policy.safetensors")
    write_policy(name, network(*observed, **given), observed)
    return name


@pytest.mark.parametrize("name", ["policy.zip", "policy", "policy.pt"])
def test_a_policy_is_written_to_no_other_kind_of_file(
    tmp_path: Path, name: str
) -> None:
    path = tmp_path / name
    with pytest.raises(CableError, match=rf"as \*\.safetensors, not to '.*{name}'"):
        write_policy(path, network(OBSERVED), OBSERVED)
    assert not path.exists()


@pytest.mark.parametrize("name", IDS)
def test_a_policy_acts_as_its_network_in_its_environment(
    name: str, tmp_path: Path
) -> None:
    past = {"hold": 4, "history": 2, "memory": True}
    env = gymnasium.make(name, disable_env_checker=True, duration=0.2, **past)
    plain = gymnasium.make(name, disable_env_checker=True, duration=0.2)
    inner: Any = env.unwrapped
    device = plain.unwrapped.exo.device  # type: ignore[attr-defined]
    # Random torques are not safe ones.
    drives = [
        dataclasses.replace(own, safe_torque=np.inf)
        for own in plain.unwrapped.drives  # type: ignore[attr-defined]
    ]
    net, law = (
        network(*inner.exo.observed),
        axes_controller(
            written(tmp_path, *inner.exo.observed), drives, device.prefixes
        ),
    )
    for seed in (3, 4):
        law.reset()
        seen, _ = env.reset(seed=seed)
        _, info = plain.reset(seed=seed)
        over = False
        while not over:
            share = net(seen.astype(float)).astype(np.float32)
            seen, *_, over, truth = env.step(share)
            for _ in range(4):
                torque = law.torque(info)
                action = plain.unwrapped.action(torque)  # type: ignore[attr-defined]
                assert action == pytest.approx(share, rel=1e-6, abs=1e-7)
                *_, info = plain.step(action)
            for prefix in device.prefixes:
                name = f"{prefix}joint_torque_nm"
                assert info[name] == pytest.approx(truth[name])


def test_one_of_many_is_played_as_if_it_were_alone(tmp_path: Path) -> None:
    name, random = written(tmp_path, OBSERVED), np.random.default_rng(0)
    together = controller(name, DRIVE)
    alone = [controller(name, DRIVE) for _ in range(3)]
    for step in range(20):
        many = {column: random.normal(size=3) for column in MEASURED_COLUMNS}
        if step == 7:  # one of them begins anew
            together.reset(np.array([False, True, False]))
            alone[1].reset()
        found = together.torque(many)
        for row, law in enumerate(alone):
            one = {column: float(values[row]) for column, values in many.items()}
            assert law.torque(one) == found[row]


def played(law: Controller, rows: np.ndarray) -> np.ndarray:
    """Return the torques for measurements (samples, 6), one after the other."""
    names = MEASURED_COLUMNS[:6]
    return np.array(
        [law.torque(dict(zip(names, row.tolist(), strict=True))) for row in rows]
    )


def guarded_drive(**given: Any) -> Drive:
    """Return a drive with cables and a safe torque that its motor can exceed."""
    ends = (-0.02, -0.104), (0.02, 0.104)
    cables = tuple(CableDrive(cable(), *own) for own in ends)
    limits = {"safe_torque": 4.0, "inertia": 1e-3, "observed": OBSERVED}
    return Drive(5.2, -9.0, 9.0, 1e-3, cables=cables, **{**limits, **given})


def test_a_policy_lets_an_unsafe_joint_go_until_a_reset(tmp_path: Path) -> None:
    drive = guarded_drive()
    observed = dataclasses.replace(OBSERVED, torque=9.0)
    drive = dataclasses.replace(drive, observed=observed)
    law = controller(written(tmp_path, OBSERVED), drive)
    rows = 1e-6 * np.random.default_rng(0).normal(size=(120, 6))  # none is frozen
    rows[:, 1], rows[:, 3] = 0.01, 0.0  # the motor runs away from the joint, slowly
    times = [0, 20, 40, 60, 120]
    rows[:, 4] += np.interp(np.arange(120), times, [0.0, 0.0, 3.0, 0.0, 6.0])
    torques = played(law, rows)
    limits = motor_limits(drive)
    most = guard.command_limit(limits, joint_spring(drive.cables, limits))
    assert most < drive.high and np.abs(torques).max() == most
    let_go = torques == torques[39]
    assert -0.01 < torques[39] < 0.0
    assert not let_go[:20].any() and let_go[36:42].all() and not let_go[60]
    assert let_go[110:].all() and (played(law, rows[:20]) == torques[39]).all()
    law.reset()
    assert np.array_equal(played(law, rows), torques)


def test_a_policy_rides_through_missing_readings_and_then_is_limp(
    tmp_path: Path,
) -> None:
    name, random = written(tmp_path, OBSERVED), np.random.default_rng(0)
    rows = 1e-3 * random.normal(size=(40, 6))
    held = rows.copy()
    rows[10:13], held[10:13] = np.nan, rows[9]
    wanted = played(controller(name, DRIVE), held)
    assert np.array_equal(played(controller(name, DRIVE), rows), wanted)
    rows[20:26] = np.nan
    late = np.vstack([np.full((3, 6), np.nan), held])
    assert (played(controller(name, DRIVE), rows)[25:] == 0.0).all()
    began = played(controller(name, DRIVE), late)
    assert (began[:3] == 0.0).all() and np.array_equal(began[3:], wanted)


def test_a_policy_that_follows_an_angle_has_no_limit_of_torque(tmp_path: Path) -> None:
    observed = OBSERVED.with_reference()
    drive = guarded_drive(commands_angle=True, observed=observed)
    law = controller(written(tmp_path, observed), drive)
    seen = dict.fromkeys(observed.columns, 0.0) | {"joint_torque_nm": 50.0}
    before = [law.torque(seen) for _ in range(40)]
    law = controller(
        str(tmp_path / "policy.safetensors"),
        dataclasses.replace(drive, safe_torque=np.inf),
    )
    assert before == [law.torque(seen) for _ in range(40)]


def test_a_motor_that_is_limited_gives_less_and_not_a_share_of_less(
    tmp_path: Path,
) -> None:
    name, random = written(tmp_path, OBSERVED), np.random.default_rng(0)
    full = controller(name, DRIVE)
    limited = controller(name, Drive(5.2, -0.4, 0.4, 1e-3, observed=OBSERVED))
    clipped = 0
    for _ in range(20):
        seen = {column: float(random.normal()) for column in MEASURED_COLUMNS}
        own = full.torque(seen)
        assert limited.torque(seen) == min(max(own, -0.4), 0.4)
        clipped += abs(own) > 0.4
    assert 0 < clipped < 20


def test_a_file_gives_back_what_was_written(tmp_path: Path) -> None:
    name = written(tmp_path, OBSERVED, squashed=False)
    found, observed = read_policy(name)
    own = network(OBSERVED, squashed=False)
    assert observed == (OBSERVED,)
    assert found.far == 5.0
    for x in np.random.default_rng(1).normal(size=(5, own.mean.size)):
        assert found(x) == own(x)


@pytest.mark.parametrize("single", [True, False])
def test_numbers_that_fit_in_32_bits_take_no_more(tmp_path: Path, single: bool) -> None:
    own = network(OBSERVED)
    if single:
        rounded = tuple(np.float32(each).astype(float) for each in own.weights)
        own = dataclasses.replace(own, weights=rounded)
    write_policy(tmp_path / "p.safetensors", own, OBSERVED)
    content = (tmp_path / "p.safetensors").read_bytes()
    assert (b'"F32"' in content) is single
    found, _ = read_policy(tmp_path / "p.safetensors")
    for mine, theirs in zip(own.weights, found.weights, strict=True):
        assert np.array_equal(mine, theirs)


@pytest.mark.parametrize("name", POLICIES)
def test_a_policy_of_the_package_plays_its_device(name: str) -> None:
    assert policy_file(name).stat().st_size < 200_000
    log = simulate(Path(name).stem, name, duration=0.1)
    for axis in ("hip.", "ankle.") if name.startswith("exosuit") else ("",):
        assert np.isfinite(log[f"{axis}joint_torque_nm"]).all()


def test_a_policy_here_comes_before_one_of_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "wrist.safetensors").write_bytes(b"mine")
    with pytest.raises(CableError, match=r"'wrist\.safetensors' is not one that"):
        controller("wrist.safetensors", DRIVE)
    with pytest.raises(CableError, match="no such file, and the package has wrist"):
        controller("wirst.safetensors", DRIVE)


def test_the_file_is_one_of_safetensors(tmp_path: Path) -> None:
    numpy = pytest.importorskip("safetensors.numpy")
    name = written(tmp_path, OBSERVED)
    tensors, own = numpy.load_file(name), network(OBSERVED)
    assert np.array_equal(tensors["0.weight"], own.weights[0])
    assert np.array_equal(tensors["deviation"], own.deviation)
    assert set(tensors) == {"mean", "deviation"} | {
        f"{layer}.{kind}" for layer in (0, 1) for kind in ("weight", "bias")
    }


def test_a_policy_of_another_device_is_refused_with_both_names(tmp_path: Path) -> None:
    drives = {
        name: gymnasium.make(name, disable_env_checker=True).unwrapped.drive  # type: ignore[attr-defined]
        for name, device in ENVIRONMENTS.items()
        if len(find_device(device).description.axes) == 1
    }
    for name, own in drives.items():
        path = written(tmp_path, own.observed)
        for other, drive in drives.items():
            if other == name:
                controller(path, drive)
                continue
            with pytest.raises(CableError) as caught:
                controller(path, drive)
            for device in (own.observed.device, drive.observed.device):
                assert device in str(caught.value)


def test_a_policy_for_other_samples_or_no_environment_is_refused(
    tmp_path: Path,
) -> None:
    path = written(tmp_path, OBSERVED)
    slow = Drive(5.2, -1.0, 1.0, 2e-3, observed=OBSERVED)
    with pytest.raises(CableError, match=r"1 ms, but is called every 2 ms; .*hold=1"):
        controller(path, slow)
    with pytest.raises(CableError, match="observed"):
        controller(path, Drive(5.2, -1.0, 1.0, 1e-3))
    with pytest.raises(CableError, match="joint_sensor = true"):
        controller(path, dataclasses.replace(DRIVE, joint_sensor=False))


def test_a_network_that_does_not_fit_is_refused(tmp_path: Path) -> None:
    small = Observed("wrist", MEASURED_COLUMNS[:6], UNITS, 5.2, 1e-3, 1.0)
    with pytest.raises(CableError, match=r"for 33 numbers, but 6 are observed"):
        write_policy(tmp_path / "p.safetensors", network(OBSERVED), small)
    one, two = np.ones((1, 2)), np.ones((2, 3))
    for weights, biases, words in (
        ((two, one), (np.ones(2), np.ones(2)), "does not follow"),
        ((one,), (np.ones(1),), "does not follow 3"),
        ((two, one * np.nan), (np.ones(2), np.ones(1)), "finite"),
    ):
        with pytest.raises(CableError, match=words):
            Network(weights, biases, "tanh", False, np.zeros(3), np.ones(3))
    with pytest.raises(CableError, match="unknown activation"):
        Network((one,), (np.ones(1),), "gelu", False, np.zeros(2), np.ones(2))
    with pytest.raises(CableError, match="above 0"):
        Network((one,), (np.ones(1),), "tanh", False, np.zeros(2), np.zeros(2))


def test_files_that_are_no_policy_are_one_sentence(tmp_path: Path) -> None:
    good = Path(written(tmp_path, OBSERVED)).read_bytes()
    length = int.from_bytes(good[:8], "little")
    header = json.loads(good[8 : 8 + length])

    def again(**about: Any) -> bytes:
        meta = json.loads(header["__metadata__"]["cc_mujoco"])
        meta["observed"][0] |= about
        changed = {**header, "__metadata__": {"cc_mujoco": json.dumps(meta)}}
        text = json.dumps(changed).encode()
        return len(text).to_bytes(8, "little") + text + good[8 + length :]

    path = tmp_path / "bad.safetensors"
    for content in (
        b"",
        b"hello",
        good[:-8],
        good[: 8 + length],
        b"\xff" * 8 + good[8:],
        (2).to_bytes(8, "little") + b"{}",
        good.replace(b"F64", b"F32"),
        good.replace(b'"hold', b'"held'),
        again(history=4),
        again(period=-1.0),
        again(columns=["a"]),
    ):
        path.write_bytes(content)
        with pytest.raises(CableError, match=r"bad\.safetensors") as caught:
            controller(str(path), DRIVE)
        assert str(caught.value).endswith(".")


def test_a_policy_of_all_axes_is_refused_for_one_and_the_reverse(
    tmp_path: Path,
) -> None:
    two = written(tmp_path, OBSERVED, OBSERVED)
    assert len(read_policy(two)[1]) == 2
    with pytest.raises(CableError, match="drives 2 axes at once, and is given one"):
        controller(two, DRIVE)
    law = axes_controller(two, (DRIVE, DRIVE), ("hip.", "ankle."))
    columns = [f"{p}{c}" for p in ("hip.", "ankle.") for c in MEASURED_COLUMNS]
    many = {name: np.random.default_rng(0).normal(size=3) for name in columns}
    assert law.torque(many).shape == (3, 2)
    law.reset()
    assert law.torque({name: float(v[0]) for name, v in many.items()}).shape == (2,)
    one = written(tmp_path, OBSERVED)
    with pytest.raises(CableError, match="drives one axis at once, and is given 2"):
        axes_controller(one, (DRIVE, DRIVE), ("hip.", "ankle."))
    with pytest.raises(CableError, match="must end in one for each motor, 1"):
        wide = dataclasses.replace(
            network(OBSERVED),
            weights=(network(OBSERVED).weights[0], np.ones((2, 8))),
            biases=(np.ones(8), np.ones(2)),
        )
        write_policy(tmp_path / "p.safetensors", wide, OBSERVED)
