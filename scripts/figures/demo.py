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


class Played:
    """Result of one controller; arrays are (samples,)."""

    def __init__(self, log: EpisodeLog) -> None:
        self.time, self.desired = log["time_s"], log["desired_torque_nm"]
        self.torque, self.joint = log["joint_torque_nm"], log["joint_angle_rad"]
        self.proximal = log[f"tension_{CABLE}_proximal_n"]
        self.distal = log[f"tension_{CABLE}_distal_n"]
        self.error = relative_error(self.time, self.desired, self.torque)
        lost = [log[f"dissipated_{name}_j"] for name in log.cables]
        # Energy that friction turned into heat [J].
        self.lost = float(sum(each[-1] - each[0] for each in lost))
        self.peak = METRICS["peak_motor_torque"].compute(log)
        self.chatter = METRICS["chatter"].compute(log)


def words(found: dict[str, Played]) -> list[str]:
    none, rival, best = found.values()
    moment = int(np.argmax(best.proximal))
    kept = best.distal[moment] / best.proximal[moment]
    travel = float(np.sum(np.abs(np.diff(none.joint))))
    return [
        f"The wearer sweeps the handle over {np.ptp(none.joint):.2f} rad, "
        f"{travel:.2g} rad in all; the device should feel like a spring, with up to "
        f"{np.abs(best.desired).max():.2f} N m.",
        f"Of {best.proximal[moment]:.0f} N that the motor pulls at most, "
        f"{best.distal[moment]:.0f} N come out of the conduit: {1.0 - kept:.0%} are "
        "lost on the way.",
        f"Without compensation (none) the wearer drags the cable along: the torque is "
        f"off by {none.error:.0%} of what is desired.",
        "A tuned baseline, lqg (rotor, spring, disturbance observer), leaves "
        f"{rival.error:.1%}.",
        "predictive, which rolls the model of the cable ahead and crosses its friction "
        f"in one move, leaves {best.error:.1%}: {best.error / rival.error:.2f} times "
        "that.",
        f"The price, none, lqg and predictive: motor torque up to {none.peak:.2f}, "
        f"{rival.peak:.2f} and {best.peak:.2f} N m, chatter {1e3 * none.chatter:.0f}, "
        f"{1e3 * rival.chatter:.0f} and {1e3 * best.chatter:.0f} mN m, up to "
        f"{none.proximal.max():.0f}, {rival.proximal.max():.0f} and "
        f"{best.proximal.max():.0f} N at the motor's end of the flexor, "
        f"{none.lost:.1f}, {rival.lost:.1f} and {best.lost:.1f} J of heat.",
    ]


def draw(found: dict[str, Played], out: Path) -> None:
    with report.style():
        drawing = report.figure(11.5, 5.2)
        axes = drawing.subplots(2, len(found), sharex=True, sharey="row")
        for (law, one), column in zip(found.items(), axes.T, strict=True):
            above, below = column
            above.plot(one.time, one.torque, color=report.BLUE, label="delivered")
            above.plot(
                one.time,
                one.desired,
                color=report.GREY,
                dashes=report.DASH_PATTERN,
                label="desired",
            )
            above.set_title(f"{law}: {LAWS[law]}\nerror {one.error:.1%}")
            below.plot(
                one.time, one.proximal, color=report.ORANGE, label="at the motor"
            )
            below.plot(one.time, one.distal, color=report.BLUE, label="at the joint")
            below.set_xlabel("time [s]")
        axes[0, 0].set_ylabel("joint torque [N m]")
        axes[1, 0].set_ylabel(f"tension of the {CABLE} [N]")
        for row in axes[:, -1]:
            row.legend(loc="upper left")
        report.save(out, drawing)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=report.figure_path, default="controllers.png")
    parser.add_argument("--record", type=Path, help="folder for the last of the three")
    parser.add_argument("--duration", type=float, default=5.0, help="[s]")
    arguments = parser.parse_args()
    if arguments.duration <= 2.0 * BEGIN:
        parser.error(f"--duration must be more than {2.0 * BEGIN:g} s")
    out, record = arguments.out, arguments.record
    if record is not None:
        require_ours(record)
        require_page()
    *others, last = LAWS
    found = {law: Played(episode(law, arguments.duration)[0]) for law in others}
    log, model = episode(last, arguments.duration)
    if record is not None:
        write_episode(record, log, model, html=True)
    found[last] = Played(log)
    draw(found, out)
    print()
    for sentence in words(found):
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
