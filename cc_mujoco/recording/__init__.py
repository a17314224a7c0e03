"""What remains of an episode: its log, numbers, figure and Rerun recording.

    log = play(env, controller, seed=0)
    write_episode("runs/wrist", log, env.unwrapped.model)

The log is all that is needed; everything else is made from it.
"""

from __future__ import annotations
