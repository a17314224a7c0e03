"""Turns and friction losses of the tendons of a model, with or without cables.

    print(tendon_report(model))
    tendon_report(model, friction=0.1).table()  # of pyarrow

A tendon that slips over a site or geom by which its path turns by an angle theta loses
1 - exp(-mu theta) of its tension there. The report needs no cable: it reads the path
that MuJoCo gives every spatial tendon.
"""

import copy
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import mujoco
import numpy as np

from cc_mujoco.cable._cable import PATHS, ROLLER, Cable
from cc_mujoco.cable._open_path import MIN_NODE_LENGTH
from cc_mujoco.errors import CableError
from cc_mujoco.native import FloatArray
from cc_mujoco.plugin import _tendon_survey as surveys
from cc_mujoco.plugin._config import ROLLING
from cc_mujoco.plugin._mjcf import cable_of, from_mjcf, instances
from cc_mujoco.plugin._readings import require_data_of, route_tendon
from cc_mujoco.plugin._settle import shortest_piece_step
from cc_mujoco.plugin._spec import compile_spec
from cc_mujoco.plugin._warnings import RANDOM_POSES

if TYPE_CHECKING:
    import pyarrow as pa


_SITE = mujoco.mjtWrap.mjWRAP_SITE


class TendonPlace(NamedTuple):
    """A site or geom between the ends of a tendon.

    Attributes:
        kind: `"site"` or `"geom"`.
        name: its name, or its index in the model where it has none.
        turn: turning angle of the path there in the present pose [rad].
        min_turn: the smallest over the ranges of the joints [rad].
        max_turn: the largest [rad].
        contact: length over which the tendon touches a geom in the present pose [m].
        loss: part of the tension that friction takes there in the present pose.
        total_loss: loss from the first site of the tendon up to this place.
        max_total_loss: largest `total_loss` over the ranges of the joints.
        touched: True unless it is a geom that the path never touches.
        guide: radius of the guide at a site [m], `"roller"` for a site or geom without
            friction, None where nothing is given.
    """

    kind: str
    name: str
    turn: float
    min_turn: float
    max_turn: float
    contact: float
    loss: float
    total_loss: float
    max_total_loss: float
    touched: bool
    guide: float | str | None


@dataclass(frozen=True)
class TendonSummary:
    """Turns and losses of one tendon.

    A roller turns the tendon without friction, so the losses are without it.

    Attributes:
        name: its name, or its index in the model where it has none.
        joints: the joints that move one part of it against another.
        unlimited_joints: number of these without a range.
        places: its sites and geoms from the first site to the last, without these two.
        length: its length in the present pose [m].
        piece_lengths: lengths of its pieces in the present pose, with half of the arcs
            beside them [m].
        min_piece_length: the smallest over the ranges of the joints [m].
        turn: sum of the turning angles in the present pose [rad], without rollers.
        min_turn: the smallest sum over the ranges of the joints [rad].
        max_turn: the largest [rad].
        zigzag: part of the turning in the present pose that the next site takes back.
        friction: coefficient of friction.
        friction_source: source of the friction: `"given"`, `"cable"` or `"assumed"`.
        axial_stiffness: EA for which `step_limit` holds [N].
        step_limit: time step below which its pieces are stable in the present pose and
            over the ranges of the joints [s]; infinite where nothing moves.
        timestep: time step of the model [s].
        cable: the cable on it, if there is one.
        in_conduit: True if that cable is in a conduit, at least up to its mouth, where
            friction is that of the conduit and not of these places.
    """

    name: str
    joints: tuple[str, ...]
    unlimited_joints: int
    places: tuple[TendonPlace, ...]
    length: float
    piece_lengths: tuple[float, ...]
    min_piece_length: float
    turn: float
    min_turn: float
    max_turn: float
    zigzag: float
    friction: float
    friction_source: str
    axial_stiffness: float
    step_limit: float
    timestep: float
    cable: str | None
    in_conduit: bool

    @property
    def loss(self) -> float:
        """Part of its tension that friction takes in the present pose."""
        return _loss(self.friction, self.turn)

    @property
    def max_loss(self) -> float:
        """Largest part of its tension lost over the ranges of the joints."""
        return _loss(self.friction, self.max_turn)

    @property
    def untouched(self) -> tuple[str, ...]:
        """Geoms that its path never touches."""
        geoms = [place for place in self.places if place.kind == "geom"]
        touched = {place.name for place in geoms if place.touched}
        return tuple(dict.fromkeys(p.name for p in geoms if p.name not in touched))

    @property
    def zigzags(self) -> bool:
        """True if the next site takes back more than 0.7 of its turning."""
        return self.zigzag > 0.7

    @property
    def warning(self) -> str:
        """Sentence if friction takes more than 0.3 of the tension now, else empty."""
        if self.in_conduit or self.loss <= 0.3:
            return ""
        cause = ""
        if self.zigzags:
            cause = (
                "; its sites zig-zag, as the next one takes "
                f"{_percent(self.zigzag, 0)} of this turn back: put them on a smooth "
                "curve, or make them rollers by `guides`"
            )
        return (
            f"tendon {self.name!r} turns by {self.turn:.3g} rad as it lies, so "
            f"friction {self.friction:g} takes {_percent(self.loss, 0)} of its "
            f"tension{cause}."
        )

    def __str__(self) -> str:
        """Return the table of the tendon, with its description and time step."""
        rows: list[tuple[str, ...]] = [
            ("", "turn", "[rad]", "", "contact", "loss", "up to", "here"),
            ("", "now", "min", "max", "[mm]", "here", "now", "at most"),
        ]
        for place in self.places:
            label = f"{place.kind} {place.name}"
            if place.guide == ROLLER:
                label += ", roller"
            cells = ["never touched", *[""] * 6]
            if place.touched:
                rubs = place.kind == "geom" or place.guide
                losses = place.loss, place.total_loss, place.max_total_loss
                cells = [*_turns(place), f"{1e3 * place.contact:.1f}" if rubs else ""]
                cells += map(_percent, losses)
            rows.append((label, *cells))
        contact = 1e3 * sum(place.contact for place in self.places)
        whole = f"{contact:.1f}" if contact else ""
        losses_of_all = _percent(self.loss), _percent(self.max_loss)
        rows.append(("whole tendon", *_turns(self), whole, "", *losses_of_all))
        return "\n".join((self._head(), *_aligned(rows), *self._notes()))

    def _head(self) -> str:
        count = len(self.piece_lengths)
        pieces = "1 piece" if count == 1 else f"{count} pieces"
        joints = ", ".join(self.joints) or "no joint"
        if len(self.joints) > 4:  # too many for a line
            first, last = self.joints[0], self.joints[-1]
            joints = f"{len(self.joints)} joints, {first} to {last}"
        cable = "" if self.cable is None else f"; cable {self.cable!r}"
        if self.cable is not None and self.in_conduit:
            cable += " in a conduit"
        return (
            f"tendon {self.name!r}: {1e3 * self.length:.1f} mm in {pieces}, "
            f"{1e3 * self.min_piece_length:.1f} mm or more each; friction "
            f"{self.friction:g} ({self.friction_source}){cable}; moved by {joints}"
        )

    def _notes(self) -> Iterable[str]:
        if math.isfinite(self.step_limit):
            verdict = "too long" if self.timestep > self.step_limit else "short enough"
            source = "" if self.cable else " (assumed)"
            yield (
                f"  with EA = {self.axial_stiffness:g} N{source} its pieces are stable "
                f"below {1e3 * self.step_limit:.3g} ms in all poses; the `timestep` of "
                f"{1e3 * self.timestep:.3g} ms is {verdict}"
            )
        if self.unlimited_joints:
            yield (
                f"  joints without a range, {self.unlimited_joints} here, make half a "
                "turn, or slide by its length, to either side"
            )
        if self.in_conduit:
            yield (
                "  the cable is in a conduit, at least up to its mouth: friction there "
                "is that of the conduit"
            )
        if self.warning:
            yield f"  warning: {self.warning}"


@dataclass(frozen=True)
class TendonReport:
    """Turns and losses of the tendons of a model; `print` shows them.

    Attributes:
        tendons: the tendons, in the order of the model.
        skipped: reasons why other tendons are left out, by name.
    """

    tendons: tuple[TendonSummary, ...]
    skipped: dict[str, str]

    def __str__(self) -> str:
        return "\n\n".join((*map(str, self.tendons), self._foot()))

    def overview(self) -> str:
        """Return one line for every tendon, and the warnings."""
        if not self.tendons:
            return self._foot()
        rows: list[tuple[str, ...]] = [
            ("", "", "turn", "[rad]", "", "", "loss", "", "step"),
            tuple("tendon,places,now,min,max,friction,now,at most,[ms]".split(",")),
        ]
        for own in self.tendons:
            losses = _percent(own.loss), _percent(own.max_loss)
            step = "any"
            if math.isfinite(own.step_limit):
                step = f"{1e3 * own.step_limit:.3g}"
            head = own.name, str(len(own.places)), *_turns(own)
            rows.append((*head, f"{own.friction:g}", *losses, step))
        warnings = [f"warning: {t.warning}" for t in self.tendons if t.warning]
        untouched = [
            f"tendon {t.name!r} never touches geom {', '.join(t.untouched)}"
            for t in self.tendons
            if t.untouched
        ]
        return "\n".join((*_aligned(rows), *untouched, *warnings, self._foot()))

    def table(self) -> "pa.Table":
        """Return a table of pyarrow with a row for every place of every tendon."""
        import pyarrow as pa  # takes long to load

        text, number = pa.string(), pa.float64()
        columns = {
            "tendon": text, "kind": text, "name": text,
            "turn_rad": number, "min_turn_rad": number, "max_turn_rad": number,
            "contact_m": number, "loss": number, "total_loss": number,
            "max_total_loss": number, "touched": pa.bool_(), "friction": number,
        }  # fmt: skip
        rows = [
            dict(zip(columns, (t.name, *place[:-1], t.friction), strict=True))
            for t in self.tendons
            for place in t.places  # but for their guides
        ]
        return pa.Table.from_pylist(rows, pa.schema(columns))

    def _foot(self) -> str:
        lines = [f"tendon {name!r} {why}" for name, why in self.skipped.items()]
        if not self.tendons:
            return "\n".join((*lines, "There is no spatial tendon to report on."))
        lines.append(
            "now: the pose that was given, `qpos0` by default. min, max, at most: also "
            f"{surveys.SWEEP_POSES} poses of\neach joint over its range, "
            f"{surveys.SWEEP_POSES} of all together and {RANDOM_POSES} random ones; "
            "equalities are ignored."
        )
        if any(tendon.cable is None for tendon in self.tendons):
            lines.append(
                "Tendons without a cable have no friction yet: it is what a cable on "
                "them would make."
            )
        return "\n".join(lines)


def tendon_report(
    source: mujoco.MjModel | mujoco.MjSpec,
    tendons: str | int | Iterable[str | int] | None = None,
    *,
    friction: float | None = None,
    axial_stiffness: float | None = None,
    data: mujoco.MjData | None = None,
) -> TendonReport:
    """Report where the spatial tendons of a model turn, and what friction takes there.

    Minima and maxima are over a fixed set of poses: every joint that moves the tendon
    over its range by itself, all of them together from one end to the other, and
    random ones, see `_tendon_survey.sweep`. A joint without a range makes half a turn,
    or moves by the length of the tendon, to either side. Equalities between joints are
    ignored.

    Args:
        source: a model, with or without cables; it is not changed.
        tendons: name of a tendon, or its index where it has none, or several of these;
            by default all that can be reported on.
        friction: coefficient of friction; by default that of the cable on the tendon,
            or 0.1 where there is none.
        axial_stiffness: EA of a tendon without a cable [N], for the limit of the time
            step; by default that of `Cable()`.
        data: a simulation of the model whose pose is the present one; by default that
            is `qpos0`.

    Raises:
        CableError: there is no such tendon, it is fixed or has a `<pulley>`, a number
            cannot be used, the model does not compile, or `data` is of another one.
    """
    if isinstance(source, mujoco.MjSpec):
        model = compile_spec(source.copy())
    elif isinstance(source, mujoco.MjModel):
        model = source
    else:
        raise CableError(
            f"tendon_report needs an MjModel or MjSpec, not {type(source).__name__}."
        )
    given = Cable(friction=0.1 if friction is None else friction)
    if axial_stiffness is not None:
        given = given.replace(axial_stiffness=axial_stiffness)
    known = {_label(model, "tendon", i): i for i in range(model.ntendon)}
    if isinstance(tendons, mujoco.MjData):
        raise CableError("tendon_report takes a simulation by name, `data=`.")
    labels = chosen = list(known)
    if tendons is not None:
        wanted = [tendons] if isinstance(tendons, str | int) else tendons
        chosen = [
            labels[x] if isinstance(x, int) and 0 <= x < len(labels) else str(x)
            for x in dict.fromkeys(wanted)
        ]
    led = [name for name, cable in from_mjcf(model).items() if cable.route]
    on = {route_tendon(model, cable): cable for cable in led}
    skipped: dict[str, str] = {}
    for name in chosen:
        if name not in known:
            raise CableError.unknown("tendon", name, known)
        why = _obstacle(model, known[name])
        if tendons is None:
            why = why or _role(model, known[name], on)
            if why:
                skipped[name] = why
        elif why:
            raise CableError(f"tendon {name!r} {why}; it has no turns to report.")
    if data is None:
        data = mujoco.MjData(model)
    else:
        require_data_of(model, data)
        data = copy.copy(data)
    rest = data.qpos.copy()
    found = tuple(
        _summarize(model, data, rest, index, on.get(index), given, friction)
        for index in (known[name] for name in chosen if name not in skipped)
    )
    return TendonReport(found, skipped)


def _summarize(
    model: mujoco.MjModel, data: mujoco.MjData, rest: FloatArray, tendon: int,
    cable: str | None, given: Cable, friction: float | None,
) -> TendonSummary:  # fmt: skip
    """Return the summary of a tendon, whose present pose is `rest` (nq,).

    `friction` replaces that of `cable` if it is given. Without a cable, and inside a
    conduit, friction and stiffness are those of `given`.
    """
    joints = surveys.spanned_joints(model, tendon)
    poses = surveys.sweep(model, rest, tendon)
    turn, touching, length = surveys.survey(model, data, tendon, poses)
    own, mu, source, in_conduit = given, given.friction, "assumed", False
    guides = np.zeros(turn.shape[1])
    if cable is not None:
        instance = instances(model)[cable]
        own = cable_of(model, instance, cable)
        mu, source, in_conduit = own.friction, "cable", own.path != PATHS[1]
        surveys.read_guides(model._address, instance, tendon, guides)
    if friction is not None:
        mu, source = given.friction, "given"
    if cable is None or in_conduit:
        stiffness = given.axial_stiffness
        steps = surveys.piece_timesteps(model, data, tendon, stiffness, poses)
        limit = float(steps.min())
    else:
        stiffness = own.axial_stiffness
        limit = shortest_piece_step(model, data, cable, poses)
    rubbing = np.where(guides == ROLLING, 0.0, turn)
    contact = touching + np.maximum(guides, 0.0) * turn
    contact[:, guides == ROLLING] = 0.0
    total = np.cumsum(rubbing, axis=1)
    touched = touching.max(axis=0) + turn.max(axis=0) > 0.0
    start = int(model.tendon_adr[tendon]) + 1
    places = []
    for k, guide in enumerate(guides.tolist()):
        kind = "site" if model.wrap_type[start + k] == _SITE else "geom"
        name = _label(model, kind, int(model.wrap_objid[start + k]))
        turned = turn[:, k]
        place = TendonPlace(
            kind, name, float(turned[0]), float(turned.min()), float(turned.max()),
            float(contact[0, k]), _loss(mu, rubbing[0, k]), _loss(mu, total[0, k]),
            _loss(mu, total[:, k].max()), kind == "site" or bool(touched[k]),
            ROLLER if guide == ROLLING else guide or None,
        )  # fmt: skip
        places.append(place)
    data.qpos[:] = rest
    mujoco.mj_fwdPosition(model, data)
    sums = rubbing.sum(axis=1)
    return TendonSummary(
        _label(model, "tendon", tendon),
        tuple(_label(model, "joint", j) for j in joints),
        len(joints) - int(np.count_nonzero(model.jnt_limited[joints])), tuple(places),
        float(data.ten_length[tendon]), tuple((length[0] - MIN_NODE_LENGTH).tolist()),
        float(length.min() - MIN_NODE_LENGTH), float(sums[0]), float(sums.min()),
        float(sums.max()), _zigzag(model, data, tendon, rubbing[0]), mu, source,
        stiffness, limit, float(model.opt.timestep), cable, in_conduit,
    )  # fmt: skip


def _zigzag(
    model: mujoco.MjModel, data: mujoco.MjData, tendon: int, turn: FloatArray
) -> float:
    """Return the part of the turning of a path that the next site takes back.

    It is near 1 if every site turns the path against the one before it, 0 along a curve
    of one sense. `turn` has the angles (p,) in the present position [rad].
    """
    start, count = int(model.tendon_adr[tendon]), int(model.tendon_num[tendon])
    at = int(data.ten_wrapadr[tendon])
    points, things = data.wrap_xpos.reshape(-1, 3), data.wrap_obj.reshape(-1)
    back, arriving, before, k = 0.0, np.zeros(3), np.zeros(3), 0
    while k < count - 1:
        geom = model.wrap_type[start + k + 1] != _SITE
        thing = int(model.wrap_objid[start + k + 1])
        touched = geom and things[at + 1] == thing
        leaving = points[at + 1] - points[at]
        axis = np.cross(arriving, leaving)
        if axis.any():
            now = turn[k - 1] * axis / np.linalg.norm(axis)
            if now @ before < 0.0:
                back += min(turn[k - 1], float(np.linalg.norm(before)))
            before = now
        if touched:
            before, leaving = np.zeros(3), points[at + 3] - points[at + 2]
        arriving = leaving
        at += 3 if touched else 1
        k += 2 if geom else 1
    whole = float(turn.sum())
    return back / whole if whole > 0.0 else 0.0


def _loss(friction: float, turn: float) -> float:
    """Return the part of a tension that Coulomb friction takes over a turn [rad]."""
    return -math.expm1(-friction * float(turn))


def _label(model: mujoco.MjModel, kind: str, index: int) -> str:
    return str(getattr(model, kind)(index).name) or str(index)


def _obstacle(model: mujoco.MjModel, tendon: int) -> str:
    """Return the reason why a tendon cannot be reported on ("is fixed"), or ""."""
    start = int(model.tendon_adr[tendon])
    kinds = model.wrap_type[start : start + int(model.tendon_num[tendon])]
    if mujoco.mjtWrap.mjWRAP_PULLEY in kinds:
        return "has a <pulley>"
    return "is fixed" if mujoco.mjtWrap.mjWRAP_JOINT in kinds else ""


def _role(model: mujoco.MjModel, tendon: int, on: dict[int, str]) -> str:
    """Return the reason why a report on all tendons omits a tendon, or ""."""
    cables = instances(model)
    if tendon in on:
        guided = cable_of(model, cables[on[tendon]], on[tendon]).path == PATHS[0]
        return f"draws the conduit of cable {on[tendon]!r}" if guided else ""
    on_tendon = model.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON
    for name, instance in cables.items():
        held = (model.actuator_plugin == instance) & on_tendon
        if tendon in model.actuator_trnid[held, 0]:
            return f"is the lever at an end of cable {name!r}"
    return ""


def _percent(share: float, digits: int = 1) -> str:
    return f"{100.0 * share:.{digits}f} %"


def _turns(of: TendonPlace | TendonSummary) -> list[str]:
    return [f"{turn:.2f}" for turn in (of.turn, of.min_turn, of.max_turn)]


def _aligned(rows: list[tuple[str, ...]]) -> Iterable[str]:
    """Yield rows as lines, their first cells flush left and the others right."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    for row in rows:
        cells = [cell.rjust(width) for cell, width in zip(row, widths, strict=True)]
        yield "  ".join(["", row[0].ljust(widths[0]), *cells[1:]]).rstrip()
