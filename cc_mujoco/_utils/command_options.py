"""Parts that the commands share: types of options, and progress bars."""

import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from time import perf_counter, process_time
from typing import Annotated, Any

import tyro

from cc_mujoco.errors import CableWarning


def option_help(metavar: str | None = None) -> object:
    """Return a tyro option whose help omits "(default: None)" and "(default: )"."""
    return tyro.conf.arg(metavar=metavar, help_behavior_hint="")


PROGRESS_INTERVAL = 10.0  # between bars in a file or pipe [s]; the first after 2 s

Scene = Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SCENE")]
Name = Annotated[str | None, option_help("NAME")]
Names = Annotated[tuple[str, ...], option_help("[NAME ...]")]
Added = Annotated[
    tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(metavar="NAME")
]
Allowed = Annotated[
    tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(metavar="MODULE:NAME")
]
"""Code that files may name; the words of a command allow it, see `cli.main`."""
Flag = Annotated[tyro.conf.FlagCreatePairsOff[bool], option_help()]


class _Lines:
    """Standard error for a tqdm bar without a terminal: a line from time to time."""

    def __init__(self) -> None:
        self._due = 0.0
        self._held = ""

    def write(self, text: str) -> None:
        """Write the state of the bar once per `PROGRESS_INTERVAL`, and its last one."""
        self._held = text.strip("\r\n").rstrip() or self._held
        if self._held and (text == "\n" or perf_counter() >= self._due):
            sys.stderr.write(f"{self._held}\n")
            self._held, self._due = "", perf_counter() + PROGRESS_INTERVAL

    def flush(self) -> None:
        sys.stderr.flush()


def progress_options() -> dict[str, Any]:
    """Return options of tqdm: {} on a terminal, else those that write few lines."""
    if sys.stderr.isatty():
        return {}
    first = min(2.0, PROGRESS_INTERVAL)
    return {"file": _Lines(), "delay": first, "mininterval": first}


@contextmanager
def progress_bar(total: float, name: str = "") -> Iterator[Callable[[float], object]]:
    """Show a bar up to `total` [s]; yield a function that takes the time reached."""
    from tqdm import tqdm

    with tqdm(
        desc=name or None,
        total=total,
        unit="s",
        bar_format="{l_bar}{bar}| {n:.1f} of {total:.1f} s",
        disable=not total,
        **progress_options(),
    ) as shown:
        yield lambda time: shown.update(time - shown.n)


@contextmanager
def progress_word(text: str) -> Iterator[None]:
    """Show `text` and the elapsed time during a long task."""
    from tqdm import tqdm

    layout = {"bar_format": "{desc}  {elapsed}", "leave": False}
    with tqdm(desc=text, **layout, **progress_options()):
        yield


@contextmanager
def plain_warnings() -> Iterator[None]:
    """Print each of the package's warnings once, as a line on standard error."""
    usual, shown = warnings.showwarning, set()

    def show(message: Warning | str, category: type[Warning], *where: Any) -> None:
        if not issubclass(category, CableWarning):
            usual(message, category, *where)
        elif str(message) not in shown:
            shown.add(str(message))
            print(f"warning: {message}", file=sys.stderr)

    with warnings.catch_warnings():
        warnings.simplefilter("always", CableWarning)
        warnings.showwarning = show  # type: ignore[assignment]
        yield


@contextmanager
def video_progress_bar(total: float) -> Iterator[Callable[[float], object]]:
    """Show a video's progress as `progress_bar` does, then print its speed."""
    begun = taken = worked = 0.0
    show: Callable[[float], object] = float

    with ExitStack() as stack:

        def progress(time: float) -> object:
            nonlocal begun, taken, worked, show
            if not time:  # not before: the episode has a bar of its own
                show = stack.enter_context(progress_bar(total, "video"))
                begun, worked = perf_counter(), -process_time()
            taken = perf_counter() - begun
            return show(time)

        yield progress
    if taken:
        worked += process_time()
        print(
            f"video: {total:.1f} s of it in {taken:.1f} s, "
            f"{total / taken:.2g} times as fast as real time "
            f"({worked:.1f} s of processor time)\n"
        )
