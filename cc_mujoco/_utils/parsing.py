"""TOML and JSON by Python's parsers, each with a single kind of error."""

import json
import re
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from cc_mujoco.errors import CableError

_TOO_DEEP = "tables or lists are nested too deeply"
_LONG_KEY = re.compile(
    r"(?<![\w-])(?:(?:[\w-]++|\"[^\"\n]*\"|'[^'\n]*')[ \t]*+\.[ \t]*+){100}"
)
"""Dotted keys longer than any that is meant; Python reads them in quadratic time."""


def parse_toml(text: str) -> dict[str, Any]:
    """Return the content of TOML text; raise `TOMLDecodeError` if nested too deep."""
    if _LONG_KEY.search(text):
        raise tomllib.TOMLDecodeError("a key has more than 100 parts")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise tomllib.TOMLDecodeError(_TOO_DEEP) from None


def parse_json(text: str | bytes) -> Any:
    """Return the content of JSON text; raise `ValueError` if nested too deep."""
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None


def unreadable(what: str | Path, error: OSError) -> CableError:
    return CableError(f"cannot read {what}: {error.strerror or error}.")


@contextmanager
def one_sentence(
    path: Path, advice: str = "", kind: type[Exception] = Exception
) -> Iterator[None]:
    """Turn a parser's exceptions into a `CableError` of one sentence naming the file.

    The sentence has the system's reason if there is one, else `advice`, a clause on
    what would be right. Only exceptions of `kind` are turned.
    """
    try:
        yield
    except CableError:
        raise
    except kind as error:
        if isinstance(error, OSError) and error.strerror:
            raise unreadable(path, error) from None
        text = " ".join(str(error).split())[:160].rstrip(".") or type(error).__name__
        more = f"; {advice}" if advice else ""
        raise CableError(
            f"{path} is not a whole {path.suffix[1:]} file: {text}{more}."
        ) from None
