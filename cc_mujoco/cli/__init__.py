"""The command `cc-mujoco`: parse, call, print.

    cc-mujoco play wrist --trajectory sine --seed 1
    cc-mujoco reproduce pretension loops
    cc-mujoco whatif --scene wrist --vary friction=0.05:0.3:10 --vary loops=1,2,3
    cc-mujoco benchmark --scene wrist --controllers pi stiction
    cc-mujoco export --scene wrist --controller stiction --out runs/stiction
    cc-mujoco list

Exit codes: 0 done, 2 input that cannot be used (one sentence on standard error; a
diagnosis writes its report on what is wrong all the same), 3 a rig was stopped because
something was amiss, 130 interrupted, 141 nobody reads what it prints. What an
interrupted or failed run was writing is removed, but for what a rig measured; what an
earlier run left stays.
"""

from __future__ import annotations

import _thread
import contextlib
import errno
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from types import FrameType

from cc_mujoco import __version__
from cc_mujoco._utils.user_code import allow
from cc_mujoco.errors import CableError

PROGRAM = "cc-mujoco"

Handler = Callable[[int, FrameType | None], object]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command.

    Args:
        arguments: Words after the program's name; those of the process by default.

    Returns:
        The exit code.
    """
    # Matrices here are small: threads of OpenBLAS wait for each other, which costs a
    # diagnosis a fourth of its processor time.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    _open_closed_streams()
    left = "nothing was written"
    interrupts: list[int] = []
    try:
        with _handle_signals(interrupts):
            # Slow enough to be interrupted in, so not at the top.
            from cc_mujoco.cli._parsing import parse

            warnings.showwarning = _print_warning
            words = sys.argv[1:] if arguments is None else arguments
            if list(words) == ["--version"]:
                print(f"{PROGRAM} {__version__}")
            else:
                allow(words)
                command = parse(PROGRAM, words)
                left = command.interrupted
                from cc_mujoco.cli._options import plain_warnings

                with plain_warnings():
                    command.run()
            sys.stdout.flush()
    except KeyboardInterrupt:
        return _report_interruption(left)
    except BrokenPipeError:  # as in `cc-mujoco list | head`: the reader has enough
        _discard_output()
        return 128 + 13  # as a shell reports what SIGPIPE ended
    except (CableError, OSError) as error:
        if getattr(error, "errno", None) == errno.ENOSPC:  # files report it themselves
            _discard_output()
            error = CableError("cannot write standard output: no space is left.")
        print(f"{PROGRAM}: {error}", file=sys.stderr)
        return 2
    except MemoryError as error:
        print(
            f"{PROGRAM}: out of memory ({error}); shorter episodes need less.",
            file=sys.stderr,
        )
        return 2
    except Exception:
        # What an import makes of an interruption need not be a KeyboardInterrupt.
        if interrupts:
            return _report_interruption(left)
        raise
    return 0


def _print_warning(
    message: Warning | str, category: type[Warning], *_: object, **__: object
) -> None:
    """Print a warning as one sentence; see `warnings.showwarning`."""
    print(f"warning: {message}", file=sys.stderr)


def _report_interruption(left: str) -> int:
    print(f"{PROGRAM}: interrupted, {left}.", file=sys.stderr)
    return 130


def _open_closed_streams() -> None:
    """Open streams that the caller closed (`cc-mujoco list >&-`) to the null device.

    Python has None in its place, and a file opened next would get its number.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode))


def _discard_output() -> None:
    """Keep Python from printing the rest of a broken output again at exit."""
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), sys.stdout.fileno())


@contextlib.contextmanager
def _handle_signals(interrupts: list[int]) -> Iterator[None]:
    """Note interruptions; turn them and a polite kill into exceptions.

    So half-written files are removed. An ignored interruption stays ignored; one that
    arrived where exceptions end (in a callback from C, as of LLVM) arrives again.
    """

    def interrupt(number: int, frame: FrameType | None) -> None:
        interrupts.append(number)
        signal.default_int_handler(number, frame)

    def stop(number: int, _: FrameType | None) -> None:
        sys.exit(128 + number)

    def unraisable(lost: sys.UnraisableHookArgs, /) -> None:
        for kind, number in again.items():
            if issubclass(lost.exc_type, kind):
                # A little later, when the callback has returned.
                threading.Timer(0.01, _thread.interrupt_main, [number]).start()
                return
        previous_hook(lost)

    handlers: dict[int, Handler] = {signal.SIGTERM: stop}
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        handlers[signal.SIGINT] = interrupt
    before = {number: signal.signal(number, do) for number, do in handlers.items()}
    again = {KeyboardInterrupt: signal.SIGINT, SystemExit: signal.SIGTERM}
    previous_hook, sys.unraisablehook = sys.unraisablehook, unraisable
    try:
        yield
    finally:
        sys.unraisablehook = previous_hook
        for number, handler in before.items():
            signal.signal(number, handler)
