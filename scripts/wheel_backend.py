"""Build backend: that of setuptools, whose wheels get the compiled engine plugin.

On Linux on x86-64 `build_wheel` compiles the sources of the wheel and adds the shared
library, so that `import cc_mujoco` has nothing to compile. Where that is not possible
the wheel is the one of setuptools, and a line on standard error gives the reason.

    python -m build --wheel                   # with the plugin compiled for it
    python -m build --wheel -C plugin=FILE    # with one that `cc-mujoco plugin` wrote
    python -m build --wheel -C plugin=none    # without

Editable installs are those of setuptools, and so are source distributions, with this
file.
"""

from __future__ import annotations

import base64
import hashlib
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from importlib.util import find_spec
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

_PLUGIN = "cc_mujoco/plugin/libcc_mujoco_cable.so"
_NEEDED = ("gymnasium", "lazy_loader", "mujoco", "numba", "numpy")
"""Dependencies of the package that the compilation of the plugin imports."""
_COMPILE = "import sys, cc_mujoco.export as e; e.write_plugin(sys.argv[1])"
_DIGEST = """
import sys
from pathlib import Path
from cc_mujoco._utils.code_stamp import digest
package = Path(sys.argv[1])
print(digest(package / "plugin" / "_registration.py", package))
"""


class SourceDistribution(sdist):
    """Source distribution that carries this file, which builds its wheel."""

    def make_release_tree(self, base_dir: str, files: list[str]) -> None:
        """Copy the files of setuptools and this one."""
        super().make_release_tree(base_dir, [*files, "scripts/wheel_backend.py"])


def get_requires_for_build_wheel(config_settings: Settings = None) -> list[str]:
    """Return what the compilation of the plugin needs beside setuptools."""
    needed = list(build_meta.get_requires_for_build_wheel(config_settings))
    choice = (config_settings or {}).get("plugin")
    if not _can_have_plugin() or choice == "none":
        return needed
    project = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))
    for dependency in project["project"]["dependencies"]:
        if re.split(r"[^\w.-]", dependency)[0] in _NEEDED:
            needed.append(dependency)
    if choice is None and shutil.which("ld") is None:
        needed += project["project"]["optional-dependencies"]["native"]
    return needed


def build_wheel(
    wheel_directory: str,
    config_settings: Settings = None,
    metadata_directory: str | None = None,
) -> str:
    """Build the wheel, add the plugin to it and return its name.

    Raises:
        SystemExit: The file of the setting `plugin` is no plugin of these sources.
    """
    name = build_meta.build_wheel(wheel_directory, config_settings, metadata_directory)
    choice = (config_settings or {}).get("plugin")
    if choice == "none":
        return name
    if not _can_have_plugin():
        return _without(name, "only Linux on x86-64 can load it")
    if choice is None and shutil.which("ld") is None and find_spec("ziglang") is None:
        return _without(name, "it takes a linker, `ld` or `ziglang`")
    plain = Path(wheel_directory) / name
    with tempfile.TemporaryDirectory() as folder:
        tree, made = Path(folder) / "wheel", Path(folder) / "made"
        with zipfile.ZipFile(plain) as archive:
            archive.extractall(tree)
        if choice is None:
            print(
                "cc_mujoco: compiling the plugin, for one to two minutes",
                file=sys.stderr,
                flush=True,
            )
            try:
                _run(tree, _COMPILE, made)
            except subprocess.CalledProcessError as error:
                return _without(name, _last_line(error))
            library = (made / Path(_PLUGIN).name).read_bytes()
        else:
            library = _given(Path(choice), tree)
    return _pack(plain, library)


def _given(file: Path, tree: Path) -> bytes:
    """Return the content of a library, if it was made of the sources of a wheel."""
    try:
        content = file.read_bytes()
        digest = _run(tree, _DIGEST, tree / "cc_mujoco")
    except OSError as error:
        raise SystemExit(f"{file} cannot be read: {error.strerror}.") from None
    except subprocess.CalledProcessError as error:
        raise SystemExit(f"{file} cannot be checked: {_last_line(error)}.") from None
    if digest.encode() not in content:
        raise SystemExit(
            f"{file} is no plugin of these sources for the MuJoCo installed here; "
            "write it anew with `cc-mujoco plugin`."
        )
    return content


def _last_line(error: subprocess.CalledProcessError) -> str:
    return (error.stderr.strip().splitlines() or ["no reason given"])[-1]


def _can_have_plugin() -> bool:
    return sys.platform == "linux" and platform.machine() == "x86_64"


def _without(name: str, reason: str) -> str:
    """Report that a wheel has no compiled plugin, and return its name."""
    print(
        f"cc_mujoco: the wheel carries no compiled plugin ({reason}); the first "
        "import compiles it, for one to two minutes.",
        file=sys.stderr,
    )
    return name


def _run(tree: Path, script: str, *given: Path) -> str:
    """Run a script with the package of an unpacked wheel; return what it prints."""
    paths = [str(tree), *filter(None, [os.environ.get("PYTHONPATH")])]
    # The compiler's cache does not belong into the wheel.
    settings = {
        "PYTHONPATH": os.pathsep.join(paths),
        "PYTHONDONTWRITEBYTECODE": "1",
        "NUMBA_CACHE_DIR": str(tree.parent / "cache"),
    }
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
    return f"py3-none-manylinux_{major}_{minor}_x86_64"


def _pack(plain: Path, library: bytes) -> str:
    """Replace a wheel by one that holds a library as well, and return its name."""
    tag = _tag(library)
    stem = plain.name.removesuffix("-py3-none-any.whl")
    target = plain.with_name(f"{stem}-{tag}.whl")
    files = []
    with zipfile.ZipFile(plain) as archive:
        for file in archive.infolist():
            content = archive.read(file)
            if file.filename.endswith(".dist-info/WHEEL"):
                content = re.sub(rb"(?m)^(Root-Is-Purelib:).*$", rb"\1 false", content)
                content = re.sub(rb"(?m)^Tag: .*$", f"Tag: {tag}".encode(), content)
                added = zipfile.ZipInfo(_PLUGIN, file.date_time)
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
