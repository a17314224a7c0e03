"""Build backend: that of setuptools, whose wheels get the native library.

On Linux `build_wheel` compiles the sources of the wheel and adds the shared library, so
that `import cc_mujoco` has nothing to compile. Where that is not possible the wheel is
the one of setuptools, and a line on standard error gives the reason. For a target of
`TARGETS` it is compiled by Zig, on any system.

    python -m build --wheel                    # with the library compiled for it
    python -m build --wheel -C target=linux-aarch64    # for another system
    python -m build --wheel -C library=FILE    # with one of the same sources
    python -m build --wheel -C library=none    # without

Editable installs are those of setuptools, and so are source distributions, with this
file.
"""

from __future__ import annotations

import base64
import hashlib
import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from pathlib import Path
from typing import Any

from setuptools import build_meta
from setuptools.command.sdist import sdist

Settings = dict[str, Any] | None

build_editable = build_meta.build_editable
build_sdist = build_meta.build_sdist
get_requires_for_build_editable = build_meta.get_requires_for_build_editable
get_requires_for_build_sdist = build_meta.get_requires_for_build_sdist
prepare_metadata_for_build_editable = build_meta.prepare_metadata_for_build_editable
prepare_metadata_for_build_wheel = build_meta.prepare_metadata_for_build_wheel

TARGETS = {
    "linux-x86_64": ("x86_64-linux-gnu.2.17", ".so", "manylinux_2_17_x86_64"),
    "linux-aarch64": ("aarch64-linux-gnu.2.17", ".so", "manylinux_2_17_aarch64"),
    "macos-arm64": ("aarch64-macos.11.0", ".dylib", "macosx_11_0_arm64"),
    "windows-x86_64": ("x86_64-windows-gnu", ".dll", "win_amd64"),
}
"""Names of targets, with Zig's, the ending of a library there and the wheel's tag."""
_LIBRARY = "cc_mujoco/native/libcc_mujoco"
_NEEDED = ("gymnasium", "lazy_loader", "mujoco", "numpy", "scipy")
"""Dependencies of the package that the compilation of the library imports."""
_COMPILE = """
import sys
from pathlib import Path
from cc_mujoco.native._library import build_library
print(build_library(Path(sys.argv[1])))
"""
_DIGEST = "from cc_mujoco.native._library import digest; print(digest())"


class SourceDistribution(sdist):
    """Source distribution that carries this file, which builds its wheel."""

    def make_release_tree(self, base_dir: str, files: list[str]) -> None:
        super().make_release_tree(base_dir, [*files, "scripts/wheel_backend.py"])


def get_requires_for_build_wheel(config_settings: Settings = None) -> list[str]:
    """Return the packages that compiling the library needs besides setuptools."""
    needed = list(build_meta.get_requires_for_build_wheel(config_settings))
    choice, target = _choices(config_settings)
    if choice == "none" or not (target or _can_have_library()):
        return needed
    project = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))
    for dependency in project["project"]["dependencies"]:
        if re.split(r"[^\w.-]", dependency)[0] in _NEEDED:
            needed.append(dependency)
    if choice is None and (target or not _has_compiler()):
        needed += project["project"]["optional-dependencies"]["native"]
    return needed


def build_wheel(
    wheel_directory: str,
    config_settings: Settings = None,
    metadata_directory: str | None = None,
) -> str:
    """Build the wheel, add the library to it and return its name."""
    choice, target = _choices(config_settings)
    name = build_meta.build_wheel(wheel_directory, config_settings, metadata_directory)
    if choice == "none":
        return name
    if not target and not _can_have_library():
        return _without(name, "only wheels for Linux carry one without a target")
    triple, suffix, tag = TARGETS.get(target, ("", ".so", ""))
    plain = Path(wheel_directory) / name
    with tempfile.TemporaryDirectory() as folder:
        tree, made = Path(folder) / "wheel", Path(folder) / "made"
        with zipfile.ZipFile(plain) as archive:
            archive.extractall(tree)
        if choice is None:
            print("cc_mujoco: compiling, for about 20 s", file=sys.stderr, flush=True)
            try:
                made.mkdir()
                library = Path(_run(tree, _COMPILE, made, target=triple)).read_bytes()
            except subprocess.CalledProcessError as error:
                if target:
                    raise SystemExit(f"{target}: {_last_line(error)}") from None
                return _without(name, _last_line(error))
        else:
            library = _given(Path(choice), tree)
    return _pack(plain, library, _LIBRARY + suffix, tag or _tag(library))


def _choices(config_settings: Settings) -> tuple[str | None, str]:
    settings = config_settings or {}
    target = settings.get("target", "")
    if target and target not in TARGETS:
        raise SystemExit(f"target is {target!r}; it may be {', '.join(TARGETS)}.")
    return settings.get("library"), target


def _given(file: Path, tree: Path) -> bytes:
    """Return the content of a library, if it was made of the sources of a wheel."""
    try:
        content = file.read_bytes()
        digest = _run(tree, _DIGEST)
    except OSError as error:
        raise SystemExit(f"{file} cannot be read: {error.strerror}.") from None
    except subprocess.CalledProcessError as error:
        raise SystemExit(f"{file} cannot be checked: {_last_line(error)}.") from None
    if digest.encode() not in content:
        raise SystemExit(
            f"{file} is no library of these sources for the MuJoCo installed here."
        )
    return content


def _last_line(error: subprocess.CalledProcessError) -> str:
    return (error.stderr.strip().splitlines() or ["no reason given"])[-1]


def _can_have_library() -> bool:
    return sys.platform == "linux"


def _has_compiler() -> bool:
    return any(map(shutil.which, ("cc", "clang", "gcc")))


def _without(name: str, reason: str) -> str:
    """Report that a wheel has no native library, and return its name."""
    print(
        f"cc_mujoco: the wheel carries no native library ({reason}); the first import "
        "compiles it, for about 20 s.",
        file=sys.stderr,
    )
    return name


def _run(tree: Path, script: str, *given: Path, target: str = "") -> str:
    """Run a script with the package of an unpacked wheel; return what it prints.

    What it compiles is for a target of Zig, if one is named.
    """
    paths = [str(tree), *filter(None, [os.environ.get("PYTHONPATH")])]
    settings = {
        "PYTHONPATH": os.pathsep.join(paths),
        "PYTHONDONTWRITEBYTECODE": "1",
        "CC_MUJOCO_CACHE_DIR": str(tree.parent / "cache"),
    }
    if target:
        zig = [sys.executable, "-m", "ziglang", "cc", "-target", target]
        settings["CC"] = shlex.join(zig) if os.name != "nt" else " ".join(zig)
    done = subprocess.run(
        [sys.executable, "-P", "-c", script, *map(str, given)],
        env=os.environ | settings,
        check=True,
        capture_output=True,
        text=True,
    )
    return done.stdout.strip()


def _tag(library: bytes) -> str:
    """Return the tag of systems with the glibc that a library needs."""
    found = re.findall(rb"\0GLIBC_(\d+)\.(\d+)", library)
    major, minor = max((int(major), int(minor)) for major, minor in found)
    return f"manylinux_{major}_{minor}_{platform.machine()}"


def _pack(plain: Path, library: bytes, place: str, tag: str) -> str:
    """Replace a wheel by one with a library for a tag; return its name."""
    tag = f"py3-none-{tag}"
    stem = plain.name.removesuffix("-py3-none-any.whl")
    target = plain.with_name(f"{stem}-{tag}.whl")
    files = []
    with zipfile.ZipFile(plain) as archive:
        for file in archive.infolist():
            content = archive.read(file)
            if file.filename.endswith(".dist-info/WHEEL"):
                content = re.sub(rb"(?m)^(Root-Is-Purelib:).*$", rb"\1 false", content)
                content = re.sub(rb"(?m)^Tag: .*$", f"Tag: {tag}".encode(), content)
                added = zipfile.ZipInfo(place, file.date_time)
                added.external_attr = file.external_attr
                added.compress_type = zipfile.ZIP_DEFLATED
                files.append((added, library))
            if file.filename.endswith(".dist-info/RECORD"):
                record = file
            else:
                files.append((file, content))
    lines = [_record_line(file.filename, content) for file, content in files]
    lines.append(f"{record.filename},,\n")
    files.append((record, "".join(lines).encode()))
    with zipfile.ZipFile(target, "w") as archive:
        for file, content in files:
            archive.writestr(file, content)
    plain.unlink()
    return target.name


def _record_line(name: str, content: bytes) -> str:
    code = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=")
    return f"{name},sha256={code.decode()},{len(content)}\n"
