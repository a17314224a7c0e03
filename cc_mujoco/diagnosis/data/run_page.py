"""What `cc-mujoco run` says, beside the rows of a run, of how it went.

cut_short(Path("data/trial_01.csv"))        # "" or "stopped by SIGTERM."
"""

from __future__ import annotations

import json
from pathlib import Path

LOG = "log"
"""Name of a run's files unless it has one of its own."""
MARK = {"cc_mujoco": "run"}
"""In every such page; other files of that name are not of ours."""


def page_of(rows: Path) -> Path:
    """The page that lies beside the rows of a run."""
    return rows.with_name("run.json" if rows.stem == LOG else f"{rows.stem}.json")


def cut_short(rows: Path) -> str:
    """Why a run was over before its time; empty where it was not, or is unknown."""
    try:
        told = json.loads(page_of(rows).read_text(encoding="utf-8"))
        ours = told.items() >= MARK.items() and told.get("exit_code") != 0
        return str(told["outcome"]) if ours else ""
    except (OSError, ValueError, KeyError, AttributeError, TypeError):
        return ""
