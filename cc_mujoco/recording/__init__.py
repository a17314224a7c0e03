"""Outputs of an episode: its log, numbers, figure and Rerun recording.

    log = simulate("wrist", "pi", motion="sine", duration=8.0, seed=0)
    write_episode("runs/sine", log, load(DEVICES["wrist"]))

The controller sees what the device's sensors measure, noisy and late; the log holds the
truth. It is all that is needed; everything else is made from it and the model.
"""

from __future__ import annotations

from cc_mujoco.recording.columns import CABLE, DEVICE, LogColumn, columns_for
from cc_mujoco.recording.episode import FILES, write_episode
from cc_mujoco.recording.log import EpisodeLog, Recorder
from cc_mujoco.recording.simulate import play, simulate
from cc_mujoco.recording.summary import draw_summary, write_summary

__all__ = [
    "CABLE",
    "DEVICE",
    "FILES",
    "EpisodeLog",
    "LogColumn",
    "Recorder",
    "columns_for",
    "draw_summary",
    "play",
    "simulate",
    "write_episode",
    "write_summary",
]
