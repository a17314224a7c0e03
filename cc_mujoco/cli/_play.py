"""`cc-mujoco play`: play an episode, or show the log of a real run."""

from __future__ import annotations

import dataclasses
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from cc_mujoco._utils import command_options as options
from cc_mujoco.errors import CableError

if TYPE_CHECKING:
    from cc_mujoco.metrics import Metric
    from cc_mujoco.simulation import EpisodeLog


@dataclass(frozen=True)
class Play:
    """Play an episode; write its recording, log, metrics and figure."""

    scene: options.Scene
    """A device: a built-in name (`cc-mujoco list`), or your MJCF file."""
    replay: Annotated[Path | None, options.option_help("LOG")] = None
    """Instead of an episode: show a log of `cc-mujoco run`; SCENE may be a file."""
    trajectory: options.Name = None
    """Motion of the wearer: a name, NAME:AMPLITUDE, a table with columns time_s and
    angle_rad (or time_ms, knee_angle_deg) or an OpenSim .mot, or MODULE:NAME; the
    default depends on the scene."""
    task: options.Name = None
    """Torque that the device should render: a name, NAME:NUMBER (hold:-12,
    spring:2.5), a table of torque_nm over phase or time_s, or MODULE:NAME; the default
    depends on the scene."""
    column: Annotated[
        tyro.conf.UseAppendAction[tuple[str, ...]],
        tyro.conf.arg(metavar="JOINT=COLUMN"),
    ] = ()
    """Column of a table for a joint, once each: ankle=ankle_angle_r; -ankle_angle_r
    turns its sign, ankle_angle_r_deg gives a unit that the file lacks."""
    side: options.Name = None
    """Leg of a table with two, for joints that name no side; right unless given."""
    controller: options.Name = None
    """Controller of the motor: a name, MODULE:FUNCTION or POLICY.safetensors;
    pi_tuned by default or, where the task commands an angle, backlash_inverse or
    none."""
    duration: float = 10.0
    """Length of the episode in seconds."""
    seed: int = 0
    """Seed of everything random; equal seeds give equal logs."""
    out: Annotated[Path | None, options.option_help("DIR")] = None
    """Folder for the results; runs/SCENE-TRAJECTORY-TASK-CONTROLLER-SEED by default,
    with the duration behind it if it is another."""

    metric: options.Added = ()
    """A metric to measure besides, once each: a name or MODULE:NAME."""
    video: options.Flag = False
    """Write video.mp4, too: the scene beside torques and tensions."""
    html: options.Flag = False
    """Write episode.html, too: a page that plays the episode in any browser."""
    live: options.Flag = False
    """Play in a window, in real time, until it is closed, and write nothing; its keys
    change friction, pretension and controller."""
    allow: options.Allowed = ()
    """Code that files may name, once each; code that only a file names is refused."""

    def run(self) -> None:
        if self.replay is not None:
            self._show_log(self.replay)
        elif self.live:
            self._play_live()
        else:
            self._record()

    def _record(self) -> None:
        names = self._names()
        # Controllers from elsewhere have a colon in their names, or a path.
        parts = [Path(self.scene).stem, *names.values(), str(self.seed)]
        if self.duration != Play.duration:
            parts.append(f"{self.duration:g}s")
        name = re.sub(r"[^\w.-]+", "_", "-".join(parts))
        out = self.out or Path("runs", name)

        from cc_mujoco.control import axes_controller
        from cc_mujoco.metrics import find_metric
        from cc_mujoco.simulation import EpisodeLog, simulate
        from cc_mujoco.simulation._episode_findings import Guards, episode_findings
        from cc_mujoco.viz import write_episode
        from cc_mujoco.viz._episode_files import LOG_FILE, require_ours
        from cc_mujoco.viz._summary import GUARD_METADATA_KEY

        require_ours(out, self.video, self.html)

        metrics = [find_metric(name) for name in self.metric]
        env = self._env(names)
        inner: Any = env.unwrapped
        device, model, prefixes = inner.device, inner.model, inner.exo.device.prefixes
        worn = inner.exo.description
        law = axes_controller(names["controller"], inner.drives, prefixes)
        guards = Guards(law, worn)
        self._warn(inner, names)
        env.close()
        del env, inner  # with them goes a script as long as the episode

        def episode(file: Path) -> EpisodeLog:
            with options.progress_bar(self.duration) as progress:

                def passed(time: float) -> None:
                    guards.look(time)
                    progress(time)

                log = simulate(
                    device,
                    law,
                    trajectory=names["trajectory"],
                    task=names["task"],
                    seed=self.seed,
                    duration=self.duration,
                    about=names,
                    progress=passed,
                    file=file,
                )
            log.metadata[GUARD_METADATA_KEY] = [*guards.findings()]
            return log

        messages: list[str] = []
        filmed = self.duration if self.video else 0.0  # [s]
        with options.video_progress_bar(filmed) as progress:
            found = write_episode(
                out,
                episode,
                model,
                metrics=metrics,
                video=self.video,
                html=self.html,
                progress=progress,
                say=messages.append,
            )
        print("\n".join(_table(found, prefixes)))
        played = EpisodeLog.open(out / LOG_FILE)
        seen = episode_findings(played, model, worn, names["controller"])
        for finding in (*guards.findings(), *seen):
            print(f"warning: {finding}", file=sys.stderr)
        print(f"\nopen with:  rerun {out / 'recording.rrd'}\nsee also:   {out}")
        for sentence in messages:
            print(sentence)

    def _names(self) -> dict[str, str]:
        from cc_mujoco.device._device_files import locate

        locate(self.scene)
        if self.seed < 0:
            raise CableError(f"--seed must be 0 or greater, not {self.seed}.")
        from cc_mujoco.control._registry import default_controller
        from cc_mujoco.device import find_device
        from cc_mujoco.simulation._simulate import task_label

        device = find_device(self.scene).description
        names = {
            "trajectory": self.trajectory or device.trajectory,
            "task": task_label(device, self.task),
        }
        if self.column or self.side:
            from cc_mujoco.device._axis_columns import split_by_axis
            from cc_mujoco.human._by_text import with_columns

            axes = [axis.name for axis in device.axes]
            tasks = split_by_axis(names.pop("task"), axes)
            texts = tasks if isinstance(tasks, dict) else dict.fromkeys(axes, tasks)
            texts |= with_columns(names | texts, self.column, self.side)
            names["trajectory"] = texts.pop("trajectory", names["trajectory"])
            names["task"] = task_label(device, texts)
        law = self.controller or default_controller(device, self.task)
        return names | {"controller": law}

    def _env(self, names: dict[str, str]) -> Any:
        import gymnasium

        return gymnasium.make(
            "cc_mujoco/Device-v1",
            disable_env_checker=True,
            device=self.scene,
            trajectory=names["trajectory"],
            task=names["task"],
            duration=self.duration,
        )

    def _warn(self, env: Any, names: Mapping[str, str]) -> None:
        """Warn if the task needs more torque than the motor has; print notes."""
        env.reset(seed=self.seed)
        if beyond := env.beyond():
            print(f"warning: {names['task']}: {beyond}", file=sys.stderr)
        if note := env.exo.author.note:
            print(note)
        assumed = [
            f"{axis.safe_torque:g} N m at joint {axis.limb!r}"
            for axis in env.exo.description.axes
            if axis.safe_is_assumed
        ]
        if assumed:
            print(
                f"assumed safe torque: {', '.join(assumed)}, where controllers let the "
                "joint go; `safe_torque` in [axis] of the description is another."
            )

    def _play_live(self) -> None:
        self._refuse_other_options("live", "metric", "video", "html", "out")
        names = self._names()

        from cc_mujoco.viz._live import live
        from cc_mujoco.viz._viewer import require_screen

        require_screen()
        env = self._env(names)
        self._warn(env.unwrapped, names)
        live(env, names["controller"], seed=self.seed)
        env.close()

    def _show_log(self, log: Path) -> None:
        names = [field.name for field in dataclasses.fields(self)]
        others = [name for name in names if name not in ("scene", "replay")]
        self._refuse_other_options("replay", *others)

        from cc_mujoco.hardware._replay import replay

        recording, summary = replay(log, self.scene)
        print(f"open with:  rerun {recording}\nsee also:   {summary}")

    def _refuse_other_options(self, name: str, *others: str) -> None:
        plain = Play(self.scene)
        for other in others:
            if getattr(self, other) != getattr(plain, other):
                raise CableError(f"--{other} does not go with --{name}.")


def _table(found: Mapping[Metric, float], prefixes: Sequence[str]) -> Iterator[str]:
    """Yield lines of metrics, a column for each axis, then those of no axis."""
    from cc_mujoco.metrics._metric import value_text

    rows: dict[tuple[str, str], dict[str, float]] = {}
    for metric, value in found.items():
        prefix = next((p for p in prefixes if p and metric.name.startswith(p)), "")
        row = rows.setdefault((metric.name.removeprefix(prefix), metric.unit), {})
        row[prefix] = value
    axes = [prefix.rstrip(".") for prefix in prefixes if prefix]
    widths = [max(len(axis), 9) for axis in axes]
    if axes:
        names = " ".join(f"{a:>{w}}" for a, w in zip(axes, widths, strict=True))
        yield f"{'':32} {names}"
    shared = [name for name, row in rows.items() if "" in row]
    for (name, unit), row in sorted(rows.items(), key=lambda item: item[0] in shared):
        if axes and (name, unit) in shared[:1]:
            yield ""
        if "" in row:
            yield f"{name:32} {value_text(row['']):>10} {unit}"
            continue
        own = zip(prefixes, widths, strict=True)
        values = " ".join(
            f"{value_text(row[prefix]):>{width}}" for prefix, width in own
        )
        yield f"{name:32} {values} {unit}"
