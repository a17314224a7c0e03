"""Parsing of the command line into a command with its options."""

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
    """Dataclass of a command; its fields are the options.

    An attribute `interrupted` may say what an interruption leaves behind.
    """

    def run(self) -> int | None:
        """Run the command; return its exit code, None for 0."""


def commands() -> dict[str, EntryPoint]:
    """Return the commands of all installed packages by name.

    Packages are searched directly: an outdated `.egg-info` beside the sources would
    hide the entry points of an installed package.
    """
    return {
        point.name: point
        for package in distributions()
        for point in package.entry_points.select(group=GROUP)
    }


def parse(program: str, arguments: Sequence[str]) -> CommandOptions:
    """Return the command with its options; exit after printing help."""
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
    """Return the entry point of a command; this package's is found without a search."""
    ours = distribution("cc_mujoco").entry_points.select(group=GROUP, name=name)
    return next(iter(ours), None) or look_up("command", name, commands())


def _require_full(arguments: Sequence[str]) -> None:
    """Refuse empty words (an empty path is the current folder) and invalid UTF-8."""
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
    """Return tyro's message as a clause, without its box, with a hint if there is one.

    The box has a title and paragraphs between rules. If standard output is ASCII only,
    rules are of hyphens and there is one below the title.
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
    """Refuse a second value after a repeatable option, which takes one at a time."""
    repeated = ("--vary", "--across", "--subject-to")
    values, strays = arguments[1:], arguments[2:]
    for option, value, stray in zip(arguments, values, strays, strict=False):
        if option in repeated and "=" in value and "=" in stray and stray[0] != "-":
            raise CableError(f"each value needs its own option, {option} {stray}.")


def _described(lines: list[str]) -> list[str]:
    """Join names in a box and their help, which is indented deeper, with commas."""
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
