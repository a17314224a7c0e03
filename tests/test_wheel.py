"""The built wheel holds everything and works where nothing else of the project is."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SETUPTOOLS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
SOURCES = ("cc_mujoco", "envs", "assets")

SMOKE = """
import sys
from pathlib import Path
import gymnasium
import cc_mujoco
from cc_mujoco.cli import main
for name in ("cc_mujoco/WristHandle-v1", "cc_mujoco/AnkleExo-v1"):
    env = gymnasium.make(name)
    env.reset(seed=0)
    for _ in range(10):
        env.step(env.action_space.sample())
    env.close()
assert main(["play", "ankle", "--duration", "0.1", "--out", "out"]) == 0
home = Path(sys.prefix).resolve()
for name, module in list(sys.modules.items()):
    if name.split(".")[0] == "cc_mujoco" and getattr(module, "__file__", None):
        assert Path(module.__file__).resolve().is_relative_to(home), module.__file__
"""


def source_files() -> dict[str, Path]:
    """Map the place of every source file in the wheel to its place in the checkout."""
    inside = {"cc_mujoco": "cc_mujoco", "envs": "cc_mujoco/envs"}
    inside["assets"] = "cc_mujoco/assets"
    return {
        f"{inside[top]}/{path.relative_to(ROOT / top).as_posix()}": path
        for top in SOURCES
        for path in (ROOT / top).rglob("*")
        if path.is_file()
        and "__pycache__" not in path.parts
        and path.suffix not in (".md", ".png", ".webp")  # pages stay with the sources
    }


def run(*command: str | Path, cwd: Path) -> None:
    """Run a command without the settings that could lead it back to the checkout."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    done = subprocess.run(
        command, cwd=cwd, env=environment, text=True, capture_output=True, timeout=600
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"


def test_every_folder_with_modules_is_a_listed_package() -> None:
    folders = {
        place.rpartition("/")[0].replace("/", ".")
        for place in source_files()
        if "/" in place and place.endswith(".py")
    }
    assert folders == set(SETUPTOOLS["packages"])


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the wheel from a source distribution of a copy.

    In the checkout itself setuptools would also take what an earlier build left behind.
    """
    copy = tmp_path_factory.mktemp("copy")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, copy)
    for name in SOURCES:
        ignore = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / name, copy / name, ignore=ignore)
    dist = copy / "dist"
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", dist, cwd=copy)
    (built,) = dist.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install the wheel alone into a fresh environment and return its commands' folder.

    The environment of the tests lends its dependencies through a path file. Python adds
    the folders it names without reading the path files in them, so an editable install
    of the checkout stays behind.
    """
    home = tmp_path_factory.mktemp("fresh") / "venv"
    run(sys.executable, "-m", "venv", "--without-pip", home, cwd=home.parent)
    commands = home / ("Scripts" if os.name == "nt" else "bin")
    run(
        *(sys.executable, "-m", "pip", "--python", commands / "python", "install"),
        *("--quiet", "--no-deps", "--no-index", wheel),
        cwd=home.parent,
    )
    (package,) = home.rglob("cc_mujoco/__init__.py")
    site = package.parents[1]
    lent = [p for p in sys.path if Path(p).name in ("site-packages", "dist-packages")]
    (site / "lent.pth").write_text("\n".join(lent) + "\n")
    lend_compiled(package.parent)
    return commands


def lend_compiled(package: Path) -> None:
    """Give it what Numba has compiled here of the same sources, a minute's work.

    Numba keeps code beside its source, with a stamp of what the sources say.
    """
    for source in (ROOT / "cc_mujoco").rglob("*.py"):
        copy = package / source.relative_to(ROOT / "cc_mujoco")
        for kept in (source.parent / "__pycache__").glob(f"{source.stem}.*.nb[ci]"):
            (copy.parent / "__pycache__").mkdir(exist_ok=True)
            shutil.copy2(kept, copy.parent / "__pycache__")


@pytest.mark.wheel
def test_wheel_holds_every_source_file(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    assert {n for n in names if ".dist-info/" not in n} == set(source_files())
    assert any(n.endswith("licenses/LICENSE") for n in names)


@pytest.mark.wheel
def test_installed_wheel_makes_environments_and_plays(
    installed: Path, tmp_path: Path
) -> None:
    run(installed / "python", "-c", SMOKE, cwd=tmp_path)
    made = {path.name for path in (tmp_path / "out").iterdir()}
    assert made >= {"recording.rrd", "log.parquet", "metrics.json", "summary.png"}


@pytest.mark.wheel
def test_installed_command_starts(installed: Path, tmp_path: Path) -> None:
    run(installed / "cc-mujoco", "play", "--help", cwd=tmp_path)
