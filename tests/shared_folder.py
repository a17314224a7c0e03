"""The folder beside the checkout with measured data and reference solutions."""

from __future__ import annotations

from pathlib import Path

SHARED = Path(__file__).parents[2] / "shared"
ABSENT = "../shared is not here"
