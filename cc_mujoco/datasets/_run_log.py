"""Run record that `cc-mujoco run` writes next to the rows of a run."""

import tomllib
from pathlib import Path
from typing import Any

from cc_mujoco._utils.atomic_io import is_marked
from cc_mujoco._utils.parsing import parse_json, parse_toml
from cc_mujoco.assets import SCENES

DEFAULT_LOG_NAME, RUN_MARK = "log", {"cc_mujoco": "run"}
"""Name of a run's files unless it has one of its own, and what is in every such page;
other files of that name are not of ours."""


def page_of(rows: Path) -> Path:
    return rows.with_name(
        "run.json" if rows.stem == DEFAULT_LOG_NAME else f"{rows.stem}.json"
    )


def beside(rows: Path, name: str) -> Path:
    start = "" if rows.stem == DEFAULT_LOG_NAME else f"{rows.stem}_"
    return rows.with_name(start + name)


def truncation_reason(rows: Path) -> str:
    page = _read_page(rows)
    return str(page.get("outcome", "")) if page.get("exit_code") != 0 else ""


def scene_of(rows: Path) -> str:
    """Return the scene that a run's controller used as a model; "" if unknown."""
    try:
        rig = parse_toml(str(_read_page(rows).get("rig", "")))
    except tomllib.TOMLDecodeError:
        return ""
    return str(rig.get("scene", ""))


def other_scene(rows: Path, scene: str) -> str:
    """Return the run's scene if it and `scene` are built in and differ, else ""."""
    ran = scene_of(rows)
    return ran if ran != scene and {ran, scene} <= {*SCENES} else ""


def is_log(path: Path) -> bool:
    return bool(scene_of(path)) or (
        path.suffix.lower() == ".parquet" and is_marked(path)
    )


def _read_page(rows: Path) -> dict[str, Any]:
    try:
        page = parse_json(page_of(rows).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    ours = isinstance(page, dict) and page.items() >= RUN_MARK.items()
    return page if ours else {}
