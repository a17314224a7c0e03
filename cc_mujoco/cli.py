"""The command `cc-mujoco`: parse, call, print.

    cc-mujoco play wrist --trajectory sine --seed 1
    cc-mujoco list

Exit codes: 0 done, 2 input that cannot be used (one sentence on standard error),
130 interrupted. What an interrupted or failed run was writing is removed; what an
earlier run left stays.
"""

from __future__ import annotations

import contextlib
import inspect
import io
import math
import re
import signal
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Annotated, Any

import tyro

from cc_mujoco.errors import CableError

PROGRAM = "cc-mujoco"

Name = Annotated[str | None, tyro.conf.arg(metavar="NAME")]
Place = Annotated[Path | None, tyro.conf.arg(metavar="PATH")]


@dataclass(frozen=True)
class Scene:
    """A scene of the command line and what it plays unless told otherwise."""

    environment: str
    """Gymnasium id."""
    trajectory: str
    task: str
    meaning: str


SCENES = {
    "wrist": Scene(
        "cc_mujoco/WristHandle-v0",
        "sweep",
        "tunnel",
        "wrist handle pulled both ways by two Bowden cables",
    ),
    "ankle": Scene(
        "cc_mujoco/AnkleExo-v0",
        "walk",
        "assist",
        "ankle exoskeleton pulled by one Bowden cable past hip and knee",
    ),
}


@dataclass(frozen=True)
class Play:
    """Play an episode; write its recording, log, metrics and figure."""

    scene: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SCENE")]
    """wrist or ankle."""
    trajectory: Name = None
    """How the wearer moves; the default depends on the scene, see `list`."""
    csv: Place = None
    """CSV file with columns time_s and angle_rad to play instead of --trajectory."""
    task: Name = None
    """What the device should make the wearer feel; see `list`."""
    controller: Annotated[str, tyro.conf.arg(metavar="NAME")] = "pi"
    """What drives the motor; see `list`."""
    duration: float = 10.0
    """Length of the episode in seconds."""
    seed: int = 0
    """Seed of everything random; equal seeds give equal recordings."""
    out: Place = None
    """Folder for the results; runs/SCENE-TRAJECTORY-SEED unless given."""

    def run(self) -> None:
        """Play and write; print a table and how to open the recording."""
        scene = _look_up("scene", self.scene, SCENES)
        if self.csv is not None and self.trajectory is not None:
            raise CableError("give --trajectory or --csv, not both.")
        if self.seed < 0:
            raise CableError(f"--seed must be 0 or greater, not {self.seed}.")
        names = {
            "trajectory": self.csv.stem
            if self.csv
            else self.trajectory or scene.trajectory,
            "task": self.task or scene.task,
            "controller": self.controller,
        }
        name = f"{self.scene}-{names['trajectory']}-{self.seed}"
        out = self.out or Path("runs", name)
        if out.exists() and not out.is_dir():
            raise CableError(f"--out {out} is a file; it must be a folder or be free.")

        import gymnasium
        from tqdm import tqdm

        from cc_mujoco.control import controller
        from cc_mujoco.files import require_writable
        from cc_mujoco.recording import play, write_episode

        require_writable(out)

        env = gymnasium.make(
            scene.environment,
            disable_env_checker=True,
            trajectory=self.csv or names["trajectory"],
            task=names["task"],
            duration=self.duration,
        )
        inner: Any = env.unwrapped
        law = controller(self.controller, inner.drive)
        with tqdm(
            total=self.duration,
            unit="s",
            bar_format="{l_bar}{bar}| {n:.1f} of {total:.1f} s",
            disable=not sys.stderr.isatty(),
        ) as bar:
            log = play(
                env,
                law,
                seed=self.seed,
                about=names,
                progress=lambda time: bar.update(time - bar.n),
            )
        found = write_episode(out, log, inner.model)
        env.close()
        for metric in found:
            value = f"{metric.value:.4g}" if math.isfinite(metric.value) else "-"
            print(f"{metric.name:32} {value:>10} {metric.unit}")
        print(f"\nopen with:  rerun {out / 'recording.rrd'}\nsee also:   {out}")


@dataclass(frozen=True)
class Listing:
    """Show the scenes, trajectories, tasks and controllers there are."""

    def run(self) -> None:
        """Print every name with its meaning."""
        from cc_mujoco.control import CONTROLLERS
        from cc_mujoco.human import TASKS, TRAJECTORIES

        meanings = {
            "scenes": {
                name: f"{scene.meaning}; plays {scene.trajectory}, {scene.task}"
                for name, scene in SCENES.items()
            },
            "trajectories": _meanings(TRAJECTORIES),
            "tasks": _meanings(TASKS),
            "controllers": _meanings(CONTROLLERS),
        }
        width = max(len(name) for group in meanings.values() for name in group)
        for number, (group, entries) in enumerate(meanings.items()):
            print(("\n" if number else "") + group)
            for name, meaning in entries.items():
                print(f"  {name:{width}}  {meaning}")


Command = (
    Annotated[Play, tyro.conf.subcommand("play")]
    | Annotated[Listing, tyro.conf.subcommand("list")]
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command.

    Args:
        arguments: Words after the program's name; those of the process by default.

    Returns:
        The exit code.
    """
    try:
        with _terminating():
            _parse(sys.argv[1:] if arguments is None else arguments).run()
    except (CableError, OSError) as error:
        print(f"{PROGRAM}: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"{PROGRAM}: interrupted, nothing was written.", file=sys.stderr)
        return 130
    return 0


def _parse(arguments: Sequence[str]) -> Play | Listing:
    """Parse; what cannot be parsed is a `CableError` of one sentence."""
    if arguments and not arguments[0].startswith("-"):
        _look_up("command", arguments[0], {"play": Play, "list": Listing})
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            return tyro.cli(
                Command,
                prog=PROGRAM,
                description="Bowden cables in MuJoCo: play episodes, keep them.",
                args=list(arguments),
            )
    except SystemExit as stop:
        if not stop.code:
            raise
        raise CableError(_sentence(said.getvalue())) from None


def _sentence(box: str) -> str:
    """Make one sentence of the box that tyro draws around an error.

    The box has a title and paragraphs between rules. Where standard output can show
    only ASCII, rules are of hyphens and one lies under the title.
    """
    lines = [line.strip("│ ") for line in box.splitlines() if line[:1] not in "╭╰"]
    text = " ".join("\n" if line and not line.strip("─-") else line for line in lines)
    paragraphs = re.sub(r" +", " ", text).split("\n")
    what, *more = paragraphs if "╭" in box else paragraphs[1:]
    what = what.replace("(required)", "").strip(" .:,")
    near = re.search(r"Perhaps you meant:.*?(--[\w-]+)", more[0] if more else "")
    hint = f"did you mean {near[1]}? " if near else ""
    return f"{what[:1].lower()}{what[1:]}; {hint}`{PROGRAM} --help` shows what works."


@contextlib.contextmanager
def _terminating() -> Iterator[None]:
    """Turn a polite kill into an exception, so that half-written files are removed."""

    def stop(number: int, _: FrameType | None) -> None:
        sys.exit(128 + number)

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _look_up(kind: str, name: str, registry: Mapping[str, Any]) -> Any:
    if name not in registry:
        raise CableError.unknown(kind, name, registry)
    return registry[name]


def _meanings(registry: Mapping[str, object]) -> dict[str, str]:
    """Return the first line of every entry's documentation."""
    lines = {name: inspect.getdoc(entry) or "" for name, entry in registry.items()}
    return {name: text.partition("\n")[0] for name, text in lines.items()}
