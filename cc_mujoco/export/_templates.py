"""Template files, with placeholders for the numbers and names of a controller."""

from pathlib import Path
from string import Template


def fill(file: str, **values: object) -> str:
    """Return the text of a file in `templates`, `$NAME` replaced by its value."""
    text = (Path(__file__).with_name("templates") / file).read_text(encoding="utf-8")
    return Template(text).substitute(values) if values else text
