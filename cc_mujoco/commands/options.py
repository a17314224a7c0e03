"""Options that say in words what they are when they are not given."""

from __future__ import annotations

from typing import Annotated

import tyro


def in_words(metavar: str | None = None) -> object:
    """An option whose help ends without tyro's "(default: None)" or "(default: )".

    Args:
        metavar: What stands for its value in the help.
    """
    return tyro.conf.arg(metavar=metavar, help_behavior_hint="")


Name = Annotated[str | None, in_words("NAME")]
Names = Annotated[tuple[str, ...], in_words("[NAME ...]")]
Flag = Annotated[tyro.conf.FlagCreatePairsOff[bool], in_words()]
