"""Specification of a study: its fields, with defaults and meanings.

    StudySpec("wrist", {"friction": "0.05:0.3:10"}, metrics=["slack_margin"])

The command line fills it from options, Python from the keywords of `study` and
`optimise`; `make_plan` checks it. In Python, `vary` and `across` are dictionaries whose
values are texts, numbers or sequences; `designs` may be a list of dictionaries,
`trajectory`, `task` and `metrics` may be objects. The help of the command imports this
module, so that it must load quickly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from cc_mujoco._utils.command_options import Flag
from cc_mujoco._workers.cluster import WORKER_TIMEOUT

if TYPE_CHECKING:
    from cc_mujoco.human import Task, Trajectory
    from cc_mujoco.metrics import Metric
else:  # tyro evaluates the annotations below, for which nothing need be loaded
    Metric = Task = Trajectory = Any

Given = str | float | Sequence[object]  # a range or values as text, one, or several
Assignments = Mapping[str, Given] | Sequence[str] | None  # or texts `NAME=VALUES`
Texts = tuple[str, ...]
DEFAULT_CONTROLLERS = ("pi_tuned",)
"""Controllers of a study by default: `pi_tuned`, whose gains follow from each design's
rotor, cables and delay."""


def _option(metavar: str, read: Any, name: str | None = None) -> Any:
    """Return tyro's settings for a field with the parser `read` and no default."""
    return tyro.conf.arg(
        name=name, metavar=metavar, help_behavior_hint="", constructor=read
    )


def _repeated(metavar: str, name: str | None = None) -> Any:
    """Return tyro's settings of an option that is given once for each value."""
    read = tyro.conf.UseAppendAction[Texts]
    return tyro.conf.arg(name=name, metavar=metavar, constructor=read)


@dataclass(frozen=True)
class StudySpec:
    """All options that determine the results of a study."""

    scene: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="[SCENE]")] = (
        "wrist"
    )
    """A device; `cc-mujoco list` shows every name that can be given."""
    vary: Annotated[Assignments, _repeated("VARIABLE=VALUES")] = ()
    """VALUES are low:high:count, low:high:count:log or a,b,c; once per variable."""
    designs: Annotated[
        str | Path | Sequence[Mapping[str, object]] | None, _option("FILE", Path | None)
    ] = None
    """CSV or TOML file of designs, instead of --vary."""
    sampling: Annotated[str, tyro.conf.arg(metavar="NAME")] = "grid"
    """Sampling: grid, or lhs for a Latin hypercube of --samples designs."""
    samples: Annotated[int | None, _option("INT", int | None)] = None
    """Number of designs of the Latin hypercube."""
    trajectory: Annotated[
        str | Path | Trajectory | None, _option("NAME", str | None)
    ] = None
    """Motion of the wearer: a name, NAME:AMPLITUDE, a table of angles, or MODULE:NAME;
    the default depends on the scene."""
    task: Annotated[str | Path | Task | None, _option("NAME", str | None)] = None
    """Torque that the device should render: a name, NAME:NUMBER, a table of
    torque over phase or time, or MODULE:NAME; the default depends on the scene."""
    controllers: Annotated[Sequence[str], _option("NAME [NAME ...]", Texts)] = (
        DEFAULT_CONTROLLERS
    )
    """Controllers of the motor: names, MODULE:FUNCTION or POLICY.safetensors; of
    several, each design is judged with the one that tracks best."""
    duration: float = 10.0
    """Length of an episode in seconds."""
    seed: int = 0
    """Seed of everything random, sampling included."""
    timestep: Annotated[float | None, _option("FLOAT", float | None)] = None
    """Time step in seconds, a divisor of 0.001; that of the scene unless given."""
    metrics: Annotated[Sequence[str | Metric], _repeated("NAME", name="metric")] = ()
    """Metrics to measure, once each; all that designs have unless given."""
    objectives: Annotated[Sequence[str], _repeated("METRIC", name="objective")] = ()
    """Metrics that make a design good, once each, also min:METRIC or max:METRIC."""
    subject_to: Annotated[Sequence[str], _repeated("METRIC>=NUMBER")] = ()
    """A limit that a good design keeps, also METRIC<=NUMBER; once each."""
    across: Annotated[Assignments, _repeated("NAME=VALUES")] = ()
    """Judge designs over cases: values of a variable, or of wearer, the wearer's
    impedance times the scene's; once per name, every combination is a case."""
    rank: Annotated[str | None, _option("NAME", str | None)] = None
    """Statistic of a metric over the cases: worst, p90 or mean; worst unless given.
    Limits hold in every case."""
    costs: Annotated[str | Path | None, _option("FILE", Path | None)] = None
    """CSV file part,per,cost of what parts cost; round figures as an example if not
    given."""
    evaluations: Annotated[int | None, _option("INT", int | None, name="optimise")] = (
        None
    )
    """Search for the best with so many designs; VALUES may then be low:high[:log]."""


@dataclass(frozen=True)
class Execution:
    """Threads or workers that execute a study; results do not depend on them."""

    threads: Annotated[int, tyro.conf.arg(name="workers", help_behavior_hint="")] = 0
    """Threads that simulate; one per processor unless given."""
    scheduler: Annotated[str | None, _option("ADDRESS", str | None)] = None
    """tcp://HOST:PORT of a Dask scheduler, whose workers simulate instead."""
    worker_timeout: float = WORKER_TIMEOUT
    """Seconds after which that is given up if the scheduler has no workers."""
    again: Flag = False
    """Simulate also what an earlier run has finished, and replace its table."""


HERE = Execution()  # execution on every processor of this machine
