"""Drawing of the evidence in a second process, which gets ready during the search.

    with Drawer() as drawer:
        drawer.start()
        drawer.begin(gap, evidence)
        drawer.finish(folder)

Drawing is Python, which threads do not run in parallel. What the process does not draw,
as on a full disk, is left to the caller, who reports the reason.
"""

from __future__ import annotations

import gc
import pickle
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from cc_mujoco.diagnosis._report.drawings import save_figures
from cc_mujoco.diagnosis._verdict import Diagnosis, Evidence, Gap
from cc_mujoco.diagnosis.effects import EFFECTS
from cc_mujoco.estimation._least_squares import THREADS
from cc_mujoco.report._figures import figure, style

RECORDING_FILE = "evidence.rrd"
_REQUEST = "request"
_LONGEST = 60.0  # that a process may draw [s]; then it hangs


class Drawer:
    """Process that draws once, into a temporary folder, and ends with the block.

    One that was not started, as on a single core, draws nothing.
    """

    _folder = Path()
    _process: Any = None

    def start(self) -> None:
        if THREADS < 2:
            return
        with suppress(OSError):
            self._folder = Path(tempfile.mkdtemp(prefix="cc-mujoco-"))
            program = (
                f"import sys; sys.path[:] = {[p for p in sys.path if p]!r}; "
                f"from {__name__} import serve; serve({str(self._folder)!r})"
            )
            self._process = subprocess.Popen(
                [sys.executable, "-c", program],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,  # an interruption is the caller's alone
            )

    def begin(self, gap: Mapping[str, Gap], evidence: Evidence) -> None:
        if self._process is not None:
            request = pickle.dumps((Diagnosis("none", "", gap=gap), evidence))
            with suppress(OSError):
                (self._folder / _REQUEST).write_bytes(request)
                self._process.stdin.close()

    def finish(self, folder: Path) -> None:
        """Wait until all that was begun is drawn, and move it to the folder."""
        if self._process is not None and self._process.stdin.closed:
            with suppress(subprocess.TimeoutExpired):
                if self._process.wait(_LONGEST) == 0:
                    for file in self._folder.iterdir():
                        shutil.move(file, folder)

    def __enter__(self) -> Drawer:
        return self

    def __exit__(self, *_: object) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
        if self._folder.name:
            shutil.rmtree(self._folder, ignore_errors=True)


NO_DRAWER = Drawer()  # never started


def serve(folder: str) -> None:
    """Draw what is requested in a folder, if it is before standard input ends."""
    gc.disable()
    from cc_mujoco.diagnosis._report.recording import write_recording

    with style():
        figure(1.0, 1.0).add_subplot()  # imports
    sys.stdin.read()
    request = Path(folder, _REQUEST)
    diagnosis, evidence = pickle.loads(request.read_bytes())
    request.unlink()
    if not EFFECTS.keys() >= set(evidence.isolability.ids):
        sys.exit("an effect of the user has a name that only the caller knows")
    save_figures(Path(folder), diagnosis, evidence)
    write_recording(Path(folder, RECORDING_FILE), evidence)
