"""Commands refuse a misspelt device before anything is compiled."""

from __future__ import annotations

import subprocess
import sys

COMMANDS = (
    "play wirst",
    "play wrist --seed -1",
    "device wirst",
    "calibrate wirst",
    "diagnose wirst data --out out",
    "whatif wirst --vary friction=0.1,0.2",
    "whatif wrist --vary friction=0.1,0.2 --workers -1",
    "benchmark wrist wirst",
    "export wirst --controller pi --out out",
)

PROGRAM = """
import sys
from cc_mujoco.cli import main
for line in sys.argv[1:]:
    print(main(line.split()), file=sys.stderr)
print(*({"mujoco", "cc_mujoco.cable._kernel"} & set(sys.modules)))
"""


def test_a_misspelt_device_is_refused_before_anything_is_compiled() -> None:
    done = subprocess.run(
        [sys.executable, "-P", "-c", PROGRAM, *COMMANDS],
        capture_output=True,
        text=True,
        check=True,
    )
    lines = done.stderr.splitlines()
    assert lines[1::2] == ["2"] * len(COMMANDS)
    for command, sentence in zip(COMMANDS, lines[::2], strict=True):
        hint = "did you mean 'wrist'?" if "wirst" in command else "0 or greater"
        assert hint in sentence, command
    assert done.stdout.split() == []
