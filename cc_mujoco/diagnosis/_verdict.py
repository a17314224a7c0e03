"""Verdict of a diagnosis, the contract of `verdict.json`, and data of the report."""

import dataclasses
import json
import math
import os
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field
from typing import Any, Literal

import numpy as np

from cc_mujoco._utils.atomic_io import replacing
from cc_mujoco.diagnosis.effects._causes import CauseClass
from cc_mujoco.estimation._least_squares import Estimate
from cc_mujoco.native import FloatArray

Model = Literal["before", "after"]
MODELS: tuple[Model, ...] = ("before", "after")


@dataclass(frozen=True, eq=False)  # arrays have no truth to compare by
class TrialTrace:
    """Signals of one stretch of a trial; arrays have one entry per sample."""

    trial: str  # its name
    time: FloatArray  # (samples,) [s]
    motor_angle: FloatArray  # as given to the model [rad]
    joint_angle: FloatArray  # as given to the model [rad]
    # Channel to readings, low-passed as simulated torques are [N m]
    measured: Mapping[str, FloatArray]
    before: Mapping[str, FloatArray]  # of the baseline, fitted to other data [N m]
    after: Mapping[str, FloatArray]  # of the model with the named effects [N m]
    counts: FloatArray  # 1 where a sample counts; 0 elsewhere, as in the run-in

    def error(self, channel: str, model: Model = "before") -> FloatArray:
        """Return the error of a channel (samples,) by either model [N m]."""
        played = self.before if model == "before" else self.after
        return self.measured[channel] - played[channel]


@dataclass(frozen=True)
class Map:
    """Mean error of a channel by bins of one quantity, its axis."""

    channel: str  # `motor_torque_nm` or `joint_torque_nm`
    axis: str  # name of the quantity
    unit: str  # its unit
    centre: FloatArray  # (bins,) of the bins
    before: FloatArray  # (bins,) mean error of the baseline [N m], NaN without data
    after: FloatArray  # (bins,) mean error with the named effects
    # (bins,) half width within which chance keeps it in 95 % of cases [N m]
    band: FloatArray
    share: float  # share of the baseline's squared error that the axis explains
    chance: float  # share that chance reaches in 5 % of cases


@dataclass(frozen=True)
class Isolability:
    """Similarity of every two effects once the baseline is fitted again."""

    ids: tuple[str, ...]  # of the effects
    cosines: FloatArray  # (ids, ids) largest cosine between their signatures, 0 to 1
    visible: FloatArray  # (ids,) RMS change by a typical size over the noise


@dataclass(frozen=True)
class Evidence:
    """Signals and maps that the report draws."""

    traces: tuple[TrialTrace, ...] = ()
    maps: tuple[Map, ...] = ()
    isolability: Isolability = field(
        default_factory=lambda: Isolability((), np.zeros((0, 0)), np.zeros(0))
    )


SCHEMA_VERSION = 4

Verdict = Literal["named", "none", "unknown", "tie", "fix-data", "fix-numerics"]


@dataclass(frozen=True)
class FoundEffect:
    """Effect in the final model, with its fitted values."""

    id: str
    """Name of the effect in the library."""
    parameters: Mapping[str, Estimate]
    """Fitted values by name."""
    confidence: float
    """Share of block bootstraps of the held-out data in which this effect is the best
    of all candidates, 0 to 1."""
    _: KW_ONLY
    share: float = 1.0
    """Share of the baseline's gap on held-out data that opens again if this effect is
    taken out and all else is refitted."""
    refinement: bool = False
    """True if that share is so small that the effect may only mend the form of another:
    it is in the model, but not called missing."""
    agreement: float = 1.0
    """Share of the parts of the data that name it, or of its sizes by occasion that
    agree; 1 where none were compared."""
    disputed: bool = False
    """True if too few parts name it to call it missing."""
    ordinary: bool = False
    """True if it is no larger than any rig may have undeclared: it is in the model, but
    not called missing."""
    own: float = math.nan
    """RMS error over the noise floor that reappears without it."""
    rivals: tuple[str, ...] = ()
    """Effects that the data cannot distinguish from it."""
    form: str = ""
    """Best-fitting form of an effect with several forms."""

    @property
    def missing(self) -> bool:
        return not (self.refinement or self.disputed or self.ordinary)


@dataclass(frozen=True)
class NotTestable:
    """Effect that these data could not show even if it were there."""

    id: str
    reason: str


@dataclass(frozen=True)
class Confounded:
    """Effect that tuning a parameter of the scene would hide."""

    id: str  # of the effect
    parameter: str  # tuned one that does the same
    shift: str  # change of that parameter by a plausible size of the effect, in words
    # Size that makes up for the tuning, in words; "" where it is about as given
    explains: str
    remedy: str  # what to declare or to record to distinguish them


@dataclass(frozen=True)
class Deviating:
    """Parameter tuned further from the scene than its uncertainty there."""

    parameter: str  # of the baseline
    given: float  # value of the scene or of `dataset.toml`
    tuned: Estimate  # fitted value
    deviations: float  # distance in standard deviations of its prior
    statement: str  # one sentence, with other possible causes


@dataclass(frozen=True)
class NextExperiment:
    """Trials to record in order to distinguish rivals."""

    description: str  # what to do on the rig
    separates: tuple[str, ...]  # ids of the rivals
    predicted_difference: str  # of their predictions, with numbers and units
    trials: tuple[str, ...] = ()  # names for the recordings, usually one
    facts: tuple[str, ...] = ()  # lines of `dataset.toml` for them

    @property
    def folder(self) -> str:
        """Name of the folder of its files, inside that of the diagnosis."""
        return f"next_{self.trials[0]}"


@dataclass(frozen=True)
class Where:
    """One location of the error: a channel, and a quantity along which it lies."""

    channel: str  # `motor_torque_nm` or `joint_torque_nm`
    axis: str  # quantity along which it lies
    # Share of the squared error that the axis explains, 0 to 1
    share_of_error: float
    statement: str  # one plain sentence


@dataclass(frozen=True)
class Gap:
    """RMS error of one channel on held-out data, before and after the effects [N m].

    Samples are weighted by how well the angles determine the torque: where an end of
    the cable sticks, a handful of them would outweigh all others.
    """

    rmse_before: float  # of the baseline
    rmse_after: float  # of the model with the named effects
    noise_floor: float  # RMS error that the noise of the sensors makes, an estimate
    # 1 - (RMS after - floor)/(RMS before - floor); more than 1 below the floor, NaN
    # where the error before is not above it
    gap_closed: float
    ci95: tuple[float, float]  # of `gap_closed`, block bootstrap; NaN without a gap


@dataclass(frozen=True)
class OccasionChange:
    """Change of a parameter of the baseline between two occasions."""

    parameter: str  # of the baseline
    since: str  # the earlier occasion
    until: str  # the later occasion
    change: Estimate  # share of the earlier value where `relative`, else in its unit
    relative: bool  # whether it is a share of the earlier value
    statement: str  # in words with its 95 % interval


@dataclass(frozen=True)
class OccasionSize:
    """Size of an effect on every occasion; its other parameters are shared."""

    effect: str  # id
    parameter: str  # size of the effect
    sizes: Mapping[str, Estimate]  # fitted size by occasion
    agree: bool  # whether every occasion that could show the shared size shows it
    statement: str  # in words


@dataclass(frozen=True)
class Occasions:
    """Comparison of the occasions on which one rig was recorded."""

    names: tuple[str, ...]  # in order; baseline and repaired scene are of the last
    changes: tuple[OccasionChange, ...]  # from every earlier occasion to the last
    sizes: tuple[OccasionSize, ...]  # of the effects in the model
    statement: str  # changes from the last but one to the last


@dataclass(frozen=True)
class TrialError:
    """Error of one trial before and after the effects, by channel as in `Gap`."""

    trial: str  # its name
    rmse_before: Mapping[str, float]  # of the baseline, fitted to other data
    rmse_after: Mapping[str, float]  # of the model with the named effects
    noise_floor: Mapping[str, float]  # RMS error that the noise of the sensors makes
    misfit_before: float  # of both channels over the noise floor, by Huber
    misfit_after: float  # the same with the named effects
    slack: float = 0.0  # share of samples in which a cable of the final model is slack


@dataclass(frozen=True)
class Event:
    """Change at a moment or between trials, left out of what is judged."""

    # Constant that changed, or `silent`, `dead`, `gain`, `drift`, `pull`, `device`
    kind: str
    # Its part of every trial that it concerns (from, to) [s], infinite up to the ends
    spans: Mapping[str, tuple[float, float]]
    file: str  # of the first of those trials
    time: float  # at which it begins there, or ends [s]; NaN of whole trials
    interval: tuple[float, float]  # 95 % of `time` [s]
    size: Estimate  # value over that of the rest, or value less that of the rest
    statement: str  # in words, with a question after the cause
    declaration: tuple[str, ...]  # a table of `dataset.toml` for each trial
    occasion: str = ""  # under which whole trials are judged; "" if they are left out

    @property
    def advice(self) -> str:
        """Advice on the declaration, with its first line."""
        first, *more = self.declaration
        others = f" and {len(more)} more, in the report" if more else ""
        line = first.replace("\n", " ")
        return f"The rest is judged without; if so, declare it: {line}{others}."


@dataclass(frozen=True)
class Baseline:
    """Model without any effect, fitted to all data."""

    parameters: Mapping[str, Estimate]  # fitted values by name
    not_identifiable: tuple[str, ...]  # a sentence on each open combination


@dataclass(frozen=True)
class RunnerUp:
    """Effect that was fitted as a candidate, and its result."""

    id: str  # of the library
    reduction: float  # relative reduction of the held-out sum of squares
    z: float  # of the comparison with the model before
    accepted: bool  # whether it would have been named by itself
    reason: str  # why not, or empty
    parameters: Mapping[str, float]  # fitted values by name


@dataclass(frozen=True)
class Alternative:
    """Explanation that may be right instead of the verdict."""

    # Of an effect, "nothing", "outside" (no effect of the library) or "small" (an
    # effect too small for the data)
    id: str
    probability: float  # 0 to 1


@dataclass(frozen=True)
class VerdictOdds:
    """Probability that the verdict is right, scaled by rates on simulated rigs."""

    # 0 to 1, NaN where no study rig left as much of the error; `validation.md` shows
    # how often it held on new rigs
    probability: float
    statement: str  # one sentence, with odds
    alternatives: tuple[Alternative, ...]  # the likeliest first


@dataclass(frozen=True)
class LearnedTable:
    """Torque over one quantity, linear between points, learned from the error."""

    id: str  # of its class in `learned.py`
    over: str  # name of the quantity
    unit: str  # of the quantity
    times: str  # factor of the torques, "" for 1
    period: float  # after which the table repeats, 0 if it does not
    at: tuple[float, ...]  # points of the quantity
    torque_unit: str  # of the torques over their factor
    torque: Mapping[str, tuple[float, ...]]  # what is added at the points, by channel
    # Formula in words that predicts trials left out better than the table, or ""
    formula: str = ""


@dataclass(frozen=True)
class Learned:
    """Curves of what no effect explains, tested on trials that they have not seen."""

    statement: str  # one or two sentences
    curves: tuple[LearnedTable, ...]  # none where they take too little
    gap: Mapping[str, Gap]  # by channel, before and after the curves
    gap_closed: float  # of all channels together, as in `Gap`
    ci95: tuple[float, float]  # of `gap_closed`


@dataclass(frozen=True)
class Diagnosis:
    """Everything that `verdict.json` holds, field by field."""

    verdict: Verdict
    """Verdict in one word."""
    statement: str
    """Verdict in a few sentences."""
    _: KW_ONLY
    effects: tuple[FoundEffect, ...] = ()
    """Effects in the model, in the order in which they were added."""
    ties: tuple[tuple[str, ...], ...] = ()
    """Groups of effects that these data cannot distinguish."""
    not_testable: tuple[NotTestable, ...] = ()
    """Effects that these data cannot show."""
    next_experiment: NextExperiment | None = None
    """Trials that would separate the first tie, or None."""
    where: tuple[Where, ...] = ()
    """Locations of the error, the main one first."""
    gap: Mapping[str, Gap] = field(default_factory=dict)
    """Error on held-out data by channel."""
    baseline: Baseline = field(default_factory=lambda: Baseline({}, ()))
    """Parameters of the model without any effect."""
    provenance: Mapping[str, Any] = field(default_factory=dict)
    """Hashes of the inputs, versions, seed and command."""
    runner_ups: tuple[tuple[RunnerUp, ...], ...] = ()
    """Candidates of every round of the search, first to last."""
    problems: tuple[str, ...] = ()
    """Sentences about the data or the numerics."""
    trials: tuple[TrialError, ...] = ()
    """Errors of every trial."""
    question: str = ""
    """Question or advice about the data to the user, or empty."""
    events: tuple[Event, ...] = ()
    """Changes at a moment or between trials, in the order found."""
    deviating: tuple[Deviating, ...] = ()
    """Parameters that had to be tuned beyond their priors."""
    classes: tuple[CauseClass, ...] = ()
    """Physical causes with equal torques, of what is named or deviates."""
    confounded: tuple[Confounded, ...] = ()
    """Effects that tuning would hide."""
    remaining: float = math.nan
    """RMS error of the repaired model on held-out data, over the noise floor."""
    instruments: str = ""
    """Limits of the instruments in words; empty of two torque sensors."""
    occasions: Occasions | None = None
    """Comparison of occasions, None where there is one."""
    learned: Learned | None = None
    """Curves of what is left; None where none were looked for."""
    interrupted: bool = False
    """True if the search was stopped before all effects were tried."""
    belief: VerdictOdds | None = None
    """Probability that the verdict is right; None where no search was made, it was
    stopped, or something happened once, in a stretch or between trials."""

    @property
    def missing(self) -> tuple[FoundEffect, ...]:
        """Effects in the model without refinements, ordinary and disputed ones."""
        return tuple(each for each in self.effects if each.missing)

    def to_json(self) -> str:
        """Return the text of `verdict.json`; numbers that are not finite are null."""
        content = {"schema": SCHEMA_VERSION, **dataclasses.asdict(self)}
        return json.dumps(_to_plain(content), indent=1, allow_nan=False)

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write `verdict.json`, whole or not at all."""
        with replacing(path) as partial:
            partial.write_text(self.to_json() + "\n", encoding="utf-8")


def _to_plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _to_plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_to_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
