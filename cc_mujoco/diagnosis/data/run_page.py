"""Page that `cc-mujoco run` writes beside the rows of a run, on how it went.

cut_short(Path("data/trial_01.csv"))        # "" or "stopped by SIGTERM."
"""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

LOG = "log"
"""Name of a run's files unless it has one of its own."""
MARK = {"cc_mujoco": "run"}
"""In every such page; other files of that name are not of ours."""


def page_of(rows: Path) -> Path:
    """The page that lies beside the rows of a run."""
    return rows.with_name("run.json" if rows.stem == LOG else f"{rows.stem}.json")


def cut_short(rows: Path) -> str:
    """Why a run was over before its time; empty where it was not, or is unknown."""
    told = _told(rows)
    return str(told.get("outcome", "")) if told.get("exit_code") != 0 else ""


def scene_of(rows: Path) -> str:
    """The scene that a run's controller knew; empty where that is unknown."""
    try:
        return str(tomllib.loads(str(_told(rows).get("rig", ""))).get("scene", ""))
    except tomllib.TOMLDecodeError:
        return ""


def _told(rows: Path) -> dict[str, Any]:
    """Return what the page says, if it is one of ours."""
    try:
        told = json.loads(page_of(rows).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    ours = isinstance(told, dict) and told.items() >= MARK.items()
    return told if ours else {}
