"""The command `cc-mujoco`: parse, call, print.

    cc-mujoco play wrist --trajectory sine --seed 1
    cc-mujoco whatif wrist --vary friction=0.05:0.3:10 --vary loops=1,2,3
    cc-mujoco benchmark wrist --controllers pi stiction
    cc-mujoco export wrist --controller stiction --out runs/stiction
    cc-mujoco list

Exit codes: 0 done, 2 unusable input (one sentence on standard error; a diagnosis still
writes a report on what is wrong), 3 a fault stopped a rig, 130 interrupted, 143
terminated, 141 the reader of a pipe closed it. Files that an interrupted or failed run
has not completed are removed, except measurements of a rig. Files of earlier runs stay.
"""

import _thread
import contextlib
import errno
import os
import signal
import sys
import threading
import warnings
from collections.abc import Iterator, Sequence
from types import FrameType

from cc_mujoco import __version__
from cc_mujoco._utils.user_code import allow, user_errors
from cc_mujoco.errors import CableError

PROGRAM = "cc-mujoco"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `arguments`, by default those of the process; return the exit code."""
    # Matrices here are small: threads of OpenBLAS wait for each other, which costs a
    # diagnosis a fourth of its processor time.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    _open_closed_streams()
    left = "nothing was written"
    interrupts: list[int] = []
    code = 0
    try:
        with _handle_signals(interrupts):
            _require_current_folder()
            # Slow enough to be interrupted in, so not at the top.
            from cc_mujoco.cli._parsing import parse

            warnings.showwarning = _print_warning
            words = sys.argv[1:] if arguments is None else arguments
            try:
                if list(words) == ["--version"]:
                    print(f"{PROGRAM} {__version__}")
                else:
                    allow(words)
                    command = parse(PROGRAM, words)
                    left = getattr(command, "interrupted", left)
                    from cc_mujoco._utils.command_options import plain_warnings

                    with plain_warnings(), user_errors("the command", SystemExit):
                        code = command.run() or 0
            finally:  # as after a help, which exits
                sys.stdout.flush()
        if interrupts:  # and the command has finished with what it had
            return _report_interruption("the results are of what was done", interrupts)
        return code
    except KeyboardInterrupt:
        return _report_interruption(left, interrupts)
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
        hint = "shorter episodes need less."
        print(f"{PROGRAM}: out of memory ({error}); {hint}", file=sys.stderr)
        return 2
    except Exception:
        # What an import makes of an interruption need not be a KeyboardInterrupt.
        if interrupts:
            return _report_interruption(left, interrupts)
        raise


def _print_warning(
    message: Warning | str, category: type[Warning], *_: object, **__: object
) -> None:
    print(f"warning: {message}", file=sys.stderr)


def _report_interruption(left: str, signals: Sequence[int]) -> int:
    print(f"{PROGRAM}: interrupted, {left}.", file=sys.stderr)
    return 128 + (signals[-1] if signals else signal.SIGINT)


def _require_current_folder() -> None:
    try:
        os.getcwd()
    except FileNotFoundError:
        raise CableError(
            "the current folder was deleted; change to one that is there."
        ) from None


def _open_closed_streams() -> None:
    """Open streams that the caller closed (`cc-mujoco list >&-`) to the null device.

    Python sets them to None, and the next file to be opened would get their number.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode))


def _discard_output() -> None:
    """Redirect standard output to nothing, so that the flush at exit cannot fail."""
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), sys.stdout.fileno())


@contextlib.contextmanager
def _handle_signals(interrupts: list[int]) -> Iterator[None]:
    """Raise `KeyboardInterrupt` on signals that end the process; append them to a list.

    Unfinished files are thus removed. An ignored signal stays ignored. One that arrives
    in a callback from C, where Python drops exceptions, is raised again shortly after.
    """
    inside = False

    def later(number: int) -> None:
        threading.Timer(0.01, _thread.interrupt_main, [number]).start()

    def interrupt(number: int, frame: FrameType | None) -> None:
        if inside:  # where an exception ends, too
            later(number)
            return
        interrupts.append(number)
        signal.default_int_handler(number, frame)

    def unraisable(lost: "sys.UnraisableHookArgs", /) -> None:
        nonlocal inside
        if interrupts and issubclass(lost.exc_type, KeyboardInterrupt):
            # A little later, when the callback has returned.
            inside = True
            later(interrupts.pop())
            inside = False
            return
        previous_hook(lost)

    ending = ("SIGINT", "SIGTERM", "SIGHUP")  # Windows has no SIGHUP
    before = {
        number: signal.signal(number, interrupt)
        for number in (getattr(signal, name, None) for name in ending)
        if number is not None
        and signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler)
    }
    previous_hook, sys.unraisablehook = sys.unraisablehook, unraisable
    try:
        yield
    finally:
        sys.unraisablehook = previous_hook
        for number, handler in before.items():
            signal.signal(number, handler)
