"""TOML and JSON as Python reads them, with one kind of error each."""

from __future__ import annotations

import json
import tomllib
from typing import Any

_TOO_DEEP = "tables or lists are nested too deeply"


def parse_toml(text: str) -> dict[str, Any]:
    """Return the content of a TOML file.

    Raises:
        tomllib.TOMLDecodeError: It is none, or nested deeper than can be read.
    """
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise tomllib.TOMLDecodeError(_TOO_DEEP) from None


def parse_json(text: str | bytes) -> Any:
    """Return the content of a JSON file.

    Raises:
        ValueError: It is none, or nested deeper than can be read.
    """
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
