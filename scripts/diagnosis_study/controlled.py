"""Controllers on rigs by other equations, each of which hides something.

    python scripts/train_policy.py --scene bench --algorithm sac --out runs/bench
    python scripts/diagnosis_study/controlled.py --out runs/learned \
        --controllers pi stiction predictive runs/bench/0.safetensors
    python scripts/diagnosis_study/controlled.py --out runs/mended --strength 4 \
        --noise 0 --mend

A rig with guides (`driven.py`), a few percent off the scene `bench`, hides an effect. A
controller that knows only the scene, or learnt on it, plays a task through the loop of
`cc-mujoco run`, in lockstep: two sines of torque while a hand swings the joint loosely.
With `--mend` the loop then plays trials, the rich motions of `rig`, by the servo that
plays those of a plan; `cc-mujoco diagnose` names by their logs what is missing, and the
controller plays the task again with the scene that it wrote. Errors are of the torque
that the joint truly got; chatter is the RMS of the motor's torque less its mean over 50
ms. Finished cases are kept.
"""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from driven import Array, Bench, Commands, Lockstep, Swing, errors, play, rms
from kept_cases import complete

from cc_mujoco import hardware
from cc_mujoco.assets import scene_path
from cc_mujoco.control import Controller, controller, read_policy
from cc_mujoco.diagnosis import diagnose
from cc_mujoco.errors import CableError
from cc_mujoco.report import table
from rig.dataset import make_trials
from rig.engine import COMMAND_TIME
from rig.generate import facts_of
from rig.makes import MAKES
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
NOISE = 0.025  # noise of the joint's torque sensor, as its data sheet has it [N m]
TURN = 2.0  # change of the motor's torque where it turns [N m]: about its friction
FRICTION = "friction"
"""No effect of the library: 1.4 times the friction of the scene."""
EFFECTS = (
    "none", FRICTION, "viscous_friction", "load_independent_friction",
    "stribeck_friction", "presliding", "asymmetric_friction", "end_compliance",
    "configuration_dependent_wrap", "friction_drift", "tension_dependent_friction",
    "dwell_dependent_stiction", "cable_stiffening", "joint_inertia", "motor_inertia",
)  # fmt: skip


def task() -> tuple[hardware.TorqueTable, Swing]:
    """Return the desired torque, a sum of two sines, and the hand's motion."""
    times = np.arange(0.0, SECONDS, 0.002)
    torques = 1.5 * np.sin(2.2 * times) + 0.8 * np.sin(5.65 * times + 1.0)

    def swing(now: float) -> tuple[float, float]:
        size = 0.3 * min(1.0, now)
        return size * math.sin(math.pi * now), size * math.pi * math.cos(math.pi * now)

    return hardware.TorqueTable(times, torques), swing


def built(effect: str, seed: int, strength: float) -> tuple[Rig, dict[str, float]]:
    """Return a rig with a hidden effect, and the effect's amount by id."""
    rig = make_rig(seed, make="guides")
    if effect == FRICTION:
        both = {n: 1.4 * getattr(rig, n) for n in ("friction_a", "friction_b")}
        return dataclasses.replace(rig, **both), {}
    if effect == "none":
        return rig, {}
    amount = MAKES[rig.make].effects[effect].typical
    if strength:
        amount = calibrate(rig, effect, strength, "rich", seed)
    return rig, {effect: amount}


def law_of(
    name: str, noise: float = NOISE, scene: str = "bench", folder: Path = Path()
) -> Controller:
    """Return a controller by name, or a policy by its file."""
    drive = hardware.drive_of(scene, folder, PERIOD, LIMITS.torque)
    if Path(name).suffix == ".safetensors":
        (observed,) = read_policy(name)[1]
        if observed.device != "bench":
            raise CableError(
                f"policy {name!r} learnt on the device {observed.device}, not on the "
                "bench: python scripts/train_policy.py --scene bench."
            )
        drive = dataclasses.replace(drive, observed=observed, period=observed.period)
    return controller(name, dataclasses.replace(drive, torque_noise=noise))


def played(
    law: Controller, rig: Rig, hidden: Mapping[str, float], seed: int
) -> dict[str, Any]:
    """Play the task; return errors, chatter and motor peak [N m], and the outcome."""
    desired, swing = task()
    lockstep = Lockstep(Bench(rig, hidden, law.drive.period), seed, swing)
    return measured(law, lockstep, desired, LIMITS, (SECONDS, SETTLED))


def measured(
    law: Controller,
    lockstep: Lockstep,
    desired: hardware.TorqueTable,
    limits: hardware.Limits,
    times: tuple[float, float],
) -> dict[str, Any]:
    """Play a task; `times` are its length and the time from which errors count [s]."""
    rows, period = Commands(), lockstep.bench.period
    outcome = play(lockstep, law, desired, limits, times[0], rows)
    found = {"rms": math.nan, "between": math.nan, "chatter": math.nan}
    found |= {"peak": math.nan, "outcome": outcome.sentence}
    if outcome.code == 0:
        torques = np.array(rows.torques)
        off = errors(lockstep, desired, *times)
        found["rms"], found["peak"] = rms(off), float(np.max(np.abs(torques)))
        found["between"] = between(off, torques, period)
        found["chatter"] = chatter(torques, period, times)
    return found


def chatter(torques: Array, period: float, times: tuple[float, float]) -> float:
    """Return the RMS of torques less their mean over 50 ms, after settling [N m]."""
    width = round(0.05 / period)
    mean = np.convolve(torques, np.ones(width) / width, "same")
    begin, end = round(times[1] / period), round(times[0] / period) - width
    return rms((torques - mean)[begin:end])


def between(off: Array, torques: Array, period: float) -> float:
    """Return the RMS error, meaned over 10 ms, away from the motor's turns [N m].

    A turn is where the torque changes by more than `TURN` within 20 ms; within 0.1 s of
    one the motor crosses the backlash, which takes time with any model.
    """
    width = round(0.01 / period)
    smooth = np.convolve(off, np.ones(width) / width, "same")
    command = torques[-off.size :]
    turns = np.abs(command - np.roll(command, 2 * width)) > TURN
    near = np.convolve(turns, np.ones(20 * width), "same")[: off.size] > 0.0
    straight = smooth[~near]
    return rms(straight) if straight.size else math.nan


def identify(rig: Rig, hidden: Mapping[str, float], seed: int, data: Path) -> None:
    """Play trials, one log each; write a `dataset.toml` of their known facts."""
    # A hand that pushes against the motor demands more.
    limits = dataclasses.replace(LIMITS, torque=20.0)
    drive = hardware.drive_of("bench", data.parent, TRIAL_PERIOD, limits.torque)
    for number, trial in enumerate(make_trials("rich", seed)):
        bench = Bench(
            rig, hidden, TRIAL_PERIOD, tightness=trial.tightness, hand=trial.environment
        )
        times = COMMAND_TIME * np.arange(len(trial.command))
        firm = hardware.Stiffness.of(drive)
        if trial.servo == COMPLIANT:  # the hand drives
            firm = dataclasses.replace(firm, stiffness=COMPLIANT[0], integral=0.0)
        servo = hardware.Servo(drive, times, trial.command[:, 0], firm)
        lockstep = Lockstep(bench, 100 * seed + number, _led(times, trial))
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
    (data / "dataset.toml").write_text(rotor + facts_of("rich", seed), encoding="utf-8")


def _led(times: Array, trial: Trial) -> Swing:
    """Return the motion that the joint's environment follows in a trial."""

    def swing(now: float) -> tuple[float, float]:
        at = now - hardware.APPROACH_TIME
        angle = float(np.interp(at, times, trial.target[:, 0]))
        return angle, float(np.interp(at, times, trial.target[:, 1], 0.0, 0.0))

    return swing


def run(
    name: str,
    effect: str,
    seed: int,
    strength: float,
    noise: float,
    mend: bool,
    out: Path,
) -> dict[str, Any]:
    """Return the record of a case: task and, with `mend`, the task again."""
    rig, hidden = built(effect, seed, strength)
    case = {"controller": name, "effect": effect, "seed": seed, "hidden": hidden}
    case |= played(law_of(name, noise), rig, hidden, seed)
    if not mend:
        return case
    folder = out / f"{effect}-{seed}"
    kept, scene = folder / "verdict.txt", folder / "verdict" / "scene.xml"
    if not kept.exists():
        identify(rig, hidden, seed, folder / "data")
        found = diagnose(scene_path("bench"), [folder / "data"], folder / "verdict")
        names = ", ".join(each.id for each in found.missing) or "-"
        kept.write_text(f"{found.verdict}: {names}", encoding="utf-8")
    case["verdict"] = kept.read_text(encoding="utf-8")
    mended = str(scene.resolve()) if scene.exists() else "bench"
    law = law_of(name, noise, mended, folder)
    return case | {"after": played(law, rig, hidden, seed)["rms"]}


def summary(records: list[Mapping[str, Any]], names: Sequence[str]) -> str:
    """Return means over seeds as a Markdown table [mN m], a row per hidden effect."""
    rows = []
    for effect in dict.fromkeys(r["effect"] for r in records):
        own = [r for r in records if r["effect"] == effect]
        verdicts = sorted({r["verdict"] for r in own if "verdict" in r})
        cells = (cell(records, name, "rms", effect) for name in names)
        rows.append((effect.replace("_", " "), "; ".join(verdicts), *cells))
    for key, what in (("rms", "mean"), ("between", "between turns"),
                      ("chatter", "chatter"), ("peak", "peak")):  # fmt: skip
        rows.append((what, "", *(cell(records, name, key) for name in names)))
    short = [
        f"{Path(n).parent.name}/{Path(n).stem}" if "/" in n else f"`{n}`" for n in names
    ]
    return table(("hidden", "verdict", *short), rows)


def cell(
    records: list[Mapping[str, Any]], name: str, key: str, effect: str | None = None
) -> str:
    """Return the mean [mN m] over finished runs, after mending and how many stopped."""
    mine = [
        r for r in records if r["controller"] == name and effect in (None, r["effect"])
    ]
    there = [r for r in mine if math.isfinite(r[key])]
    if not there:
        return f"- ({len(mine)} stopped)"
    mean = float(np.mean([r[key] for r in there]))
    shown = f"{1e3 * mean:.0f}"
    if key == "rms" and all("after" in r for r in there):
        after = float(np.mean([r["after"] for r in there]))
        shown += f" to {1e3 * after:.0f} ({mean / after:.1f})"
    lost = len(mine) - len(there)
    return f"{shown} ({lost} of {len(mine)} stopped)" if lost else shown


def main(
    controllers: tuple[str, ...] = ("predictive",),
    effects: tuple[Literal[EFFECTS], ...] = EFFECTS,
    seeds: tuple[int, ...] = (1, 2),
    strength: float = 0.0,
    noise: float = NOISE,
    mend: bool = False,
    out: Path = Path("runs", "controlled"),
) -> None:
    """Play the cases that are not done, and print the table.

    Args:
        strength: R of an effect; 0 hides its typical amount.
        noise: of the joint's torque sensor, as controllers believe it [N m].
        mend: diagnose, and play again with the scene that is written.
    """
    try:
        for name in controllers:
            law_of(name)
    except CableError as error:
        raise SystemExit(f"--controllers: {error}") from None
    cases = [(n, effect, s) for s in seeds for effect in effects for n in controllers]
    make = partial(run, strength=strength, noise=noise, mend=mend, out=out)
    summed = partial(summary, names=controllers)
    complete(out, ("controller", "effect", "seed"), cases, make, summed)


if __name__ == "__main__":
    warnings.filterwarnings("ignore")
    tyro.cli(main)
