"""Effect of a cable on a torque, and of compensation: one motion, three laws.

    python scripts/figures/demo.py --out controllers.png --record runs/demo

The wearer sweeps the wrist handle, which is to feel like a spring. Draws what is
desired and what arrives, and the flexor's tension at both ends, and prints it in plain
words. With --record the last of the three leaves recording, page, log, metrics, figure.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
from figure_paths import figure_path

from cc_mujoco import (
    METRICS,  # importing it registers the environments
    report,
)
from cc_mujoco.control import controller
from cc_mujoco.human import Spring
from cc_mujoco.native import FloatArray as Array
from cc_mujoco.simulation import EpisodeLog, play
from cc_mujoco.viz import PAGE_FILE, require_ours, require_page, write_episode

LAWS = {
    "none": "no compensation",
    "lqg": "a tuned disturbance observer",
    "predictive": "the cable's model, rolled ahead",
}
CABLE, SPRING = "flexor", Spring(2.5)
ENDS = {"proximal": "at the motor", "distal": "at the joint"}
BEGIN = 0.5  # time from which on torques are judged [s]


def relative_error(time: Array, desired: Array, reached: Array) -> float:
    """Return the RMS error over the RMS of the desired signal, from `BEGIN` on."""
    late = time >= BEGIN
    off = np.mean((reached - desired)[late] ** 2)
    return float(np.sqrt(off / np.mean(desired[late] ** 2)))


def episode(law: str, duration: float) -> tuple[EpisodeLog, mujoco.MjModel]:
    """Play the motion with one controller; return the log and the model."""
    env: Any = gymnasium.make(
        "cc_mujoco/WristHandle-v1", trajectory="sweep", task=SPRING, duration=duration,
        disable_env_checker=True,
    )  # fmt: skip
    about = {"trajectory": "sweep", "task": "spring of 2.5 N m/rad", "controller": law}
    drive = env.unwrapped.drive
    log: EpisodeLog = play(env, controller(law, drive), seed=0, about=about)
    env.close()
    return log, env.unwrapped.model


def results(log: EpisodeLog) -> dict[str, float]:
    """Return error, lost energy [J] and metrics of an episode."""
    lost = [log[f"dissipated_{name}_j"] for name in log.cables]
    return {
        "error": relative_error(
            log["time_s"], log["desired_torque_nm"], log["joint_torque_nm"]
        ),
        "lost": float(sum(each[-1] - each[0] for each in lost)),
        "tension": float(log[f"tension_{CABLE}_proximal_n"].max()),
        "peak": METRICS["peak_motor_torque"].compute(log),
        "chatter": 1e3 * METRICS["chatter"].compute(log),
    }


def words(logs: dict[str, EpisodeLog]) -> list[str]:
    none, rival, best = map(results, logs.values())
    first, *_, log = logs.values()
    proximal, distal = (log[f"tension_{CABLE}_{end}_n"] for end in ENDS)
    pulling = (proximal >= 0.5 * proximal.max()) & (log["time_s"] >= BEGIN)
    pulled, arrived = proximal[pulling].mean(), distal[pulling].mean()
    joint = first["joint_angle_rad"]

    def each(name: str, form: str) -> str:
        return "{:{f}}, {:{f}} and {:{f}}".format(
            none[name], rival[name], best[name], f=form
        )

    return [
        f"The wearer sweeps the handle over {np.ptp(joint):.2f} rad, "
        f"{np.sum(np.abs(np.diff(joint))):.2g} rad in all; the device should feel like "
        f"a spring, with up to {np.abs(log['desired_torque_nm']).max():.2f} N m.",
        f"While the motor pulls the {CABLE} with at least half its peak, of "
        f"{pulled:.0f} N in the mean {arrived:.0f} N come out of the conduit: "
        f"{1.0 - arrived / pulled:.0%} are lost on the way.",
        "Without compensation (none) the wearer drags the cable along: the torque is "
        f"off by {none['error']:.0%} of what is desired.",
        "A tuned baseline, lqg (rotor, spring, disturbance observer), leaves "
        f"{rival['error']:.1%}.",
        "predictive, which rolls the model of the cable ahead and crosses its friction "
        f"in one move, leaves {best['error']:.1%}: "
        f"{best['error'] / rival['error']:.2f} times that.",
        f"The price, none, lqg and predictive: motor torque up to {each('peak', '.2f')}"
        f" N m, chatter {each('chatter', '.0f')} mN m, up to {each('tension', '.0f')} N"
        f" at the motor's end of the {CABLE}, {each('lost', '.1f')} J of heat.",
    ]


def draw(logs: dict[str, EpisodeLog], out: Path) -> None:
    with report.style():
        drawing = report.figure(11.5, 5.2)
        axes = drawing.subplots(2, len(logs), sharex=True, sharey="row")
        for (law, log), (above, below) in zip(logs.items(), axes.T, strict=True):
            time = log["time_s"]
            above.plot(time, log["joint_torque_nm"], color=report.BLUE)
            above.plot(
                time, log["desired_torque_nm"], color=report.GREY,
                dashes=report.DASH_PATTERN, label="desired",
            )  # fmt: skip
            above.set_title(f"{law}: {LAWS[law]}\nerror {results(log)['error']:.1%}")
            for end, color in zip(ENDS, (report.ORANGE, report.BLUE), strict=True):
                tension = log[f"tension_{CABLE}_{end}_n"]
                below.plot(time, tension, color=color, label=ENDS[end])
            below.set_xlabel("time [s]")
        axes[0, 0].set_ylabel("joint torque [N m]")
        axes[1, 0].set_ylabel(f"tension of the {CABLE} [N]")
        for row in axes[:, -1]:
            row.legend(loc="upper left")
        report.save(out, drawing)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=figure_path, default="controllers.png")
    parser.add_argument("--record", type=Path, help="folder for the last of the three")
    parser.add_argument("--duration", type=float, default=5.0, help="[s]")
    arguments = parser.parse_args()
    if arguments.duration <= 2.0 * BEGIN:
        parser.error(f"--duration must be more than {2.0 * BEGIN:g} s")
    out, record = arguments.out, arguments.record
    if record is not None:
        require_ours(record)
        require_page()
    played = {law: episode(law, arguments.duration) for law in LAWS}
    last, (log, model) = list(played.items())[-1]
    if record is not None:
        write_episode(record, log, model, html=True)
    logs = {law: own for law, (own, _) in played.items()}
    draw(logs, out)
    print()
    for sentence in words(logs):
        print(f"- {sentence}")
    print(f"\nsee:        {out}")
    if record is not None:
        print(f"in motion:  {record / PAGE_FILE}, in any browser ({last})")
        # As it works where `.venv` is not active, too.
        beside = str(Path(sys.executable).parent / "rerun")
        rerun = "rerun" if shutil.which("rerun") else beside
        print(f"closely:    {rerun} {record / 'recording.rrd'}")


if __name__ == "__main__":
    main()
