"""States of cable ends, as lanes of a timeline in a Rerun recording."""

from __future__ import annotations

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from cc_mujoco.simulation._episode_log import EpisodeLog
from cc_mujoco.viz._entity_path import Branch
from cc_mujoco.viz._rerun_series import ORANGE, PURPLE, SKY
from cc_mujoco.viz._scene3d import TIMELINE

END_STATES = {
    "stuck": 0x5F5F5FFF,
    "slips to joint": ORANGE,
    "slips to motor": SKY,
    "slack": 0xE0E0E0FF,
    "to and fro": PURPLE,
}
"""States of an end of a cable, and the colour of each in the timeline."""
SLACK_STATE, OSCILLATING_STATE = 3, 4
BRIEF_TIME, MIN_OSCILLATIONS = 0.03, 4
"""Duration [s] of states that are to and fro, and how many in a row: a motor shaking
with its sensors' noise makes thousands, of which a lane would show none."""


def log_lanes(rec: Branch, log: EpisodeLog) -> None:
    """Log the state of each end of each cable whenever it changes."""
    time = log["time_s"]
    names = np.array(list(END_STATES))
    look = rr.StateConfiguration(
        values=list(END_STATES),
        labels=list(END_STATES),
        colors=np.array(list(END_STATES.values()), dtype=np.uint32),
    )
    for cable in log.cables:
        pieces = log.pieces(f"slip_{cable}_direction")
        slip = np.concatenate([rows[:, [0, -1]] for rows in pieces])
        for end, place, segment in (("motor", "proximal", 0), ("joint", "distal", -1)):
            slack = log[f"tension_{cable}_{place}_n"] <= 0
            # Directions 0, 1 and -1 are positions 0, 1 and 2 in STATES.
            state = np.where(slack, SLACK_STATE, slip[:, segment] % 3)
            changed, state = state_changes(time, state)
            path = rr.new_entity_path(["slip", cable, f"{end}_end"])
            rec.log(path, look, static=True)
            rec.send_columns(
                path,
                [rr.TimeColumn(TIMELINE, duration=time[changed])],
                [*rr.StateChange.columns(state=names[state].tolist())],
            )


def state_changes(
    time: NDArray[np.float64], state: NDArray[np.integer]
) -> tuple[NDArray[np.intp], NDArray[np.integer]]:
    """Return the samples at which a state begins, and which state it is.

    Args:
        time: Of the samples, rising [s], (T,).
        state: Position in `END_STATES` of each, (T,).
    """
    begun = np.flatnonzero(np.diff(state, prepend=-1))
    lasts = np.diff(time[begun], append=time[-1])
    brief = np.concatenate([[False], lasts < BRIEF_TIME, [False]])
    edges = np.flatnonzero(np.diff(brief)).reshape(-1, 2)
    found = state[begun]
    kept = np.ones(len(begun), dtype=bool)
    for first, last in edges.tolist():
        if last - first >= MIN_OSCILLATIONS:
            found[first] = OSCILLATING_STATE
            kept[first + 1 : last] = False
    return begun[kept], found[kept]
