"""Files are written whole, and only files of the package are replaced."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from argparse import ArgumentTypeError
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from figure_paths import figure_path

from cc_mujoco._utils import atomic_io
from cc_mujoco._utils.atomic_io import (
    METADATA_KEY,
    is_marked,
    replacing,
    replacing_folder,
    require_ours,
    require_own_file,
    require_unmodified,
)
from cc_mujoco._utils.provenance import write_manifest
from cc_mujoco.errors import CableError
from cc_mujoco.report import figure, save


def test_a_folder_with_anything_needs_our_mark(tmp_path: Path) -> None:
    (tmp_path / ".hidden").write_text("nothing")
    (tmp_path / "empty").mkdir()
    for folder in (tmp_path, tmp_path / "new" / "deep"):
        require_ours(folder, lambda _: False)
    assert {path.name for path in tmp_path.iterdir()} == {".hidden", "empty"}
    for make in (
        lambda: (tmp_path / "notes.txt").write_text("mine"),
        lambda: (tmp_path / "link").symlink_to(tmp_path / "gone"),
        lambda: (tmp_path / "linked").symlink_to(tmp_path / "empty"),
        lambda: (tmp_path / "deep" / "empty").mkdir(parents=True),
    ):
        make()
        (path,) = (p for p in tmp_path.glob("[!.]*") if p.name != "empty")
        with pytest.raises(CableError, match=f"{path.name}, which no such run wrote"):
            require_ours(tmp_path, lambda _: False)
        require_ours(tmp_path, lambda folder: folder == tmp_path)
        path.rename(tmp_path / f".{path.name}")


def test_no_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CableError, match="is empty"):
        require_ours("", lambda _: True)
    (tmp_path / "file").touch()
    with pytest.raises(CableError, match="is a file"):
        require_ours(tmp_path / "file", lambda _: True)
    with pytest.raises(CableError, match="cannot write"):
        require_ours(tmp_path / "file" / "inside", lambda _: True)


def test_a_file_that_is_not_ours_is_not_replaced(tmp_path: Path) -> None:
    require_own_file(tmp_path / "new", lambda _: False)
    (tmp_path / "link").symlink_to(tmp_path / "gone")
    with pytest.raises(CableError, match="link is there, and no such run wrote it"):
        require_own_file(tmp_path / "link", lambda _: False)
    require_own_file(tmp_path / "link", lambda path: path == tmp_path / "link")


def test_the_mark_is_read_from_the_content(tmp_path: Path) -> None:
    path = tmp_path / "table.parquet"
    assert not is_marked(path)
    path.write_text("mine")
    assert not is_marked(path)
    table = pa.table({"a": [1.0]})
    pq.write_table(table, path)
    assert not is_marked(path)
    pq.write_table(table.replace_schema_metadata({METADATA_KEY: b"1"}), path)
    assert is_marked(path)


def test_a_figure_replaces_only_figures_of_ours(tmp_path: Path) -> None:
    path = tmp_path / "picture.png"
    assert figure_path(str(path)) == path
    save(path, figure(1.0, 1.0))
    assert figure_path(str(path)) == path
    figure(1.0, 1.0).savefig(path)
    with pytest.raises(ArgumentTypeError, match="no such run wrote it"):
        figure_path(str(path))
    path.write_text("mine")
    with pytest.raises(ArgumentTypeError, match="no such run wrote it"):
        figure_path(str(path))
    for folder in ("", str(tmp_path)):
        with pytest.raises(ArgumentTypeError, match="is a folder"):
            figure_path(folder)


def test_a_full_disk_names_the_file_and_leaves_the_old_one(tmp_path: Path) -> None:
    def write(path: Path) -> None:
        path.write_text("half")
        raise OSError(errno.ENOSPC, "No space left on device")

    (tmp_path / "a").write_text("old")
    with (
        pytest.raises(CableError, match=rf"{tmp_path}/a: No space left on device\.$"),
        replacing(tmp_path / "a") as partial,
    ):
        write(partial)
    assert (tmp_path / "a").read_text() == "old"
    with (
        pytest.raises(CableError, match=rf"{tmp_path}/new/b: No space left"),
        replacing_folder(tmp_path / "new") as folder,
        replacing(folder / "b") as partial,
    ):
        write(partial)
    with (
        pytest.raises(CableError, match=rf"{tmp_path}/new: No space left"),
        replacing_folder(tmp_path / "new") as folder,
    ):
        write(folder / "b")
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_a_file_that_is_not_as_it_was_written_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "table.md").write_text("one")
    require_unmodified(tmp_path, ["table.md"])  # nobody says how it was written
    write_manifest(tmp_path, ["table.md", "plot.png"])
    require_unmodified(tmp_path, ["table.md", "plot.png"])
    (tmp_path / "plot.png").write_text("of another")
    with pytest.raises(CableError, match=r"plot\.png is not as an earlier run wrote"):
        require_unmodified(tmp_path, ["table.md", "plot.png"])
    (tmp_path / "table.md").write_text("my notes")
    with pytest.raises(CableError, match=r"table\.md is not as an earlier run wrote"):
        require_unmodified(tmp_path, ["table.md"])


KILLED = """
import os, signal, sys
from pathlib import Path
from cc_mujoco._utils.atomic_io import replacing, replacing_folder
with replacing_folder(Path("folder")) as folder, replacing(Path("file")) as file:
    file.touch()
    (folder / "inside").touch()
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="processes are not looked up there")
def test_what_a_killed_process_was_writing_is_removed_by_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = str(Path(atomic_io.__file__).parents[2])
    environment = {**os.environ, "PYTHONPATH": package}
    killed = [sys.executable, "-c", KILLED]
    for _ in range(2):  # each leaves its own, and removes that of the other
        subprocess.run(killed, cwd=tmp_path, env=environment)
        assert len(list(tmp_path.iterdir())) == 2
    own = f"{atomic_io._host()}-{os.getpid()}"
    others = [f".file.{own}.partial", ".file.0123abcd-1.partial", ".file.notes.partial"]
    others += [".file.1.partial", ".other.file.0123abcd-99999999.partial"]
    for name in others:  # of a living process, of another machine, of the user
        (tmp_path / name).touch()
    with replacing(tmp_path / "file") as file:
        file.touch()
    with replacing_folder(tmp_path / "folder"):
        pass
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {"file", "folder", *others[1:]}
