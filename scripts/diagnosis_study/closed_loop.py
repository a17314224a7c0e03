"""Torque error of a controller before and after a diagnosis repairs its model.

    python scripts/diagnosis_study/closed_loop.py --seeds 1 2 --out runs/closed_loop

A rig with guides (`driven.py`) has a hidden effect. A controller that knows only the
scene `bench` plays a task on it, through the loop of `cc-mujoco run` with its limits
and its log, in lockstep. Then the same loop plays trials, the rich motions of `rig`, by
the servo that plays those of a plan; `cc-mujoco diagnose` names by their logs what is
missing, and the scene that it wrote goes into the controller, which plays the task
again. Errors are of the true joint torque. Finished cases are kept.
"""

from __future__ import annotations

import dataclasses
import math
import shutil
import time
import warnings
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from driven import Array, Bench, Lockstep, Swing, errors, play, rms
from kept_cases import complete, findings

from cc_mujoco import hardware
from cc_mujoco.assets import scene_path
from cc_mujoco.control import controller
from cc_mujoco.diagnosis import diagnose
from cc_mujoco.report import table
from rig.dataset import make_trials
from rig.engine import COMMAND_TIME
from rig.generate import facts_of
from rig.nominal import Rig, make_rig
from rig.strength import calibrate
from rig.trials import COMPLIANT, Trial

PERIOD, TRIAL_PERIOD = 0.0005, 0.001
"""Periods of the loop in the task and in the trials [s]."""
SECONDS, SETTLED = 12.0, 2.0
"""Length of the task, and time from which its error counts [s]."""
LIMITS = hardware.Limits(
    torque=10.0,
    torque_rate=1000.0,
    motor_speed=30.0,
    joint_range=(-2.5, 2.5),
    soft_start=0.5,
)
TURN = 2.0  # change of the motor's torque where it turns [N m]: about its friction
FRICTION = "friction"
"""No effect of the library: friction coefficients other than the scene's."""
EFFECTS = (
    "viscous_friction", "load_independent_friction", FRICTION, "stribeck_friction",
    "presliding", "asymmetric_friction", "tension_dependent_friction",
    "configuration_dependent_wrap", "friction_drift", "dwell_dependent_stiction",
    "cable_stiffening", "end_compliance", "joint_inertia", "motor_inertia", "none",
)  # fmt: skip


def task() -> tuple[hardware.TorqueTable, Swing]:
    """Return the desired torque, a sum of two sines, and the hand's motion."""
    times = np.arange(0.0, SECONDS, 0.002)
    torques = 1.5 * np.sin(2.2 * times) + 0.8 * np.sin(5.65 * times + 1.0)

    def swing(now: float) -> tuple[float, float]:
        size = 0.3 * min(1.0, now)
        return size * math.sin(math.pi * now), size * math.pi * math.cos(math.pi * now)

    return hardware.TorqueTable(times, torques), swing


def rougher(rig: Rig, factor: float) -> Rig:
    """Return the rig with the friction of both cables multiplied by `factor`."""
    both = {n: factor * getattr(rig, n) for n in ("friction_a", "friction_b")}
    return dataclasses.replace(rig, **both)


class Case:
    """A rig with a hidden effect, and the folder of its results."""

    def __init__(self, name: str, seed: int, strength: float, folder: Path) -> None:
        self.seed, self.folder = seed, folder
        self.rig: Rig = make_rig(seed, make="guides")
        self.hidden: dict[str, float] = {}
        if name == FRICTION:
            self.rig = rougher(self.rig, 1.0 + 0.1 * strength)
        elif name != "none":
            self.hidden[name] = calibrate(self.rig, name, strength, "rich", seed)

    def error(self, law: str, scene: str, run: str) -> dict[str, Any]:
        """Return the RMS error of the true torque in the task [N m] and its outcome."""
        drive = hardware.drive_of(scene, self.folder, PERIOD, LIMITS.torque)
        desired, swing = task()
        bench = Bench(self.rig, self.hidden, PERIOD)
        lockstep = Lockstep(bench, self.seed, swing)
        log = hardware.RunLog(self.folder / run, {"controller": law}, 200)
        made = controller(law, drive)
        outcome = play(lockstep, made, desired, LIMITS, SECONDS, log)
        log.close(outcome.to_json())
        found = {"rms": math.nan, "between": math.nan, "outcome": outcome.sentence}
        if outcome.code == 0:
            found["rms"] = rms(errors(lockstep, desired, SECONDS, SETTLED))
            found["between"] = between(self.folder / run / "log.csv")
        return found

    def identify(self) -> None:
        """Play trials, one log each; write a `dataset.toml` of their known facts."""
        data = self.folder / "data"
        # A hand that pushes against the motor demands more.
        limits = dataclasses.replace(LIMITS, torque=20.0)
        drive = hardware.drive_of("bench", self.folder, TRIAL_PERIOD, limits.torque)
        for number, trial in enumerate(make_trials("rich", self.seed)):
            bench = Bench(
                self.rig, self.hidden, TRIAL_PERIOD, tightness=trial.tightness,
                hand=trial.environment,
            )  # fmt: skip
            times = COMMAND_TIME * np.arange(len(trial.command))
            firm = hardware.Stiffness.of(drive)
            if trial.servo == COMPLIANT:  # the hand drives
                firm = dataclasses.replace(firm, stiffness=COMPLIANT[0], integral=0.0)
            servo = hardware.Servo(drive, times, trial.command[:, 0], firm)
            lockstep = Lockstep(bench, 100 * self.seed + number, led(times, trial))
            log = hardware.RunLog(
                data, {"motion": trial.motion}, 200, f"trial_{number:02d}"
            )
            seconds = hardware.APPROACH_TIME + float(times[-1])
            none = controller("none", drive)
            outcome = play(lockstep, none, servo, limits, seconds, log)
            log.close(outcome.to_json())
            if outcome.code:
                raise RuntimeError(f"{data}, trial {number}: {outcome.sentence}")
        # A log has the commanded torque of the motor, and its rotor takes a part.
        rotor = f"[rig]\nrotor_inertia = {drive.inertia:g}\n\n"
        facts = rotor + facts_of("rich", self.seed)
        (data / "dataset.toml").write_text(facts, encoding="utf-8")


def between(log: Path) -> float:
    """Return the RMS torque error of a log away from the motor's turns [N m].

    The torque sensor is averaged over 10 ms. A turn is where the command changes by
    more than `TURN` within 20 ms; within 0.1 s of one the motor crosses the backlash,
    which takes time with any model.
    """
    rows = np.genfromtxt(log, delimiter=",", names=True)
    rows = rows[np.isfinite(rows["desired_torque_nm"])]
    error = rows["joint_torque_nm"] - rows["desired_torque_nm"]
    width = round(0.01 / PERIOD)
    smooth = np.convolve(error, np.ones(width) / width, "same")
    command = rows["command_torque_nm"]
    turns = np.abs(command - np.roll(command, 2 * width)) > TURN
    near = np.convolve(turns, np.ones(20 * width), "same") > 0.0
    counts = ~near & (rows["time_s"] > SETTLED)
    return rms(smooth[counts])


def led(times: Array, trial: Trial) -> Swing:
    """Return the motion that the joint's environment follows in a trial."""

    def swing(now: float) -> tuple[float, float]:
        at = now - hardware.APPROACH_TIME
        angle = float(np.interp(at, times, trial.target[:, 0]))
        return angle, float(np.interp(at, times, trial.target[:, 1], 0.0, 0.0))

    return swing


def run(
    name: str, seed: int, strength: float, laws: Sequence[str], out: Path
) -> dict[str, Any]:
    """Return the record of a case: task, trials, diagnosis, and the task again."""
    folder = out / f"{name}-{seed}-{strength:g}"
    shutil.rmtree(folder, ignore_errors=True)
    case = Case(name, seed, strength, folder)
    before = {law: case.error(law, "bench", f"{law}_before") for law in laws}
    case.identify()
    began = time.process_time()
    found = diagnose(scene_path("bench"), [folder / "data"], folder / "diagnosis")
    seconds = time.process_time() - began
    mended = folder / "diagnosis" / "scene.xml"
    scene = str(mended.resolve()) if mended.exists() else "bench"
    return {
        "effect": name,
        "seed": seed,
        "strength": strength,
        "hidden": case.hidden,
        **findings(found),
        "seconds": seconds,
        "before": before,
        "mended": mended.exists(),
        "after": {law: case.error(law, scene, f"{law}_after") for law in laws},
    }


def summary(records: list[Mapping[str, Any]]) -> str:
    rows = []
    for r in records:
        size = "-" if r["effect"] == "none" else f"{r['strength']:g}"
        if r["effect"] == FRICTION:
            size = f"+{10 * r['strength']:.0f} %"
        said = f"{r['verdict']}: {', '.join(r['named']) or '-'}"
        for law, before in r["before"].items():
            falls = []  # errors in mN m, and how often the second goes into the first
            for key in ("rms", "between"):
                old, new = before[key], r["after"][law][key]
                better = f" ({old / new:.1f})" if new else ""
                falls.append(f"{1e3 * old:.0f} to {1e3 * new:.0f}{better}")
            rows.append((r["effect"], size, str(r["seed"]), said, law, *falls))
    head = (
        "hidden", "R", "seed", "verdict", "controller", "error [mN m] (better by)",
        "error between turns",
    )  # fmt: skip
    return table(head, rows)


def main(
    effects: tuple[Literal[EFFECTS], ...] = EFFECTS,
    seeds: tuple[int, ...] = (1, 2),
    strength: float = 4.0,
    controllers: tuple[str, ...] = ("stiction",),
    out: Path = Path("runs", "closed_loop"),
) -> None:
    """Play the cases that are not done, and print the table.

    Args:
        strength: R of an effect.
    """
    cases = [(name, seed, strength) for seed in seeds for name in effects]
    make = partial(run, laws=controllers, out=out)
    complete(out, ("effect", "seed", "strength"), cases, make, summary)


if __name__ == "__main__":
    warnings.filterwarnings("ignore")
    tyro.cli(main)
