"""Parsing of a command line into the command that it means."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Sequence
from typing import Annotated, Any

import tyro

from cc_mujoco.cli._benchmark import Benchmark
from cc_mujoco.cli._calibrate import Calibrate
from cc_mujoco.cli._device import ShowDevice
from cc_mujoco.cli._diagnose import Diagnose
from cc_mujoco.cli._export import Export
from cc_mujoco.cli._list import Listing
from cc_mujoco.cli._play import Play
from cc_mujoco.cli._plugin import WritePlugin
from cc_mujoco.cli._run import RunRig
from cc_mujoco.cli._tendons import ShowTendons
from cc_mujoco.cli._view import View
from cc_mujoco.cli._whatif import WhatIf
from cc_mujoco.cli._whatif_show import WhatIfShow
from cc_mujoco.errors import CableError, look_up, require_new_name, require_utf8

COMMANDS = {
    "device": ShowDevice,
    "tendons": ShowTendons,
    "play": Play,
    "calibrate": Calibrate,
    "diagnose": Diagnose,
    "whatif": WhatIf,
    "whatif-show": WhatIfShow,
    "benchmark": Benchmark,
    "export": Export,
    "plugin": WritePlugin,
    "run": RunRig,
    "view": View,
    "list": Listing,
}

REPEATED = ("--vary", "--across", "--subject-to")
"""Options that are given once for each `NAME=VALUE`."""

Command = (
    Annotated[ShowDevice, tyro.conf.subcommand("device")]
    | Annotated[ShowTendons, tyro.conf.subcommand("tendons")]
    | Annotated[Play, tyro.conf.subcommand("play")]
    | Annotated[Calibrate, tyro.conf.subcommand("calibrate")]
    | Annotated[Diagnose, tyro.conf.subcommand("diagnose")]
    | Annotated[WhatIf, tyro.conf.subcommand("whatif")]
    | Annotated[WhatIfShow, tyro.conf.subcommand("whatif-show")]
    | Annotated[Benchmark, tyro.conf.subcommand("benchmark")]
    | Annotated[Export, tyro.conf.subcommand("export")]
    | Annotated[WritePlugin, tyro.conf.subcommand("plugin")]
    | Annotated[RunRig, tyro.conf.subcommand("run")]
    | Annotated[View, tyro.conf.subcommand("view")]
    | Annotated[Listing, tyro.conf.subcommand("list")]
)


def parse(program: str, arguments: Sequence[str]) -> Command:
    """Return the command that is meant.

    Args:
        program: Its name.
        arguments: The words after it.

    Raises:
        CableError: They cannot be understood.
        SystemExit: They requested help, which was printed.
    """
    parsed: Any = Command
    about: str | None = "Bowden cables in MuJoCo. `--version` says which this is."
    if arguments and not arguments[0].startswith("-"):
        parsed, about = look_up("command", arguments[0], COMMANDS), None
        program = f"{program} {arguments[0]}"
    _require_full(arguments)
    _require_own_options(arguments)
    for word in arguments:
        require_new_name(word.partition("=")[0])
    words = list(arguments)[about is None :]
    captured = io.StringIO()
    try:
        with contextlib.redirect_stderr(captured):
            found: Command = tyro.cli(
                parsed, prog=program, description=about, args=words
            )
            return found
    except SystemExit as stop:
        if not stop.code:
            raise
        sentence = _error_sentence(captured.getvalue())
        raise CableError(f"{sentence}`{program} --help` shows what works.") from None


def _require_full(arguments: Sequence[str]) -> None:
    """Refuse empty words, an empty path being the current folder, and no UTF-8."""
    for place, word in enumerate(arguments):
        require_utf8(word)
        option, equals, value = word.partition("=")
        given = value if equals and option.startswith("--") else word
        if given.strip():
            continue
        before = arguments[place - 1] if place else ""
        name = option if equals else before if before.startswith("-") else "a word"
        raise CableError(f"{name} is empty; give it a value or leave it out.")


def _error_sentence(box: str) -> str:
    """Make a clause of the box that tyro draws around an error, and perhaps a hint.

    The box has a title and paragraphs between rules. Where standard output can show
    only ASCII, rules are of hyphens and one lies under the title.
    """
    bare = [line.strip("│") for line in box.splitlines() if line[:1] not in "╭╰"]
    lines = [line.strip() for line in bare]
    if missing := [
        n for n, line in enumerate(lines) if line.startswith("Missing from ")
    ]:
        lines[missing[0] + 1 :] = _described(bare[missing[0] + 1 :])
    text = " ".join("\n" if line and not line.strip("─-") else line for line in lines)
    paragraphs = re.sub(r" +", " ", text).split("\n")
    what, *more = paragraphs if "╭" in box else paragraphs[1:]
    what = what.replace("(required)", "").strip(" .:,")
    near = re.search(r"Perhaps you meant:.*?(--[\w-]+)", more[0] if more else "")
    hint = f"did you mean {near[1]}? " if near else ""
    return f"{what[:1].lower()}{what[1:]}; {hint}"


def _require_own_options(arguments: Sequence[str]) -> None:
    """Refuse a second value after an option that takes one."""
    for option, value, stray in zip(
        arguments, arguments[1:], arguments[2:], strict=False
    ):
        if option in REPEATED and "=" in value and "=" in stray and stray[0] != "-":
            raise CableError(f"each value needs its own option, {option} {stray}.")


def _described(lines: list[str]) -> list[str]:
    """Put a comma between each name and its help, deeper indented lines of a box."""
    depths = [len(line) - len(line.lstrip()) for line in lines]
    end = next((n for n, each in enumerate(depths) if each < depths[0]), len(lines))
    text = ""
    for depth, before, line in zip(depths, [0, *depths], lines[:end], strict=False):
        words = line.replace("(required)", "").strip()
        if depth == depths[0]:
            text = f"{text.strip(' .')}; {words}" if text else words
        elif before == depths[0]:
            text += f", {words[:1].lower()}{words[1:]}"
        else:
            text += f" {words}"
    return [text, *map(str.strip, lines[end:])]
