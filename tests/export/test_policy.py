"""Policies exported to C and to ONNX act as the library plays them."""

from __future__ import annotations

import ctypes
import dataclasses
import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cc_mujoco.control import Network, controller, read_policy, write_policy
from cc_mujoco.control import _guard as guard
from cc_mujoco.control._network import ACTIVATIONS
from cc_mujoco.device import DeviceModel, Drive, Observed, Plant, find_device
from cc_mujoco.device._sensors import WINDING_COLUMNS
from cc_mujoco.errors import CableError
from cc_mujoco.export._command import Export

COMPILER = shutil.which("gcc") or shutil.which("clang")


def network(observed: Observed, activation: str, squashed: bool) -> Network:
    random = np.random.default_rng(5)
    size = observed.space.shape[0]
    return Network(
        (
            random.normal(size=(16, size)) / 4.0,
            random.normal(size=(9, 16)) / 4.0,
            random.normal(size=(1, 9)),
        ),
        tuple(0.3 * random.normal(size=width) for width in (16, 9, 1)),
        activation,
        squashed,
        0.1 * random.normal(size=size),
        random.uniform(0.5, 2.0, size),
        5.0 if squashed else np.inf,
    )


def drive_of(scene: str) -> Drive:
    device = find_device(scene)
    made = DeviceModel(device.description, Plant(device).model())
    return made.drives(device.description.period)[0]


@pytest.fixture(scope="module")
def drive() -> Drive:
    return drive_of("wrist")


def written(
    folder: Path, drive: Drive, activation: str, squashed: bool, **past: Any
) -> str:
    assert drive.observed is not None
    observed = dataclasses.replace(drive.observed, **past)
    name = str(folder / "policy.safetensors")
    write_policy(name, network(observed, activation, squashed), observed)
    return name


@pytest.mark.skipif(COMPILER is None, reason="there is no C compiler")
@pytest.mark.parametrize(
    ("scene", "activation", "squashed", "past"),
    [
        pytest.param("wrist", "tanh", True, {"hold": 3}, marks=pytest.mark.study),
        # As `scripts/imitate.py` writes it; a lever, and the phase of the gait.
        ("ankle", "tanh", False, {"hold": 2, "history": 10, "memory": True}),
    ],
)
def test_a_policy_in_c_gives_the_bits_of_the_library_with_its_guard(
    scene: str, activation: str, squashed: bool, past: dict[str, Any], tmp_path: Path
) -> None:
    drive = drive_of(scene)
    policy = written(tmp_path, drive, activation, squashed, **past)
    Export(scene, policy, tmp_path / "c", no_check=True).run()
    library = shared(tmp_path / "c")
    memory = (ctypes.c_double * (library.cc_controller_size() // 8))()
    names, rows = columns(drive), motion(drive, 300)
    kind, found = ctypes.c_double * len(names), (ctypes.c_double * 1)()
    numbers = ctypes.c_double * len(guard.DriveLimits._fields)
    values = numbers(*numbers.in_dll(library, "cc_controller_parameters"))
    law: Any = controller(policy, drive)

    def step(row: np.ndarray, refused: int = 0) -> tuple[float, float]:
        """Return the torques of C and of the library."""
        assert library.cc_controller_step(memory, kind(*row), found) == refused
        return found[0], law.torque(dict(zip(names, map(float, row), strict=True)))

    for _ in range(2):
        law.reset()
        assert library.cc_controller_init(memory, values) == 0
        torques, states = [], []
        for row in rows:
            torques.append(step(row))
            states.append(law.axes[0].memory[0, guard.STATE])
        ours, theirs = np.array(torques).T
        assert np.array_equal(ours, theirs)
        free = np.array(states) == guard.FREE
        assert free[10:150].all() and np.ptp(theirs[free]) > 0.2 * drive.high
        assert guard.RELEASED in states and states[-1] == guard.STOPPED
    law.reset()
    library.cc_controller_reset(memory)
    # The first readings may be missing, too.
    for row in (np.full(len(names), np.nan), rows[0]):
        row[guard.READINGS : len(drive.observed.columns)] = 0.1  # type: ignore[union-attr]
        for place in others(drive):
            row[place] = rows[0, place]
        assert np.array_equal(*step(row))
    for place in others(drive):
        before = bytes(memory)
        for wild in (np.nan, np.inf, 1e308):
            row = rows[1].copy()
            row[place] = wild
            assert step(row, place + 1) == (0.0, 0.0)
        assert bytes(memory) == before
    assert np.array_equal(*step(rows[1]))
    place = guard.DriveLimits._fields.index("low")
    values[place] = values[place + 1] + 1.0
    assert library.cc_controller_set_parameters(memory, values) == place + 2


def columns(drive: Drive) -> tuple[str, ...]:
    """Return the readings of a policy in C."""
    assert drive.observed is not None
    return (*drive.observed.columns, *(WINDING_COLUMNS if drive.lever else ()))


def others(drive: Drive) -> list[int]:
    """Return the places of the readings at which no guard looks."""
    names = columns(drive)
    wound = ("joint_angle_rad", "joint_velocity_rad_s", "leverage_ratio")
    unread = ("phase_sine", "phase_cosine", *(wound if drive.lever else ()))
    return [names.index(name) for name in unread if name in names]


def motion(drive: Drive, count: int) -> np.ndarray:
    """Return measurements of a joint that swings; the second half has faults."""
    random, names = np.random.default_rng(6), columns(drive)
    time = drive.period * np.arange(count)
    angle = 0.4 * np.sin(20.0 * time)
    speed = 8.0 * np.cos(20.0 * time)
    torque = 0.1 * drive.safe_torque * np.sin(35.0 * time)
    rows = random.normal(size=(count, len(names))) * 1e-3
    for place, values in enumerate(
        (drive.ratio * angle, drive.ratio * speed, angle, speed, torque, 0.7 * torque)
    ):
        rows[:, place] += values
    if drive.lever:
        rows[:, -3:-1] = rows[:, 2:4]
        rows[:, -1] += 1.0 + 0.1 * np.cos(20.0 * time)
    rows[150:153, 0] = np.nan
    rows[160, 4] *= 50.0
    half = count // 2
    rows[half + 50 :, 4] += drive.safe_torque * np.linspace(0.0, 2.0, count - half - 50)
    return rows


def shared(folder: Path) -> ctypes.CDLL:
    path = folder / "shared.so"
    done = subprocess.run(
        [str(COMPILER), "-std=c99", "-O2", "-Wall", "-Werror", "-shared", "-fPIC",
         "-o", path,
         folder / "cc_parameters.c", folder / "cc_controller.c", "-lm"],
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    library = ctypes.CDLL(str(path))
    library.cc_controller_size.restype = ctypes.c_size_t
    return library


@pytest.mark.parametrize("activation", ACTIVATIONS)
def test_a_policy_in_onnx_acts_as_in_the_library(
    activation: str, tmp_path: Path, drive: Drive
) -> None:
    onnx = pytest.importorskip("onnx")
    reference = pytest.importorskip("onnx.reference")
    squashed = activation != "identity"
    policy = written(tmp_path, drive, activation, squashed, history=1, memory=True)
    Export("wrist", policy, tmp_path / "out", target="onnx").run()
    model = onnx.load(tmp_path / "out" / "policy.onnx")
    net, (observed,) = read_policy(policy)
    (about,) = model.metadata_props
    told = json.loads(about.value)["observed"]
    assert about.key == "cc_mujoco" and Observed.from_dict(told[0]) == observed
    size = net.mean.size
    seen = np.random.default_rng(7).normal(size=(50, size)).astype(np.float32) * 3.0
    wanted = np.array([net(row.astype(np.float64)) for row in seen])
    assert np.ptp(wanted) > 0.5
    runs = [reference.ReferenceEvaluator(model).run]
    try:
        import onnxruntime
    except ImportError:  # the reference does
        pass
    else:
        path = str(tmp_path / "out" / "policy.onnx")
        session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
        runs.append(session.run)
    for run in runs:
        (given,) = run(None, {"observation": seen})
        assert given.dtype == np.float32 and given.shape == (50, 1)
        assert np.abs(given - wanted).max() < 2e-7


def test_what_is_no_policy_for_an_export_is_said(tmp_path: Path, drive: Drive) -> None:
    with pytest.raises(CableError, match="--target onnx is for policies, files that"):
        Export("wrist", "pi", tmp_path / "out", target="onnx").run()
    policy = written(tmp_path, drive, "tanh", True)
    with pytest.raises(CableError, match="was trained for the device wrist"):
        Export("finger", policy, tmp_path / "out", no_check=True).run()
    assert not (tmp_path / "out").exists()
