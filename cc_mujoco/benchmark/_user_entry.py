"""A user's controller in a process of its own.

    law = Entry("my_module:my_function", drives, prefixes)     # a `Controller`
    torque = law.torque(measured)

The benchmark's process, the judge, sends it the drive and the measurements as bytes and
receives torques, nothing else: plants, seeds, key and scores stay where they are. On
Linux `_confinement` closes other ways to them. The judge measures the time of a step. A
process ends with its cells (`end_entries`), so that an entry remembers no plant.
"""

import atexit
import contextlib
import ctypes
import faulthandler
import json
import math
import os
import pickle
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from cc_mujoco._utils.provenance import code_provenance
from cc_mujoco.benchmark import _confinement as confinement
from cc_mujoco.control import Controller
from cc_mujoco.control import _registry as registry
from cc_mujoco.control._controller import limit_torques
from cc_mujoco.device._drive import Drive
from cc_mujoco.errors import CableError

_LENGTH_HEADER = struct.Struct("<q")
_ANSWER_HEADER = struct.Struct("<qqqq")
"""Key, number of dimensions (0 to 2), the first two of them or 1."""

ANSWER_TIME = 120.0  # for an answer on all plants, with compilation [s]

_processes: "dict[str, _Process]" = {}  # of every entry that this one judges
_files: dict[str, dict[str, str]] = {}  # digests of the files that entries loaded


def end_entries() -> None:
    """End the processes of all entries; the next `Entry` of each starts another."""
    while _processes:
        _processes.popitem()[1].end()


def controller_provenance(*names: str) -> dict[str, Any]:
    """Return the `code_provenance` of controllers that were made before.

    One in a process of its own contributes the files that it loaded there.
    """
    others = [name for name in names if not registry.runs_code(name)]
    found = code_provenance(
        *(n for other in others for n in registry.named_laws(other))
    )
    for name in filter(registry.runs_code, names):
        found["files"] |= _files[name]
    return found


def blank_command_line(*options: str) -> None:
    """Overwrite secret options in this process's command line, which others see.

    Only on Linux; elsewhere nothing is changed.
    """
    if sys.platform != "linux":
        return
    with open("/proc/self/stat", "rb") as file:
        fields = file.read().rpartition(b")")[2].split()
    start, end = int(fields[45]), int(fields[46])  # of its words, as bytes
    place, last = start, b""
    for word in ctypes.string_at(start, end - start).split(b"\0"):
        option, _, value = word.partition(b"=")
        secret = value if os.fsdecode(option) in options else word
        if secret is value or os.fsdecode(last) in options:
            ctypes.memset(place + len(word) - len(secret), ord("*"), len(secret))
        place, last = place + len(word) + 1, word


class Entry(Controller):
    """Proxy of a controller that runs in a process of its own."""

    def __init__(
        self, name: str, drives: Sequence[Sequence[Drive]], prefixes: Sequence[str]
    ) -> None:
        """Create the controller in its process, which starts if it does not run yet.

        `drives` has each axis's drive for each plant, `prefixes` its column prefix.
        """
        super().__init__(drives[0][0])
        self.name = name
        self._drives = tuple(drives[0])
        if name not in _processes or _processes[name].process.poll() is not None:
            _processes[name] = _Process(name)
        self._process = _processes[name]
        self._key = self._process.make(drives, prefixes)
        # Calls, and for each plant how many gave a torque beyond the motor's
        self.calls, self.cut = 0, np.zeros(len(drives))

    @property
    def spent(self) -> float:
        """Time of the last answer with that of its pipe [s].

        On Linux it is processor time since the answer before, by the kernel.
        """
        return self._process.spent

    def reset(self, where: NDArray[np.bool_] | None = None) -> None:
        self._process.ask("reset", self._key, where)

    def torque(self, observation: Mapping[str, Any]) -> Any:
        answer = self._process.ask("torque", self._key, dict(observation))
        try:
            _, dimensions, *shape = _ANSWER_HEADER.unpack_from(answer)
            values = np.frombuffer(answer, dtype=np.float64, offset=_ANSWER_HEADER.size)
            torque = values.copy().reshape(shape[: max(dimensions, 0)])
        except (struct.error, ValueError):
            raise CableError(
                f"controller {self.name!r} did not answer with torques."
            ) from None
        limited = limit_torques(torque, self._drives)
        beyond = np.abs(torque) > np.abs(limited)
        if beyond.size % self.cut.size == 0:  # else it is refused
            self.cut += beyond.reshape(self.cut.size, -1).any(axis=1)
            self.calls += 1
        return limited


class _Process:
    def __init__(self, name: str) -> None:
        self._name = name
        self._due = math.inf  # time on the monotonic clock when an answer is too late
        self.spent = self._counted = 0.0
        self._folder = tempfile.TemporaryDirectory(prefix="cc_mujoco_entry_")
        confinement.hide_memory()
        own = self._folder.name
        program = (
            f"import runpy; runpy.run_path({confinement.__file__!r})['confine']({own!r}"
            f"); import sys; sys.path[:] = {[place for place in sys.path if place]!r}; "
            "from cc_mujoco.benchmark._user_entry import serve; serve()"
        )
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-c", program],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # an interruption is the judge's alone
            env={**os.environ, "TMPDIR": own},
        )
        atexit.register(self.end)
        threading.Thread(target=self._end_when_due, daemon=True).start()

    def _end_when_due(self) -> None:
        while self.process.poll() is None:
            time.sleep(0.5)
            if time.monotonic() > self._due:
                if hasattr(signal, "SIGUSR1"):  # prints where it is
                    self.process.send_signal(signal.SIGUSR1)
                    time.sleep(0.5)
                self.process.kill()

    def make(self, drives: Sequence[Sequence[Drive]], prefixes: Sequence[str]) -> int:
        """Create a controller in the process; return its key for later requests."""
        answer = json.loads(self.ask("make", 0, (self._name, drives, prefixes)))
        files = answer.get("files") if isinstance(answer, dict) else None
        if not isinstance(files, dict):
            raise CableError(f"controller {self._name!r} did not say what it is of.")
        _files[self._name] = {str(name): str(it) for name, it in files.items()}
        return int(answer["key"])

    def ask(self, what: str, key: int, about: Any) -> bytes:
        """Return the answer to a request; raise `CableError` if the process fails."""
        assert self.process.stdin is not None and self.process.stdout is not None
        self._due = time.monotonic() + ANSWER_TIME
        if sys.platform != "linux":
            self._counted = time.perf_counter()
        try:
            _send(self.process.stdin, pickle.dumps((what, key, about)))
            answer = _receive(self.process.stdout)
            self._due = math.inf
            now = _clock(self.process.pid)
            self.spent, self._counted = now - self._counted, now
        except (OSError, EOFError):
            self.end()
            code = self.process.returncode
            if time.monotonic() > self._due:
                called = "its function" if what == "make" else f"`{what}`"
                files = ", ".join(_files.get(self._name, ()))
                where = f" in {files}" if files else ""
                raise CableError(
                    f"controller {self._name!r} hangs{where}: {called} did not return "
                    f"within {ANSWER_TIME:g} s."
                ) from None
            raise CableError(
                f"controller {self._name!r} ended its process, with exit code {code}."
            ) from None
        if answer[:1] == b"!":
            raise CableError(answer[1:].decode("utf-8", errors="replace"))
        return answer[1:]

    def end(self) -> None:
        for pipe in (self.process.stdin, self.process.stdout):
            with contextlib.suppress(OSError):
                if pipe is not None:
                    pipe.close()
        try:
            self.process.wait(1.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        if hasattr(os, "killpg"):  # what it started, too
            with contextlib.suppress(OSError):
                os.killpg(self.process.pid, signal.SIGKILL)
        self._folder.cleanup()
        atexit.unregister(self.end)


def _clock(process: int) -> float:
    """Return the processor time of a process [s]; elsewhere than on Linux, the time."""
    if sys.platform != "linux":
        return time.perf_counter()
    return time.clock_gettime((~process << 3) | 2)


def _end_with_parent() -> None:
    """End this process once its parent is gone, even if an entry never returns."""
    parent = os.getppid()
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)


def serve() -> None:
    if hasattr(signal, "SIGUSR1"):
        faulthandler.register(signal.SIGUSR1)
    registry.External.limits = False  # the judge counts what it cuts
    threading.Thread(target=_end_with_parent, daemon=True).start()
    questions = os.fdopen(os.dup(0), "rb")
    answers = os.fdopen(os.dup(1), "wb")
    # What the entry prints would be taken for answers.
    with open(os.devnull, "rb") as nothing:
        os.dup2(nothing.fileno(), 0)
    os.dup2(2, 1)
    laws: list[Controller] = []
    while True:
        try:
            question = _receive(questions)
        except (OSError, EOFError):
            return
        try:
            answer = b"." + _answer(laws, *pickle.loads(question))
        except CableError as error:
            answer = b"!" + str(error).encode()
        try:
            _send(answers, answer)
        except OSError:
            return


def _answer(laws: list[Controller], what: str, key: int, about: Any) -> bytes:
    if what == "make":
        name, drives, prefixes = about
        laws.append(registry.batched_controller(name, drives, prefixes))
        files = code_provenance(*registry.named_laws(name))["files"]
        reply = {"key": len(laws) - 1, "files": files}
        return json.dumps(reply).encode()
    law = laws[key]
    with registry.controller_errors(law.name or type(law).__name__):
        if what == "reset":
            law.reset(about)
            return b""
        with np.errstate(all="ignore"):  # what diverged is not a number
            torque = np.asarray(law.torque(about), dtype=np.float64)
    shape = (*torque.shape, 1, 1)[:2]  # padded to two dimensions
    header = _ANSWER_HEADER.pack(key, torque.ndim, *shape)
    return header + np.ascontiguousarray(torque).tobytes()


def _send(pipe: IO[bytes], content: bytes) -> None:
    pipe.write(_LENGTH_HEADER.pack(len(content)) + content)
    pipe.flush()


def _receive(pipe: IO[bytes]) -> bytes:
    (length,) = _LENGTH_HEADER.unpack(_read(pipe, _LENGTH_HEADER.size))
    if not 0 <= length <= 1 << 26:  # bytes of the longest answer
        raise EOFError
    return _read(pipe, length)


def _read(pipe: IO[bytes], length: int) -> bytes:
    content = pipe.read(length)
    if len(content) < length:
        raise EOFError
    return content
