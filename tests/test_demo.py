"""The first command of the front page does what is said of it."""

from __future__ import annotations

import hashlib
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def is_set_up() -> bool:
    """Return whether `scripts/environment.sh` takes `.venv` as it is."""
    stamp = ROOT / ".venv" / "stamp"
    digest = hashlib.sha256(f"{ROOT} {sys.version}".encode())
    for name in ("pyproject.toml", "requirements.lock"):
        digest.update((ROOT / name).read_bytes())
    return stamp.is_file() and stamp.read_text().strip() == digest.hexdigest()


@pytest.mark.skipif(not is_set_up(), reason="the script would set .venv up anew")
def test_the_demo_says_it_in_six_lines_and_leaves_picture_and_recording(
    tmp_path: Path,
) -> None:
    picture, record = tmp_path / "demo.png", tmp_path / "record"
    words = ["--duration", "1.5", "--out", str(picture), "--record", str(record)]
    done = subprocess.run(
        ["bash", str(ROOT / "scripts" / "demo"), *words],
        capture_output=True,
        text=True,
        timeout=300,
        check=True,
    )
    told = [line for line in done.stdout.splitlines() if line.startswith("- ")]
    assert len(told) == 6
    assert all("nan" not in line for line in told)
    assert "chatter" in told[-1] and "at the motor's end of the flexor" in told[-1]
    assert picture.stat().st_size > 10_000
    left = {p.name for p in record.iterdir()}
    assert {"recording.rrd", "episode.html", "summary.png"} <= left
    (closely,) = (line for line in done.stdout.splitlines() if "closely:" in line)
    assert shutil.which(closely.split()[1])
