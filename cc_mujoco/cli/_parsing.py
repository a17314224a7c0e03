"""Parsing of a command line into the command that it means."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Sequence
from importlib.metadata import EntryPoint, distribution, distributions
from typing import Annotated, Any, Protocol, Union

import tyro

from cc_mujoco.errors import CableError, look_up, require_new_name, require_utf8

GROUP = "cc_mujoco.commands"
"""Entry points of packages that have commands: `NAME = MODULE:DATACLASS`."""


class CommandOptions(Protocol):
    """A dataclass whose fields are the options of a command.

    It may have `interrupted`, the state after an interruption, if that is not "nothing
    was written".
    """

    def run(self) -> int | None:
        """Run the command; return its exit code, None for 0."""


def commands() -> dict[str, EntryPoint]:
    """Return the commands of all installed packages by name.

    An old `.egg-info` beside the sources does not hide those that are installed.
    """
    return {
        point.name: point
        for package in distributions()
        for point in package.entry_points.select(group=GROUP)
    }


def parse(program: str, arguments: Sequence[str]) -> CommandOptions:
    """Return the command that is meant; help that is requested ends Python."""
    parsed: Any
    about: str | None = None
    if arguments and not arguments[0].startswith("-"):
        parsed = _find(arguments[0]).load()
        program = f"{program} {arguments[0]}"
    else:
        about = "Bowden cables in MuJoCo. `--version` says which this is."
        parsed = Union[
            *(
                Annotated[point.load(), tyro.conf.subcommand(name)]
                for name, point in commands().items()
            )
        ]
    _require_full(arguments)
    _require_own_options(arguments)
    for word in arguments:
        require_new_name(word.partition("=")[0])
    words = list(arguments[1:] if about is None else arguments)  # behind a command
    captured = io.StringIO()
    try:
        with contextlib.redirect_stderr(captured):
            found: CommandOptions = tyro.cli(
                parsed, prog=program, description=about, args=words
            )
            return found
    except SystemExit as stop:
        if not stop.code:
            raise
        sentence = _error_sentence(captured.getvalue())
        raise CableError(f"{sentence}`{program} --help` shows what works.") from None


def _find(name: str) -> EntryPoint:
    """Return a command; ours is found without looking through every package."""
    ours = distribution("cc_mujoco").entry_points.select(group=GROUP, name=name)
    return next(iter(ours), None) or look_up("command", name, commands())


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
    missing = [line.startswith("Missing from ") for line in lines]
    if any(missing):
        first = missing.index(True) + 1
        lines[first:] = _described(bare[first:])
    text = " ".join("\n" if line and not line.strip("─-") else line for line in lines)
    paragraphs = re.sub(r" +", " ", text).split("\n")
    what, *more = paragraphs if "╭" in box else paragraphs[1:]
    what = what.replace("(required)", "").strip(" .:,")
    near = re.search(r"Perhaps you meant:.*?(--[\w-]+)", more[0] if more else "")
    hint = f"did you mean {near[1]}? " if near else ""
    # A value that tyro cannot convert
    if wrong := re.search(
        r"^Error parsing (--[\w-]+): "
        r"(?:.*\b(int|float)\b.*?: "
        r"|no type matching \{None\}\|(.+?) could be instantiated from )"
        r"(\[.*?\]|'.*')",
        what,
    ):
        kind = (wrong[2] or wrong[3]).strip("{}")
        kind = {"int": "a whole number", "float": "a number"}.get(kind.lower(), kind)
        given = wrong[4].replace("', '", " ").strip("[]")
        return f"{wrong[1]} needs {kind}, not {given}; {hint}"
    return f"{what[:1].lower()}{what[1:]}; {hint}"


def _require_own_options(arguments: Sequence[str]) -> None:
    """Refuse a second value after an option that is given once for each of them."""
    repeated = ("--vary", "--across", "--subject-to")
    values, strays = arguments[1:], arguments[2:]
    for option, value, stray in zip(arguments, values, strays, strict=False):
        if option in repeated and "=" in value and "=" in stray and stray[0] != "-":
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
