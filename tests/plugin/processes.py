"""Scripts that each run in a process of their own, which may crash."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import cc_mujoco

ROOT = Path(cc_mujoco.__file__).parents[1]
DRIVER = """
import os
# What a script spawns imports this anew, and runs no script.
for folder, script in SCRIPTS if __name__ == "__main__" else ():
    child = os.fork() if len(SCRIPTS) > 1 else 0
    if child == 0:
        os.chdir(folder)
        said = os.open("said", os.O_WRONLY | os.O_CREAT)
        os.dup2(said, 1)
        os.dup2(said, 2)
        exec(script)
        break
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    with open(os.path.join(folder, "code"), "w") as file:
        file.write(str(code))
"""


class Ended(NamedTuple):
    """Exit code of a script, what it said, and the folder that it ran in."""

    code: int
    said: str
    folder: Path


def processes(
    start: str, scripts: Mapping[str, str], home: Path, timeout: float = 300.0
) -> dict[str, Ended]:
    """Run every script after a common start, each in a new folder.

    They are forks of one process that has made the start; where there are no forks,
    each makes it anew. All of them may take `timeout` seconds.
    """
    places = {name: home / name.replace(" ", "_") for name in scripts}
    for place in places.values():
        place.mkdir()
    each = [(str(places[name]), script) for name, script in scripts.items()]
    for given in [each] if hasattr(os, "fork") else [[one] for one in each]:
        code = _run(f"{start}\nSCRIPTS = {given!r}\n{DRIVER}", home, timeout)
        if len(given) == 1:
            Path(given[0][0], "code").write_text(str(code))
    return {
        name: Ended(
            int((place / "code").read_text()), (place / "said").read_text(), place
        )
        for name, place in places.items()
    }


def _run(program: str, home: Path, timeout: float) -> int:
    script = home / "program.py"
    script.write_text(program)
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(
        [sys.executable, str(script)], env=environment, timeout=timeout, check=False
    ).returncode
