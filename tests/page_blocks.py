"""Fenced blocks of the pages, and how each of them runs.

A block runs from the installed wheel, in an empty folder that the blocks of its page
share, with short episodes unless a `study` test runs it. `sh` and `python` run, `xml`,
`toml` and `c` are loaded by what reads them, and `text` is only read. A first line that
is a comment may name a file, which the block is written to, or have marks, separated by
commas, for what the reader needs to run it:

- `in a checkout`: the block runs there, with the environment of the checkout;
- `in another terminal until "TEXT"`: it goes on beside the blocks after it, which start
  once it has printed TEXT;
- `40 s`, `3 minutes`: it takes long, and runs with the marker `study`;
- `in real time`: it needs processors that do nothing else; it runs with `study`, too;
- `2 hours`: it does not run here; the scripts that it calls have its options;
- `with NAME`: it needs what the environment of the tests lacks (`NEEDS`), and only
  `scripts/test_peers NAME` runs it; options of `cc-mujoco` and Python's syntax are
  checked.
"""

from __future__ import annotations

import dataclasses
import os
import re
import shlex
import shutil
import signal
import subprocess
import time
import tomllib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).parents[1]
MADE = {"build", "dist", "runs"}
KINDS = ("sh", "python", "xml", "toml", "c", "text")
NEEDS = (
    "CleanRL",
    "a network",
    "a rig",
    "a screen",
    "mjlab",
    "newton",
    "rsl_rl",
    "Stable-Baselines3",
)
UNITS = {"s": 1, "minute": 60, "minutes": 60, "hour": 3600, "hours": 3600}
STUDY = 1800.0
"""Longest time that a page gives of a block that runs [s]."""

_FENCE = re.compile(r"^( *)```([^\n]*)\n(.*?)^\1```[^\n]*\n?", re.M | re.S)
_COMMENT = re.compile(r"(?:#|//|<!--|/\*) *(.*?) *(?:-->|\*/)?\n")
_FILE = re.compile(r"[\w.]+\.\w+")
_MARK = re.compile(
    r"(?P<checkout>in a checkout)|(?P<real_time>in real time)"
    r'|in another terminal until "(?P<until>[^"]+)"'
    r"|(?P<count>\d+) (?P<unit>s|minutes?|hours?)"
    rf"|with (?P<needs>{'|'.join(NEEDS)})"
)


def found(pattern: str) -> dict[str, Path]:
    """Files of the project by their place in it, without what is made."""
    return {
        path.relative_to(ROOT).as_posix(): path
        for path in sorted(ROOT.rglob(pattern))
        if not any(
            part in MADE or (part.startswith(".") and part != ".github")
            for part in path.relative_to(ROOT).parts
        )
    }


@dataclass(frozen=True)
class Block:
    """Fenced block of a page."""

    place: str
    """Page and line."""
    kind: str
    """Language."""
    code: str
    file: str = ""
    """Name of the file that it is written to."""
    checkout: bool = False
    until: str = ""
    """Text that it prints before the next block can start."""
    seconds: float = 0.0
    """Time that the page gives [s]; 0 where it gives none."""
    real_time: bool = False
    needs: str = ""

    @property
    def group(self) -> str:
        """Return where the block runs."""
        if self.kind == "text":
            return "text"
        if self.needs:
            return f"with {self.needs}"
        if self.seconds > STUDY:
            return "hours"
        place = "checkout" if self.checkout else "wheel"
        return f"{place}, study" if self.seconds or self.real_time else place

    def brief(self) -> Block:
        """Return the block with episodes of half a second and few designs."""
        code = re.sub(r"\bduration=[\d.]+", "duration=0.5", self.code)
        if self.kind == "sh":
            code = re.sub(r" --duration \S+", "", code)
            code = re.sub(r"cc-mujoco (play|whatif) ", r"\g<0>--duration 0.5 ", code)
            code = re.sub(r"(--vary \w+=[\d.]+:[\d.]+):\d+", r"\1:2", code)
        return dataclasses.replace(self, code=code)

    def commands(self, program: str) -> list[list[str]]:
        """Return the arguments of every call of a program in a shell block."""
        if self.kind != "sh":
            return []
        lines = self.code.replace("\\\n", " ").replace("&&", "\n").splitlines()
        calls = [shlex.split(line, comments=True) for line in lines]
        return [words[1:] for words in calls if words[:1] == [program]]


def blocks_of(place: str, text: str) -> list[Block]:
    """Return the blocks of a page.

    Raises:
        ValueError: A block is in no language of `KINDS`, has a mark after another that
            is none, or is a block by its indentation or by tildes.
    """
    other = re.search(
        r"^(~~~| {4,}\S*(cc-mujoco|pip|python) ).*", _FENCE.sub("", text), re.M
    )
    if other is not None:
        raise ValueError(f"{place}: {other[0]!r} is in no fenced block.")
    return [
        _block(f"{place}:{text.count(chr(10), 0, found.start()) + 1}", found)
        for found in _FENCE.finditer(text)
    ]


def _block(place: str, found: re.Match[str]) -> Block:
    indent, kind, code = found.groups()
    code = re.sub(rf"^{indent}", "", code, flags=re.M)
    if kind not in KINDS:
        raise ValueError(f"{place}: a block is in {kind!r}, not in {', '.join(KINDS)}.")
    first = _COMMENT.match(code)
    if first is None:
        return Block(place, kind, code)
    if _FILE.fullmatch(first[1]):
        return Block(place, kind, code, file=first[1])
    marks = [_MARK.fullmatch(mark) for mark in first[1].split(", ")]
    if marks[0] is None:
        return Block(place, kind, code)
    if None in marks:
        raise ValueError(f"{place}: the first line of a block is no list of marks.")
    named = {k: v for m in marks if m for k, v in m.groupdict().items() if v}
    return Block(
        place,
        kind,
        code,
        checkout="checkout" in named,
        real_time="real_time" in named,
        until=named.get("until", ""),
        seconds=float(named.get("count", 0)) * UNITS[named.get("unit", "s")],
        needs=named.get("needs", ""),
    )


PAGES = {place: path.read_text("utf-8") for place, path in found("*.md").items()}
BLOCKS = {place: blocks_of(place, text) for place, text in PAGES.items()}


@dataclass
class Reader:
    """Runs the blocks of a page in their order, as a reader would.

    A checkout is seen through links, so that what is written to `runs` there is in the
    folder of the page as well, and in no checkout.
    """

    folder: Path
    """Empty folder."""
    wheel: Path
    """Folder of the commands of the environment with the wheel."""
    own: Path
    """Folder of the commands of the checkout's environment."""
    _beside: list[subprocess.Popen[bytes]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._page, self._checkout = self.folder / "page", self.folder / "checkout"
        self._page.mkdir()
        self._checkout.mkdir()
        for path in ROOT.iterdir():
            if path.name not in MADE:
                (self._checkout / path.name).symlink_to(path)
        (self._checkout / "runs").symlink_to(self._page / "runs")

    def run(self, block: Block) -> None:
        """Run a block.

        Raises:
            RuntimeError: It fails; the message has the place and the last output.
        """
        if block.file:
            with (self._page / block.file).open("a", encoding="utf-8") as file:
                file.write(block.code)
        elif block.kind == "toml":
            tomllib.loads(block.code)
        if block.kind in ("toml", "text"):
            return
        name = block.file or f"block.{block.kind}"
        if block.kind == "sh":
            words = ["bash", "-euo", "pipefail", "-c", block.code]
        elif block.kind == "python":
            words = ["python", name] if block.file else ["python", "-c", block.code]
        elif block.kind == "xml":
            load = "import sys, cc_mujoco, mujoco; "
            load += "mujoco.MjModel.from_xml_string(sys.argv[1])"
            words = ["python", "-c", load, block.code]
        else:
            (self._page / name).write_text(block.code, "utf-8")
            headers = {path.parent for path in self._page.rglob("*.h")}
            words = ["cc", "-Wall", "-Werror", "-fsyntax-only", name]
            words += [f"-I{path}" for path in headers]
        self._call(block, words)

    def _call(self, block: Block, words: list[str]) -> None:
        environment = {k: v for k, v in os.environ.items() if k[:6] != "PYTHON"}
        commands = self.own if block.checkout else self.wheel
        environment["CHECKOUT"] = str(ROOT)
        if block.checkout:
            (self._page / "runs").mkdir(exist_ok=True)
        environment["PATH"] = f"{commands}{os.pathsep}{environment['PATH']}"
        output = self.folder / f"{block.place.rpartition(':')[2]}.txt"
        with output.open("wb") as file:
            process = subprocess.Popen(
                [shutil.which(words[0], path=environment["PATH"]) or "", *words[1:]],
                cwd=self._checkout if block.checkout else self._page,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        self._beside.append(process)
        end = time.monotonic() + max(300.0, 5.0 * block.seconds)
        while process.poll() is None and time.monotonic() < end:
            if block.until and block.until in output.read_text("utf-8", "replace"):
                return
            time.sleep(0.02)
        if process.poll() != 0:
            last = output.read_text("utf-8", "replace")[-3000:]
            raise RuntimeError(
                f"{block.place}: the block ended with {process.poll()}.\n{last}"
            )

    def close(self) -> None:
        """End what blocks have started and left."""
        for process in self._beside:
            try:
                os.killpg(process.pid, signal.SIGKILL)
            except ProcessLookupError:
                continue
            process.wait()


def counts() -> Counter[str]:
    """Count the blocks of all pages by where they run."""
    return Counter(block.group for block in every_block())


def every_block() -> Iterator[Block]:
    """Yield the blocks of all pages."""
    for blocks in BLOCKS.values():
        yield from blocks


if __name__ == "__main__":
    for name, count in counts().most_common():
        print(f"{count:4} {name}")
