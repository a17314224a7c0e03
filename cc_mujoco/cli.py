"""The command `cc-mujoco`: parse, call, print.

    cc-mujoco play wrist --trajectory sine --seed 1
    cc-mujoco reproduce pretension loops
    cc-mujoco whatif --scene wrist --vary friction=0.05:0.3:10 --vary loops=1,2,3
    cc-mujoco benchmark --scene wrist --controllers pi stiction
    cc-mujoco list

Exit codes: 0 done, 2 input that cannot be used (one sentence on standard error; a
diagnosis writes its report on what is wrong all the same), 130 interrupted. What an
interrupted or failed run was writing is removed; what an earlier run left stays.
"""

from __future__ import annotations

import contextlib
import io
import re
import signal
import sys
from collections.abc import Iterator, Sequence
from types import FrameType
from typing import Annotated

import tyro

from cc_mujoco.commands.benchmark import Benchmark
from cc_mujoco.commands.diagnose import Diagnose
from cc_mujoco.commands.listing import Listing
from cc_mujoco.commands.play import Play
from cc_mujoco.commands.reproduce import Reproduce
from cc_mujoco.commands.whatif import WhatIf
from cc_mujoco.commands.whatif_show import WhatIfShow
from cc_mujoco.errors import CableError, look_up

PROGRAM = "cc-mujoco"

COMMANDS = {
    "play": Play,
    "reproduce": Reproduce,
    "diagnose": Diagnose,
    "whatif": WhatIf,
    "whatif-show": WhatIfShow,
    "benchmark": Benchmark,
    "list": Listing,
}

Command = (
    Annotated[Play, tyro.conf.subcommand("play")]
    | Annotated[Reproduce, tyro.conf.subcommand("reproduce")]
    | Annotated[Diagnose, tyro.conf.subcommand("diagnose")]
    | Annotated[WhatIf, tyro.conf.subcommand("whatif")]
    | Annotated[WhatIfShow, tyro.conf.subcommand("whatif-show")]
    | Annotated[Benchmark, tyro.conf.subcommand("benchmark")]
    | Annotated[Listing, tyro.conf.subcommand("list")]
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command.

    Args:
        arguments: Words after the program's name; those of the process by default.

    Returns:
        The exit code.
    """
    left = "nothing was written"
    try:
        with _terminating():
            command = _parse(sys.argv[1:] if arguments is None else arguments)
            left = command.interrupted
            command.run()
    except (CableError, OSError) as error:
        print(f"{PROGRAM}: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"{PROGRAM}: interrupted, {left}.", file=sys.stderr)
        return 130
    return 0


def _parse(arguments: Sequence[str]) -> Command:
    """Parse; what cannot be parsed is a `CableError` of one sentence."""
    if arguments and not arguments[0].startswith("-"):
        look_up("command", arguments[0], COMMANDS)
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            return tyro.cli(
                Command,
                prog=PROGRAM,
                description="Bowden cables in MuJoCo.",
                args=list(arguments),
            )
    except SystemExit as stop:
        if not stop.code:
            raise
        raise CableError(_sentence(said.getvalue())) from None


def _sentence(box: str) -> str:
    """Make one sentence of the box that tyro draws around an error.

    The box has a title and paragraphs between rules. Where standard output can show
    only ASCII, rules are of hyphens and one lies under the title.
    """
    lines = [line.strip("│ ") for line in box.splitlines() if line[:1] not in "╭╰"]
    text = " ".join("\n" if line and not line.strip("─-") else line for line in lines)
    paragraphs = re.sub(r" +", " ", text).split("\n")
    what, *more = paragraphs if "╭" in box else paragraphs[1:]
    what = what.replace("(required)", "").strip(" .:,")
    near = re.search(r"Perhaps you meant:.*?(--[\w-]+)", more[0] if more else "")
    hint = f"did you mean {near[1]}? " if near else ""
    return f"{what[:1].lower()}{what[1:]}; {hint}`{PROGRAM} --help` shows what works."


@contextlib.contextmanager
def _terminating() -> Iterator[None]:
    """Turn a polite kill into an exception, so that half-written files are removed."""

    def stop(number: int, _: FrameType | None) -> None:
        sys.exit(128 + number)

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


if __name__ == "__main__":
    sys.exit(main())
