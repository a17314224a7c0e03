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
from cc_mujoco.control._policy import ACTIVATIONS
from cc_mujoco.device import DeviceModel, Drive, Observed, find_device
from cc_mujoco.device._device import bare_model
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


@pytest.fixture(scope="module")
def drive() -> Drive:
    device = find_device("wrist")
    made = DeviceModel(device.description, bare_model(device).compile())
    return made.drives(device.description.period)[0]


def written(
    folder: Path, drive: Drive, activation: str, squashed: bool, **past: Any
) -> str:
    assert drive.observed is not None
    observed = dataclasses.replace(drive.observed, **past)
    name = str(folder / "policy.safetensors")
    write_policy(name, network(observed, activation, squashed), observed)
    return name


@pytest.mark.skipif(COMPILER is None, reason="there is no C compiler")
def test_a_policy_in_c_acts_as_in_the_library(tmp_path: Path, drive: Drive) -> None:
    rows = motion(drive, 300)
    for name, activation, squashed, past in (
        ("past", "tanh", True, {"hold": 3, "history": 2, "memory": True}),
        ("plain", "relu", False, {}),
        # As `scripts/imitate.py` writes it.
        ("taught", "tanh", False, {"hold": 2, "history": 10, "memory": True}),
    ):
        folder = tmp_path / name
        folder.mkdir()
        policy = written(folder, drive, activation, squashed, **past)
        Export("wrist", policy, folder / "c", no_check=True).run()
        library = shared(folder / "c")
        memory = (ctypes.c_double * (library.cc_controller_size() // 8))()
        kind, found = ctypes.c_double * len(rows[0]), (ctypes.c_double * 1)()
        values = (ctypes.c_double * 4)(
            *(ctypes.c_double * 4).in_dll(library, "cc_controller_parameters")
        )
        law = controller(policy, drive)
        for _ in range(2):
            law.reset()
            assert library.cc_controller_init(memory, values) == 0
            torques = []
            for row in rows:
                seen = dict(zip(columns(drive), row, strict=True))
                library.cc_controller_step(memory, kind(*row), found)
                torques.append((found[0], law.torque(seen)))
        ours, theirs = np.array(torques).T
        assert np.ptp(theirs) > 0.2 * drive.high
        assert np.abs(ours - theirs).max() < 2e-7 * drive.high
        before = bytes(memory)
        for wild in (np.nan, np.inf, 1e308):
            row = [wild, *rows[0][1:]]
            assert library.cc_controller_step(memory, kind(*row), found) == 1
            seen = dict(zip(columns(drive), row, strict=True))
            assert found[0] == law.torque(seen) == 0.0
        assert bytes(memory) == before
        seen = dict(zip(columns(drive), rows[0], strict=True))
        assert library.cc_controller_step(memory, kind(*rows[0]), found) == 0
        assert abs(found[0] - law.torque(seen)) < 2e-7 * drive.high
        values[0] = values[1] + 1.0
        assert library.cc_controller_set_parameters(memory, values) == 2


def columns(drive: Drive) -> tuple[str, ...]:
    assert drive.observed is not None
    return drive.observed.columns


def motion(drive: Drive, count: int) -> list[list[float]]:
    """Return measurements of a joint that swings, with noise."""
    random = np.random.default_rng(6)
    time = drive.period * np.arange(count)
    angle = 0.4 * np.sin(20.0 * time)
    speed = 8.0 * np.cos(20.0 * time)
    torque = np.sin(35.0 * time)
    about = [
        drive.ratio * angle,
        drive.ratio * speed,
        angle,
        speed,
        torque,
        0.7 * torque,
    ]
    rows = np.array(about).T + random.normal(size=(count, 6)) * 1e-3
    return [list(map(float, row)) for row in rows]


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
