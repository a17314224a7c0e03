"""Text of the page of a study, section by section; nothing here draws."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from cc_mujoco.devices import DEVICES
from cc_mujoco.metrics import METRICS
from cc_mujoco.page import Html, bar, bullets, element, joined, listed, paragraph, table
from cc_mujoco.plant.plant import RADII, Scene
from cc_mujoco.plant.variables import SETS, describe
from cc_mujoco.transmission.parameters import PARAMETERS
from cc_mujoco.whatif.across import WORST_CASE
from cc_mujoco.whatif.around import WORSE, Around, Price, Slope
from cc_mujoco.whatif.designs import Range
from cc_mujoco.whatif.halved import Halved
from cc_mujoco.whatif.pareto import Limit, Objective, costs, order, pareto, within
from cc_mujoco.whatif.plan import Plan
from cc_mujoco.whatif.sensitivity import Sensitivity
from cc_mujoco.whatif.store import CONTROLLER, failed_by
from cc_mujoco.whatif.wording import (
    NEARBY,
    UNSAID,
    WORTH,
    cell,
    driven_by,
    headed,
    plain,
    quantity,
    unit_of,
)

Array = NDArray[np.float64]
Row = Mapping[str, object]

LISTED = 10
"""Designs in the table of the best."""
NEAR = 0.05
"""Part of an objective's range within which designs are as good as the best."""
ALWAYS = ("axial_stiffness", "pretension", "friction")
"""Parameters of a cable that are told even where they have their default."""
EDGE = 0.02
"""Part of a range within which a value lies at its end."""
LATE = 0.8
"""Part of a search after which a best design says that it is not at its end."""


@dataclass(frozen=True)
class RankedStudy:
    """A finished study and what its designs are ranked by.

    Attributes:
        plan: the study.
        rows: its table, a mapping per design.
        goals: what makes a design good.
        limits: that a good design keeps.
        cost: see `pareto.costs`.
        kept: whether designs keep the limits.
        order: designs from best to worst.
        front: which are in the Pareto set.
        chosen: whether objectives were given; otherwise every metric is one.
    """

    plan: Plan
    rows: tuple[Row, ...]
    goals: tuple[Objective, ...]
    limits: tuple[Limit, ...]
    cost: Array
    kept: NDArray[np.bool_]
    order: NDArray[np.intp]
    front: NDArray[np.bool_]
    chosen: bool

    @classmethod
    def of(cls, plan: Plan, found: pa.Table) -> RankedStudy:
        """Rank the designs of a table by the objectives and limits of its plan."""
        goals, limits = goals_of(plan, found), plan.limits
        cost = costs(found, goals, limits)
        return cls(
            plan,
            tuple(found.to_pylist()),
            goals,
            limits,
            cost,
            within(found, limits),
            order(cost),
            pareto(cost),
            bool(plan.objectives),
        )

    @property
    def best(self) -> Row | None:
        """The first design; None where none has all numbers and keeps the limits."""
        first = int(self.order[0])
        return None if np.isnan(self.cost[first]).any() else self.rows[first]

    @property
    def varied(self) -> tuple[str, ...]:
        """Variables that take several values."""
        return self.plan.varied


def goals_of(plan: Plan, table: pa.Table) -> tuple[Objective, ...]:
    """Return the objectives that rank designs, or all metrics that have numbers."""
    if plan.objectives:
        return plan.objectives
    measured = plan.protocol.metrics
    had = [name for name in measured if table[name].null_count < len(table)]
    names = had or measured
    directed = [name for name in names if METRICS[name].better]
    return tuple(Objective(name, METRICS[name].high) for name in directed or names)


def header(found: RankedStudy) -> Html:
    """State what was asked, and the answer."""
    device = DEVICES[found.plan.protocol.scene]
    title = element("h1", f"What if? {device.meaning[:1].upper()}{device.meaning[1:]}")
    goals = listed([f"{'most' if g.high else 'least'} {plain(g.name)}"
                    for g in found.goals])  # fmt: skip
    if not found.chosen:
        goals = "the best in all that was measured, as no objective was given"
    many = f"{len(found.rows)} designs were simulated, looking for {goals}"
    if found.limits:
        limits = listed([limit.text for limit in found.limits])
        many += f" with {limits}, which {int(found.kept.sum())} keep"
    asked = [paragraph(f"{many}.")]
    if found.plan.protocol.across.several:
        asked.append(paragraph(judged(found.plan)))
    best = found.best
    if best is None:
        return element(
            "header",
            title,
            paragraph("No design is good enough.", kind="lead"),
            *_nearest(found),
            *asked,
        )
    first = "The best design"
    if len(found.goals) > 1:
        first = "The best compromise"
        if int(found.front.sum()) == 1:
            first = "Best in all objectives of those tried"
    lead = f"{first} is design {best['design']}: {_setting(found, best)}."
    gives = listed([f"{plain(g.name)} {quantity(g.name, best[g.name])}"
                    for g in found.goals])  # fmt: skip
    return element(
        "header",
        title,
        paragraph(lead, kind="lead"),
        paragraph(f"It gives {gives}.", kind="lead"),
        _at_once(found),
        *asked,
    )


def _at_once(found: RankedStudy) -> Html:
    """State how sure that is and what to do next, for who reads no further."""
    row, edges = found.best, at_ends(found)
    assert row is not None
    show = element("code", f"cc-mujoco whatif-show STUDY {row['design']}")
    following = ["see it at work with ", show]
    if edges:
        names = listed([plain(name) for name, _ in edges])
        following = [
            f"vary {names} further, as the best lies at an end; and ",
            *following,
        ]
    return element(
        "ul",
        element("li", element("b", "How sure: "), as_good(found), "."),
        element("li", element("b", "What next: "), *following, "."),
    )


def as_good(found: RankedStudy) -> str:
    """State how many other designs are about as good as the best, if there is one."""
    first = int(found.order[0])
    good = ~np.isnan(found.cost).any(axis=1)
    span = np.ptp(found.cost[good], axis=0)
    near = good & (found.cost <= found.cost[first] + NEAR * span).all(axis=1)
    others = int(near.sum()) - 1
    many = f"{others} other designs are" if others != 1 else "1 other design is"
    meaning = (
        "what they have in common matters, not the last digit of the best"
        if others
        else "it stands alone, so small differences from it cost something"
    )
    within = f"within {NEAR:.0%} of the range of every objective"
    return f"{many} as good to {within}: {meaning}"


def at_ends(found: RankedStudy) -> list[tuple[str, str]]:
    """Variables of which the best design has the last value tried, and which end."""
    row = found.best
    if row is None:
        return []
    return [
        (name, end)
        for name in found.varied
        if (end := _end(found.plan.ranges[name], row[name]))
    ]


def judged(plan: Plan) -> str:
    """Over which cases designs are ranked."""
    return (
        f"Every number of a design is {plan.protocol.across.told()}. A design that "
        "fails in one of them has failed, one without a number in one of them has "
        "none, and limits hold in all of them."
    )


def _nearest(found: RankedStudy) -> list[Html]:
    """The design that is least beyond its limits, if any has their numbers."""
    beyond = {}
    for number, row in enumerate(found.rows):
        if found.limits and all(
            row[limit.column] is not None for limit in found.limits
        ):
            metrics = {n.column: float(str(row[n.column])) for n in found.limits}
            beyond[number] = max(limit.beyond(metrics) for limit in found.limits)
    if not beyond:
        return []
    row = found.rows[min(beyond, key=lambda number: beyond[number])]
    gives = listed([f"{plain(n.name)} {quantity(n.name, row[n.column])}"
                    for n in found.limits])  # fmt: skip
    lead = f"The nearest is design {row['design']}, {_setting(found, row)}: {gives}."
    return [paragraph(lead, kind="lead")]


def best(found: RankedStudy) -> Html | None:
    """A table of the best designs."""
    if found.best is None:
        return None
    names = [goal.name for goal in found.goals]
    names += [n.column for n in found.limits if n.column not in names]
    if len(found.plan.protocol.controllers) > 1:
        names.append(CONTROLLER)
    if found.plan.protocol.across.several:
        names += [f"{goal.name}@{WORST_CASE}" for goal in found.goals]
    columns = ["design", *found.varied, *names]
    rows = []
    for place in found.order[:LISTED]:
        if np.isnan(found.cost[place]).any():
            break
        row = found.rows[int(place)]
        cells = [cell(row[name]) for name in columns]
        rows.append([cells[0] + ("*" if found.front[place] else ""), *cells[1:]])
    words = (
        "The order is by mean rank in the objectives, after the designs that no other "
        "beats in all of them (marked *)."
        if len(found.goals) > 1
        else "The order is by the objective."
    )
    return joined([paragraph(words), table([headed(n) for n in columns], rows)])


def confidence(
    found: RankedStudy, nearby: Around | None = None, half: Halved | None = None
) -> Html | None:
    """State how sure it is that the best is the best."""
    row = found.best
    if row is None:
        return None
    said = []
    first = int(found.order[0])
    said.append(f"{as_good(found)}.")
    edges = [f"{plain(name)} at the {end} end" for name, end in at_ends(found)]
    if edges:
        said.append(
            f"It has {listed(edges)} of what was tried; a wider range may hold "
            "something better."
        )
    if nearby is not None:
        said += [text for price in nearby.prices if (text := _missed(found, price))]
    if half is not None:
        said.append(settled(half))
    if found.plan.search is not None:
        share = (first + 1) / len(found.rows)
        said.append(
            f"The search found it as design {first} of {len(found.rows)}"
            + (
                "; so late, more designs may well find a better one."
                if share > LATE
                else "; the rest of the search brought nothing better."
            )
        )
    if len(found.plan.protocol.controllers) == 1:
        said.append(
            "Tracking, torque, power and tension are the controller's as well as the "
            "design's; --controllers with several names shows by how much."
        )
    said.append(
        "All numbers are of a simulation with perfect sensors and one wearer's motion, "
        f"{driven_by(found.plan.protocol.controllers)}; parts, wearers and liners that "
        "differ from the model give other numbers."
    )
    return bullets(said)


def settled(half: Halved) -> str:
    """State how half the time step changes the numbers."""
    step = f"half the time step, {1e3 * half.timestep:g} ms"
    if not half.unsettled:
        many = f"{len(half.designs)} designs from the best to the worst"
        one = f"design {half.designs[0]} gives"
        what = f"{many} give" if len(half.designs) > 1 else one
        most = half.changes[0]
        return (
            f"At {step}, {what} the same numbers to within {most.share:.1%} "
            f"({plain(most.metric)})."
        )
    told = [
        f"{plain(one.metric)} of design {one.design} is "
        + (
            f"{quantity(one.metric, one.at_half)} instead of {cell(one.value)}"
            if math.isfinite(one.at_half)
            else f"none instead of {quantity(one.metric, one.value)}"
        )
        for one in half.unsettled
    ]
    return (
        f"At {step}, {listed(told)}: such numbers say more of the step than of the "
        f"design. --timestep {half.timestep:g} repeats the study there; where that "
        "does not settle them, the controller swings against the cable."
    )


def _missed(found: RankedStudy, price: Price) -> str:
    """State that a design beside the best was better, and what it was."""
    (goal,) = (goal for goal in found.goals if goal.name == price.objective)
    gain = goal.cost({goal.name: price.now}) - goal.cost({goal.name: price.found})
    if price.limit is not None or not price.kept or not gain > WORSE * abs(price.now):
        return ""
    return (
        f"It is not the optimum: beside it, {_setting(found, price.design)} gives "
        f"{plain(goal.name)} {quantity(goal.name, price.found)} instead of "
        f"{cell(price.now)} and keeps the limits; more designs are worth trying."
    )


def controllers(found: RankedStudy) -> Html | None:
    """State how far the findings depend on the controller; None where there is one."""
    laws = found.plan.protocol.controllers
    goals = [goal for goal in found.goals if METRICS[goal.name].driven]
    if len(laws) == 1 or not goals:
        return None
    from scipy.stats import spearmanr

    rows = []
    for law in laws:
        chosen = sum(row[CONTROLLER] == law for row in found.rows)
        cells = [law, f"{chosen} of {len(found.rows)}"]
        for goal in goals:
            column = f"{goal.name}@{law}"
            pairs = np.array(
                [
                    (float(str(row[column])), float(str(row[goal.name])))
                    for row in found.rows
                    if row[column] is not None and row[goal.name] is not None
                ]
            ).reshape(-1, 2)
            varies = len(pairs) > 2 and np.ptp(pairs, axis=0).all()
            alike = f"{spearmanr(*pairs.T).statistic:.2f}" if varies else "-"
            own = [] if found.best is None else [cell(found.best[column])]
            cells += [*own, alike]
        rows.append(cells)
    head = ["controller", "tracks best in"]
    for goal in goals:
        own = [] if found.best is None else [f"design {found.best['design']}"]
        head += [f"{headed(goal.name)}, {text}" for text in (*own, "ranks alike")]
    words = (
        "A design is ranked with the controller that tracks best with it. Ranks alike "
        "(Spearman's correlation, 1 is the same order) says whether another controller "
        "alone would have ordered the designs as they are ordered here; where it is "
        "far from 1, the number is as much the controller's as the design's."
    )
    return joined([paragraph(words), table(head, rows)])


def trade_offs(found: RankedStudy) -> Html | None:
    """State what one objective costs in another, along the Pareto set."""
    members = np.flatnonzero(found.front)
    if len(found.goals) < 2 or members.size < 2:
        return None
    said: list[str | Html] = []
    for column, goal in enumerate(found.goals):
        row = found.rows[int(members[np.argmin(found.cost[members, column])])]
        rest = listed(
            [
                f"{plain(other.name)} {quantity(other.name, row[other.name])}"
                for other in found.goals
                if other is not goal
            ]
        )
        word = "most" if goal.high else "least"
        said.append(
            f"The {word} {plain(goal.name)}, {quantity(goal.name, row[goal.name])}, "
            f"has design {row['design']} ({_setting(found, row)}), with {rest}."
        )
    opening = (
        f"{members.size} designs are such that nothing beats them in all objectives: "
        "to gain in one, another has to give."
    )
    return joined([paragraph(opening), bullets(said)])


def matters(found: Sequence[Sensitivity], goals: Sequence[Objective]) -> Html:
    """State which variables decide each objective."""
    known = [one for goal in goals for one in found if one.metric == goal.name]
    unknown = [g.name for g in goals if g.name not in {one.metric for one in known}]
    parts: list[Html] = []
    if unknown:
        lost = listed([plain(name) for name in unknown])
        parts.append(paragraph(f"Nothing can be said of {lost}: {UNSAID}."))
    if not known:
        return parts[0]
    for one in known:
        names = sorted(one.total, key=lambda name: -one.total[name])
        rows = []
        for name in names:
            values, means = one.effects[name]
            text = one.levels.get(name) or [f"{value:.4g}" for value in values]
            low, high = int(np.argmin(means)), int(np.argmax(means))
            ends = [f"{means[k]:.4g} at {text[k]}" for k in (low, high)]
            if means[low] == means[high]:  # the surface does without it
                ends = ["-", "-"]
            share = one.total[name]
            told = _share(share, one.errors[1].get(name))
            rows.append([plain(name), joined([told, bar(share)]), *ends])
        unit = METRICS[one.metric].unit
        head = ("variable", "share", f"least mean [{unit}]", f"greatest mean [{unit}]")
        how = paragraph(f"{one.how[:1].upper()}{one.how[1:]}.", kind="small")
        parts += [element("h3", plain(one.metric)), table(head, rows), how]
    words = (
        "The share of the differences between designs that goes when a variable is "
        "held (Sobol's total index; shares overlap where variables act together). "
        "Means are over all values of the other variables; a share below its error is "
        "not told from none."
    )
    return joined([paragraph(words), *parts])


def _share(share: float, error: float | None) -> str:
    if error is None:
        return f"{share:.0%}"
    return f"{share:.0%} ± {error:.0%}" if share else f"- ± {error:.0%}"


def slack(found: RankedStudy) -> Html | None:
    """State the slack of the limits, and which of them stand in the way."""
    if not found.limits:
        return None
    row = found.best
    rows = []
    for limit in found.limits:
        alone = [_kept(other, limit) for other in found.rows]
        rest = [
            all(_kept(other, each) for each in found.limits if each is not limit)
            for other in found.rows
        ]
        only = sum(r and not a for r, a in zip(rest, alone, strict=True))
        cells = [limit.text, f"{sum(alone)} of {len(alone)}", str(only)]
        if row is not None:
            value = float(str(row[limit.column]))
            left = value - limit.bound if limit.least else limit.bound - value
            cells += [quantity(limit.name, value), quantity(limit.name, left)]
        rows.append(cells)
    head = ["limit", "designs that keep it", "that only this one excludes"]
    if row is not None:
        head += [f"design {row['design']}", "left over"]
    return table(head, rows)


def nearby(found: Around | None) -> Html | None:
    """State what each variable and each limit is worth at the best design."""
    if found is None:
        return None
    return joined(
        [
            paragraph(NEARBY),
            table(*slope_table(found)),
            *([paragraph(WORTH), table(*price_table(found))] if found.prices else ()),
        ]
    )


def slope_table(found: Around) -> tuple[list[str], list[list[str]]]:
    """Head and rows: a variable per row, a metric per column."""
    metrics = list(dict.fromkeys(slope.metric for slope in found.slopes))
    rows = []
    for name in dict.fromkeys(slope.variable for slope in found.slopes):
        mine = [slope for slope in found.slopes if slope.variable == name]
        span = f"{cell(mine[0].low)} to {quantity(name, mine[0].high)}"
        rows.append([plain(name), span, *(_slope(slope) for slope in mine)])
    return ["variable", "tried", *map(headed, metrics)], rows


def price_table(found: Around) -> tuple[list[str], list[list[str]]]:
    """Head and rows: an objective and a limit per row."""
    rows = []
    for price in found.prices:
        name = price.objective
        worth = "-"
        if price.limit is not None:
            worth = "does not bind"
            if price.price > 0.0:
                own, other = unit_of(name) or "1", unit_of(price.limit.name) or "1"
                worth = f"{price.price:.3g} {own} per {other}"
        rows.append(
            [
                plain(name),
                "as they are" if price.limit is None else price.limit.text,
                worth,
                cell(price.now),
                cell(price.promised),
                "fails" if np.isnan(price.found) else cell(price.found),
                "yes" if price.kept else "no",
            ]
        )
    head = ["objective", "limits", "shadow price", "now", "promised", "simulated",
            "keeps the rest"]  # fmt: skip
    return head, rows


def _slope(slope: Slope) -> str:
    if np.isnan(slope.change):
        return "-"
    error = "" if np.isnan(slope.error) else f" ± {slope.error:.2g}"
    return f"{slope.change:+.3g}{error}"


def controllers_out(plan: Plan, rows: Sequence[Mapping[str, object]]) -> list[str]:
    """A sentence for each of several controllers that is out in some designs."""
    said = []
    for column, law in failed_by(plan.protocol).items():
        reasons = [str(row[column]) for row in rows if row[column]]
        if reasons:
            said.append(
                f"Controller {law} is out in {len(reasons)} of {len(rows)} designs; "
                f"the first: {reasons[0].rstrip('.')}."
            )
    return said


def failures(found: RankedStudy) -> Html | None:
    """Designs without numbers, by reason."""
    reasons = Counter(
        re.sub(r"-?\d[\d.,e+-]*", "…", str(row["failed"]))
        for row in found.rows
        if row["failed"]
    )
    said = [f"{many} designs: {why}." for why, many in reasons.most_common()]
    said += controllers_out(found.plan, found.rows)
    for name in found.plan.protocol.metrics:
        lacking = sum(row[name] is None and not row["failed"] for row in found.rows)
        if lacking:
            said.append(f"{lacking} designs ran, but have no {plain(name)}.")
    return bullets(said) if said else None


def fixed(found: RankedStudy) -> Html:
    """List what every design has in common."""
    plan, device = found.plan, Scene(found.plan.protocol.scene)
    protocol = plan.protocol
    rows: list[Sequence[str]] = [
        ("motion of the wearer", plan.source),
        ("task of the device", protocol.task),
        ("controllers", ", ".join(protocol.controllers)),
        ("length of the episode", f"{protocol.duration:g} s"),
        ("seed of all that is random", str(protocol.seed)),
        ("time step of the physics", f"{1e3 * protocol.timestep:g} ms"),
    ]
    for name in plan.ranges:
        if name not in found.varied:
            rows.append((plain(name), quantity(name, plan.designs[0][name])))
    for name, values in protocol.across.levels:
        each = ", ".join(cell(value) for value in values)
        rows.append((f"{plain(name)}, from case to case", f"{each} {unit_of(name)}"))
    said = {*plan.ranges, *protocol.across.names}
    said |= {one for name in said for one in SETS.get(name, ())}
    for cable, key, value in _of_scene(device):
        if key not in said and f"{cable}.{key}" not in said:
            owner = f"{cable}: " if cable else ""
            told = quantity(key, value)
            if key == "static_friction" and said & {"friction", f"{cable}.friction"}:
                told = "in the scene's proportion to friction"
            rows.append((owner + plain(key), told))
    return joined(
        [
            paragraph(
                "Everything that was not varied is as in the scene; effects of cables "
                "that are off are left out. A conduit is lengths and bend radii in "
                "metres; loops, wrap or length, where varied, bend it otherwise, and a "
                "diameter makes the cable stiffer."
            ),
            table(("what", "value"), rows),
        ]
    )


def _of_scene(device: Scene) -> Iterator[tuple[str, str, object]]:
    """Cable, variable and its value in the scene."""
    for name, cable in device.cables.items():
        for p in PARAMETERS:
            value = getattr(cable, p.name)
            if p.name in ALWAYS or value != p.default:
                yield name, p.name, value
        yield name, "conduit", cable.to_config()["conduit"]
        for key, radius in zip(RADII, device.radii[name], strict=True):
            yield name, key, radius
    motor, joint = device.spec.actuator("motor"), device.spec.joint("motor")
    yield "", "motor_torque", float(motor.ctrlrange[1] * motor.gear[0])
    yield "", "rotor_inertia", float(joint.armature)
    yield "", "motor_damping", float(np.ravel(joint.damping)[0])
    yield "", "strength", device.setup.strength
    yield "", "diameter", device.setup.diameter


def words(found: RankedStudy) -> Html:
    """List the meanings of the names."""
    crossed = found.plan.protocol.across.names
    names = [*found.plan.protocol.metrics, *found.plan.ranges, *crossed]
    rows = []
    for name in names:
        thing = METRICS.get(name) or describe(name)
        rows.append((name, thing.unit, thing.meaning))
    return table(("name", "unit", "meaning"), rows)


def _setting(found: RankedStudy, row: Row) -> str:
    return listed([f"{plain(n)} {quantity(n, row[n])}" for n in found.varied])


def _kept(row: Row, limit: Limit) -> bool:
    value = row[limit.column]
    if value is None:
        return False
    number = float(str(value))
    return number >= limit.bound if limit.least else number <= limit.bound


def _end(values: Range, value: object) -> str:
    """The end of its range at which a value lies; empty where it lies inside."""
    levels = [level for level in values.levels if not isinstance(level, str)]
    ends = values.ends or ((min(levels), max(levels)) if levels else None)
    if ends is None or isinstance(value, str) or ends[0] == ends[1]:
        return ""
    scale = np.log if values.log else np.asarray
    low, high, here = scale([*ends, float(str(value))])
    share = (here - low) / (high - low)
    return "low" if share <= EDGE else "high" if share >= 1.0 - EDGE else ""
