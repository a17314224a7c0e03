#!/usr/bin/env python3
"""Angle errors of position controllers on plants that differ from their trial.

    python scripts/benchmarks/check_position.py

Every plant is an endoscope whose friction, stiffness, pretension and wrap are drawn by
its seed, in the scatter of the benchmark. Controllers have the parameters of the
scene's own trial (`stale`), or of a trial on the plant itself (`fitted anew`); the data
sheet is that of the scene either way. Conditions multiply friction or wrap, or add
seals at both ends of the sheath, which no model has.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from cc_mujoco.control import (
    FITTED,
    Controller,
    controller,
    fit_hysteresis,
)
from cc_mujoco.device import DeviceModel, Drive, Plant, find_device
from cc_mujoco.report._markdown import table
from cc_mujoco.simulation import calibration_trials, simulate

SCENE, CABLE = "endoscope", "tendon"
WARM_UP = 500
"""Control steps that are not scored."""
SPREAD = {
    "friction": 0.15,
    "axial_stiffness": 0.1,
    "pretension": 0.2,
    "wrap": 0.1,
}
"""Relative standard deviations of what is drawn."""
CONDITIONS: dict[str, dict[str, float]] = {
    "as drawn": {},
    "friction doubled": {"friction": 2.0},
    "bends halved": {"wrap": 0.5},
    "seals of 0.4 N": {"seal": 0.4},
}
"""Factors of friction and wrap, and the drag of either seal [N]."""


def drawn_plant(seed: int, changes: dict[str, float]) -> Plant:
    """Return the plant of a seed in a condition."""
    cable = find_device(SCENE).cables[CABLE]
    random = np.random.default_rng([seed, 7])
    values: dict[str, Any] = {}
    for name, spread in SPREAD.items():
        factor = 1.0 + spread * float(np.clip(random.normal(), -2.0, 2.0))
        nominal = float(getattr(cable, name))
        values[f"{CABLE}.{name}"] = factor * changes.get(name, 1.0) * nominal
    if seal := changes.get("seal"):
        for end in ("proximal", "distal"):
            values[f"{CABLE}.seal_{end}"] = seal
    return Plant(SCENE, values)


def drive_of(plant: Plant) -> Drive:
    """Return what is known of a plant."""
    return DeviceModel(plant.description, plant.model()).drives(1e-3)[0]


def errors_of(
    plants: list[Plant],
    name: str,
    fits: dict[str, dict[str, Any]],
    duration: float,
) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Return RMS and peak errors of every plant (plants, 2) [deg].

    Args:
        plants: The plants.
        name: Of the controller.
        fits: Parameters by the cables of a plant; those of the scene where it is empty.
        duration: Of an episode [s].
    """
    nominal = drive_of(Plant(SCENE))

    def make(drive: Drive) -> Controller:
        own = fits.get(repr(drive.cable_drives[0]), nominal.hysteresis)
        known = nominal.cable_drives
        return controller(
            name, dataclasses.replace(drive, cable_drives=known, hysteresis=own)
        )

    sensing = dataclasses.replace(
        plants[0].description.sensing, joint_sensor=name == "distal_feedback"
    )
    made: Callable[[Drive], Controller] = make
    logs = simulate(
        plants,
        made,
        seed=list(range(len(plants))),
        duration=duration,
        sensing=sensing,
    )
    found = []
    for log in logs:
        error = np.degrees(log["joint_angle_rad"] - log["reference_angle_rad"])
        scored = error[WARM_UP:]
        found.append((np.sqrt(np.mean(scored**2)), np.abs(scored).max()))
    return np.array(found)


def main() -> None:
    """Play all and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--duration", type=float, default=1.5)
    parser.add_argument("--trial", type=float, default=4.0)
    options = parser.parse_args()
    plants = [
        drawn_plant(seed, changes)
        for changes in CONDITIONS.values()
        for seed in range(options.seeds)
    ]
    nominal, fresh = drive_of(Plant(SCENE)), {}
    trials = calibration_trials(plants, options.trial)
    for plant, trial in zip(plants, trials, strict=True):
        key = repr(drive_of(plant).cable_drives[0])
        fresh[key] = fit_hysteresis(trial, nominal)
    shown: list[tuple[str, str, dict[str, dict[str, Any]]]] = [("none", "", {})]
    for name in reversed(FITTED):
        shown += [(name, "stale", {}), (name, "fitted anew", fresh)]
    shown.append(("distal_feedback", "fitted anew", fresh))
    rows = []
    for name, kind, fits in shown:
        errors = errors_of(plants, name, fits, options.duration)
        each = errors.reshape(len(CONDITIONS), options.seeds, 2)
        cells = [
            f"{rms.mean():.2f} ± {rms.std(ddof=1) if rms.size > 1 else 0.0:.2f}, "
            f"{peak.mean():.1f}"
            for rms, peak in each.transpose(0, 2, 1)
        ]
        rows.append([f"`{name}`", kind, *cells])
        print(rows[-1], flush=True)
    print(table(["controller", "parameters", *CONDITIONS], rows))


if __name__ == "__main__":
    main()
