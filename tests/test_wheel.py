"""The built wheel holds everything and works where nothing else of the project is."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest
import wheel_backend

from cc_mujoco.native._library import digest, library
from page_blocks import BLOCKS, ROOT, Block, Reader
from warm_commands import warm

SETUPTOOLS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
SOURCES = ("cc_mujoco", "envs", "assets")
ON_LINUX = sys.platform == "linux"
LIBRARY = "cc_mujoco/native/libcc_mujoco.so"

SMOKE = """
import sys
from pathlib import Path
import gymnasium
import cc_mujoco
for name in ("cc_mujoco/WristHandle-v1", "cc_mujoco/AnkleExo-v1"):
    env = gymnasium.make(name)
    env.reset(seed=0)
    for _ in range(10):
        env.step(env.action_space.sample())
    env.close()
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
        and path.suffix != ".so"  # made of these sources
    }


def run(*command: str | Path, cwd: Path, **settings: str) -> None:
    """Run a command without the settings that could lead it back to the checkout."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    environment |= settings
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
def wheel(copy: Path) -> Path:
    """Build the wheel with the library of other tests.

    The study tests build theirs from a source distribution.
    """
    carried = library()._name if ON_LINUX else "none"
    return build(copy, "--wheel", f"--config-setting=library={carried}")


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Copy the sources.

    In the checkout itself setuptools would also take what an earlier build left behind.
    """
    copy = tmp_path_factory.mktemp("copy")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, copy)
    (copy / "scripts").mkdir()
    shutil.copy(ROOT / "scripts" / "wheel_backend.py", copy / "scripts")
    for name in SOURCES:
        ignore = shutil.ignore_patterns("__pycache__", "*.so")
        shutil.copytree(ROOT / name, copy / name, ignore=ignore)
    return copy


def build(copy: Path, *settings: str) -> Path:
    dist = copy / "dist"
    shutil.rmtree(dist, ignore_errors=True)
    run(
        *(sys.executable, "-m", "build", "--no-isolation", "--outdir", dist, *settings),
        cwd=copy,
    )
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
    return commands


@pytest.mark.wheel
def test_wheel_holds_every_source_file_and_the_library(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    expected = {*source_files()} | ({LIBRARY} if ON_LINUX else set())
    assert {n for n in names if ".dist-info/" not in n} == expected
    assert any(n.endswith("licenses/LICENSE") for n in names)
    assert wheel.stem.endswith("-any") != ON_LINUX


@pytest.mark.wheel
def test_installed_wheel_makes_environments_and_needs_no_compiler(
    installed: Path, tmp_path: Path
) -> None:
    settings = {"CC_MUJOCO_CACHE_DIR": str(tmp_path / "none")}
    settings |= {"PATH": ""} if ON_LINUX else {}
    run(installed / "python", "-c", SMOKE, cwd=tmp_path, **settings)
    assert not ON_LINUX or not list((tmp_path / "none").glob("libcc_mujoco*"))


@pytest.mark.parametrize(
    "content, reason",
    [(None, "cannot be read: No such file"), (b"", "is no library of these sources")],
)
def test_library_of_other_sources_is_refused(
    content: bytes | None,
    reason: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(wheel_backend, "_run", lambda *_: digest())
    file = tmp_path / "given.so"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(SystemExit, match=reason):
        wheel_backend._given(file, tmp_path)


@pytest.mark.study
def test_wheel_compiles_the_library_that_it_carries(copy: Path) -> None:
    with zipfile.ZipFile(build(copy)) as archive:
        assert digest().encode() in archive.read(LIBRARY)


@pytest.mark.study
@pytest.mark.parametrize(
    ("target", "begins", "machine"),
    [
        ("linux-x86_64", b"\x7fELF", b"\x3e\0"),
        ("linux-aarch64", b"\x7fELF", b"\xb7\0"),
        ("macos-arm64", b"\xcf\xfa\xed\xfe", b"\x0c\0\0\1"),
        ("windows-x86_64", b"MZ", b"PE\0\0\x64\x86"),
    ],
)
def test_wheel_of_another_system_carries_its_library(
    target: str, begins: bytes, machine: bytes, copy: Path
) -> None:
    pytest.importorskip("ziglang")
    _, suffix, tag = wheel_backend.TARGETS[target]
    wheel = build(copy, f"--config-setting=target={target}")
    assert wheel.stem.endswith(f"-py3-none-{tag}")
    with zipfile.ZipFile(wheel) as archive:
        library = archive.read(LIBRARY.replace(".so", suffix))
    assert library.startswith(begins)
    assert machine in library[:0x400]
    assert digest().encode() in library


@pytest.mark.wheel
def test_installed_command_starts(installed: Path, tmp_path: Path) -> None:
    run(installed / "cc-mujoco", "play", "--help", cwd=tmp_path)


def run_blocks(blocks: list[Block], commands: Path, folder: Path) -> None:
    """Run blocks of a page in their order, with commands of the installed wheel."""
    reader = Reader(folder, commands, Path(sys.executable).parent)
    try:
        for block in blocks:
            reader.run(block)
    finally:
        reader.close()


@pytest.fixture(scope="module")
def warmed(installed: Path) -> Iterator[Path]:
    with warm(installed) as commands:
        yield commands


def runnable(place: str, study: bool) -> list[Block]:
    """Return the blocks of a page that run here, in a study or always."""
    groups = ["wheel", "checkout"]
    groups += [f"{group}, study" for group in groups if study]
    return [block for block in BLOCKS[place] if block.group in groups]


STUDIED = {
    "cc_mujoco/control/README.md",
    "cc_mujoco/design/README.md",
    "cc_mujoco/diagnosis/reference.md",
    "cc_mujoco/human/README.md",
    "cc_mujoco/metrics/README.md",
    "scripts/examples/README.md",  # `test_own_device_page.py` plays it
}
"""Pages of commands that other tests give as well."""


@pytest.mark.wheel
@pytest.mark.skipif(os.name == "nt", reason="the commands of the pages are for bash")
@pytest.mark.parametrize(
    "place",
    [p for p in BLOCKS if p not in STUDIED and runnable(p, study=False)],
)
def test_blocks_of_a_page_run(place: str, warmed: Path, tmp_path: Path) -> None:
    blocks = [block.brief() for block in runnable(place, study=False)]
    run_blocks(blocks, warmed, tmp_path)


@pytest.mark.study
@pytest.mark.skipif(os.name == "nt", reason="the commands of the pages are for bash")
@pytest.mark.parametrize("place", [p for p in BLOCKS if runnable(p, study=True)])
def test_blocks_of_a_page_run_as_they_are(
    place: str, installed: Path, tmp_path: Path
) -> None:
    run_blocks(runnable(place, study=True), installed, tmp_path)
