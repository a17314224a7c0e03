"""Texts and tables of a study's report page, section by section, without figures."""

import math
import re
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np
import pyarrow as pa

from cc_mujoco.cable._cable import PARAMETERS
from cc_mujoco.design import _follow_up as follow_up
from cc_mujoco.design import _pareto as pareto
from cc_mujoco.design._designs import Range
from cc_mujoco.design._plan import Plan
from cc_mujoco.design._protocol import DEFAULT_OBJECTIVES, known_metric, metric_of
from cc_mujoco.design._results_store import CONTROLLER_COLUMN, failure_columns
from cc_mujoco.design._scenarios import WORST_CASE_SUFFIX
from cc_mujoco.design._sensitivity import Sensitivity, sensitivity
from cc_mujoco.device import Device
from cc_mujoco.device._materials import ENDS
from cc_mujoco.device._plant import RADII
from cc_mujoco.device._variables import SETS, VALUES, describe, split
from cc_mujoco.report._html import (
    Html,
    bullet_list,
    element,
    join_pieces,
    list_words,
    paragraph,
    share_bar,
    short_table,
    table,
)

Row = Mapping[str, object]

NEAR_BEST_SHARE = 0.05  # of an objective's range within which designs equal the best
UNKNOWN_REASON = (
    "no variation, too few designs, or designs left out are not predicted by the others"
)
SLOPES_NOTE = (
    "How much each number changes at the best design for a tenth of a variable's range "
    "more, or over the neighbouring values where only some are allowed: by designs a "
    "fiftieth of the range to either side (column “tried”). Behind ± stands half the "
    "difference between the two sides; where it is as large as the change itself, the "
    "number bends there and the slope says little."
)
PRICES_NOTE = (
    "What moving by up to a tenth of every range should bring by these slopes (a "
    "linear program), the other objectives no worse, and what it brought when it was "
    "simulated: with the limits as they are, and with each relaxed by a tenth of its "
    "size. A shadow price is what one unit of a limit is worth; a limit that does not "
    "bind is worth nothing here. Where the simulated number is not better than now, "
    "the slopes promise too much; where it is better with the limits as they are, and "
    "keeps the rest, the best design was not yet the optimum. “Keeps the rest” allows "
    "another objective to be 1 % worse."
)


class RankedStudy:
    def __init__(
        self,
        plan: Plan,
        table: pa.Table,
        nearby: follow_up.Around | None = None,
        half: follow_up.Halved | None = None,
    ) -> None:
        self.plan, self.limits, self.varied = plan, plan.limits, plan.varied
        self.protocol, self.table = plan.protocol, table
        self.nearby, self.half = nearby, half
        self.rows: tuple[Row, ...] = tuple(table.to_pylist())
        self.chosen = bool(plan.objectives)  # otherwise they are usual ones
        self.goals = goals_of(plan, table)
        self.cost = pareto.objective_costs(table, self.goals, self.limits)
        self.kept = pareto.within_limits(table, self.limits)  # mask of designs
        self.order = pareto.rank_designs(self.cost)  # designs from best to worst
        self.front = pareto.pareto_rows(self.cost)  # mask of the Pareto set
        first = int(self.order[0])
        # None where no design has all numbers and keeps the limits.
        self.best = None if np.isnan(self.cost[first]).any() else self.rows[first]

    @cached_property
    def sensitivities(self) -> list[Sensitivity]:
        metrics = self.protocol.metrics
        found = (sensitivity(self.plan, self.table, name) for name in metrics)
        return [one for one in found if one is not None]

    @property
    def marked(self) -> tuple[int, ...]:
        """Rows of the best design and of the best in each objective, each once."""
        members = np.flatnonzero(self.front)
        if not members.size:
            return (int(self.order[0]),)
        ends = members[np.argmin(self.cost[members], axis=0)]
        return tuple(dict.fromkeys(map(int, (self.order[0], *ends))))


def goals_of(plan: Plan, table: pa.Table) -> tuple[pareto.Objective, ...]:
    """Return the objectives of a study, or default ones among metrics with numbers."""
    if plan.objectives:
        return plan.objectives
    measured = plan.protocol.metrics
    had = [name for name in measured if table[name].null_count < len(table)]
    names = had or measured
    directed = [name for name in names if metric_of(name).better] or names
    usual = [name for name in DEFAULT_OBJECTIVES if name in directed]
    chosen = usual if len(usual) > 1 else [*usual, *directed]
    chosen = list(dict.fromkeys(chosen))[: len(DEFAULT_OBJECTIVES)]
    return tuple(pareto.Objective(name, metric_of(name).high) for name in chosen)


def header(found: RankedStudy, picture: Html, folder: Path) -> Html:
    """Return the answer, the next command and the question of a study in `folder`."""
    meaning = found.protocol.device.description.meaning
    title = element("h1", f"What if? {meaning[:1].upper()}{meaning[1:]}")
    goals = list_words(list(map(_wish, found.goals)))
    if not found.chosen:
        goals += " (no objective was given; --objective METRIC chooses others)"
    count = len(found.rows)
    many = f"{count} designs were" if count != 1 else "1 design was"
    many += f" simulated, looking for {goals}"
    if found.limits:
        limits = list_words([limit.text for limit in found.limits])
        many += f" with {limits}, which {int(found.kept.sum())} keep"
    request = [paragraph(f"{many}.")]
    if axes := found.protocol.axes:
        request.append(paragraph(axes_sentence(axes)))
    if found.protocol.across.several:
        request.append(paragraph(cases_sentence(found.plan)))
    lead = paragraph(answer_sentence(found), kind="lead")
    if found.best is None:
        return element("header", title, lead, *_least_violating(found), *request)
    return element(
        "header", title, lead, picture, _summary_answer(found, folder), *request
    )


def _wish(goal: pareto.Objective) -> str:
    return f"{'most' if goal.high else 'least'} {plain_name(goal.name)}"


def answer_sentence(found: RankedStudy) -> str:
    best = found.best
    if best is None:
        return "No design is good enough."
    first = "The best design" if len(found.goals) == 1 else "The best compromise"
    if len(found.rows) == 1:
        first = "The only design"
    elif len(found.goals) > 1 and int(found.front.sum()) == 1:
        first = "Best in all objectives of those tried"
    gives = _quantities(best, [goal.name for goal in found.goals])
    setting = _quantities(best, found.varied)
    which = f"design {best['design']}" + (f", {setting}" if setting else "")
    return f"{first} is {which}: {gives}."


def _summary_answer(found: RankedStudy, folder: Path) -> Html:
    """Return certainty and next step, as a summary for readers who stop here."""
    row, edges = found.best, variables_at_ends(found)
    assert row is not None
    study = shlex.quote(str(folder.resolve()))
    show = element("code", f"cc-mujoco whatif-show {study} {row['design']}")
    sure = join_pieces([element("b", "How sure: "), f"{near_best_sentence(found)}."])
    items: list[Html] = [sure]
    if edges:
        names = list_words([plain_name(name) for name, _ in edges])
        wider = f"vary {names} further, as the best lies at an end."
        items.append(join_pieces([element("b", "Wider: "), wider]))
    return join_pieces([paragraph(element("b", "Next: "), show), bullet_list(items)])


def near_best_sentence(found: RankedStudy) -> str:
    """Return a sentence on how many other designs are about as good as the best."""
    first = int(found.order[0])
    good = ~np.isnan(found.cost).any(axis=1)
    if good.sum() == 1:
        return "no other design can be compared with it"
    span = np.ptp(found.cost[good], axis=0)
    near = good & (found.cost <= found.cost[first] + NEAR_BEST_SHARE * span).all(axis=1)
    others = int(near.sum()) - 1
    many = f"{others or 'No'} other design{' is' if others < 2 else 's are'}"
    meaning = "it stands alone, so small differences from it cost something"
    if others:
        meaning = "what they have in common matters, not the last digit of the best"
    within = f"within {NEAR_BEST_SHARE:.0%} of the range of every objective"
    return f"{many} as good to {within}: {meaning}"


def variables_at_ends(found: RankedStudy) -> list[tuple[str, str]]:
    """Return the best design's variables at an end of their range, and which end."""
    row, ranges = found.best, found.plan.ranges
    if row is None:
        return []
    ends = ((name, _range_end(ranges[name], row[name])) for name in found.varied)
    return [(name, end) for name, end in ends if end]


def axes_sentence(axes: Sequence[str]) -> str:
    return (
        f"The device has the axes {list_words(axes)}; a number is that of the worst of "
        "them, unless it names one, and a design that is unsafe at one has failed."
    )


def cases_sentence(plan: Plan) -> str:
    return (
        f"Every number of a design is {plan.protocol.across.aggregation()}. A design "
        "that fails in one of them has failed, one without a number in one of them has "
        "none, and limits hold in all of them."
    )


def _least_violating(found: RankedStudy) -> list[Html]:
    limits = found.limits
    known = [r for r in found.rows if all(r[n.column] is not None for n in limits)]
    if not limits or not known:
        return []
    row = min(known, key=lambda row: max(limit.beyond(row) for limit in limits))
    gives = list_words([f"{plain_name(n.name)} {format_quantity(n.name, row[n.column])}"
                    for n in limits])  # fmt: skip
    nearest = f"design {row['design']}, {_quantities(row, found.varied)}"
    return [paragraph(f"The nearest is {nearest}: {gives}.", kind="lead")]


def best_designs(found: RankedStudy) -> Html | None:
    if found.best is None:
        return None
    names = [goal.name for goal in found.goals]
    names += [n.column for n in found.limits if n.column not in names]
    if len(found.protocol.controllers) > 1:
        names.append(CONTROLLER_COLUMN)
    if found.protocol.across.several:
        names += [f"{goal.name}@{WORST_CASE_SUFFIX}" for goal in found.goals]
    goals = len(found.goals)
    columns = ["design", *names[:goals], *found.varied, *names[goals:]]
    rows = []
    for place in found.order[:10]:  # the ten best
        if np.isnan(found.cost[place]).any():
            break
        row = found.rows[int(place)]
        cells = [format_cell(row[name]) for name in columns]
        rows.append([cells[0] + ("*" if found.front[place] else ""), *cells[1:]])
    words = "The order is by the objective."
    if goals > 1:
        words = (
            "The order is by mean rank in the objectives, after the designs that no "
            "other beats in all of them (marked *)."
        )
    return join_pieces([paragraph(words), short_table([*map(_heading, columns)], rows)])


def confidence(found: RankedStudy) -> Html | None:
    if found.best is None:
        return None
    sentences = [f"{near_best_sentence(found)}."]
    ends = variables_at_ends(found)
    if edges := [f"{plain_name(name)} at the {end} end" for name, end in ends]:
        sentences.append(
            f"It has {list_words(edges)} of what was tried; a wider range may hold "
            "something better."
        )
    if found.nearby is not None:
        beside = (_better_neighbour(found, price) for price in found.nearby.prices)
        sentences += filter(None, beside)
    if found.half is not None:
        sentences.append(timestep_sentence(found.half))
    if uncertain := material_sentence(found.plan):
        sentences.append(uncertain)
    if found.plan.search is not None:
        first, count = int(found.order[0]), len(found.rows)
        after = "the rest of the search brought nothing better."
        if (first + 1) / count > 0.8:  # it has not converged
            after = "so late, more designs may well find a better one."
        sentences.append(f"The search found it as design {first} of {count}; {after}")
    if len(found.protocol.controllers) == 1:
        sentences.append(
            "Tracking, torque, power and tension are the controller's as well as the "
            "design's; --controllers with several names shows by how much."
        )
    sentences.append(
        "All numbers are of a simulation with perfect sensors and one wearer's motion, "
        f"{describe_controllers(found.protocol.controllers)}; parts, wearers and "
        "liners that differ from the model give other numbers."
    )
    return bullet_list(sentences)


def material_sentence(plan: Plan) -> str:
    """Return a warning if a study varies materials, whose friction is uncertain."""
    named = {name.rpartition(".")[2] for name in plan.ranges}
    covered = {*named, *plan.protocol.across.names}
    if "material" not in named or "material_friction" in covered:
        return ""
    return (
        "The friction of a material is uncertain by a factor of two: judge designs "
        f"with --across material_friction={','.join(ENDS)}, and measure the pair."
    )


def timestep_sentence(half: follow_up.Halved) -> str:
    step = f"half the time step, {1e3 * half.timestep:g} ms"
    if not half.unsettled:
        many = f"{len(half.designs)} designs from the best to the worst"
        one = f"design {half.designs[0]} gives"
        what = f"{many} give" if len(half.designs) > 1 else one
        most = half.changes[0]
        return (
            f"At {step}, {what} the same numbers to within {most.share:.1%} "
            f"({plain_name(most.metric)})."
        )
    largest = []
    for each in half.unsettled:
        name, value, other = each.metric, each.value, each.half_step_value
        found = f"design {each.design} fails"
        if math.isfinite(other):
            pair = f"{format_quantity(name, other)} instead of {format_cell(value)}"
            found = f"{plain_name(name)} of design {each.design} is {pair}"
        largest.append(found)
    return (
        f"At {step}, {list_words(largest)}: such numbers say more of the step than of "
        f"the design. --timestep {half.timestep:g} repeats the study there; where that "
        "does not settle them, the controller swings against the cable."
    )


def _better_neighbour(found: RankedStudy, price: follow_up.Price) -> str:
    (goal,) = (goal for goal in found.goals if goal.name == price.objective)
    gain = goal.cost({goal.name: price.now}) - goal.cost({goal.name: price.found})
    better = gain > follow_up.OBJECTIVE_TOLERANCE * abs(price.now)
    if price.limit is not None or not price.kept or not better:
        return ""
    beside = _quantities(price.design, found.varied)
    return (
        f"It is not the optimum: beside it, {beside} gives "
        f"{plain_name(goal.name)} {format_quantity(goal.name, price.found)} instead of "
        f"{format_cell(price.now)} and keeps the limits; more designs are worth trying."
    )


def controllers(found: RankedStudy) -> Html | None:
    """Return how much the ranking depends on the controller; None if there is one."""
    laws = found.protocol.controllers
    goals = [goal for goal in found.goals if metric_of(goal.name).driven]
    if len(laws) == 1 or not goals:
        return None
    from scipy.stats import spearmanr

    rows = []
    for law in laws:
        chosen = sum(row[CONTROLLER_COLUMN] == law for row in found.rows)
        cells = [law, f"{chosen} of {len(found.rows)}"]
        for goal in goals:
            column = f"{goal.name}@{law}"
            names = (column, goal.name)
            pairs = np.stack([pareto.column(found.table, name) for name in names])
            pairs = pairs[:, np.isfinite(pairs).all(axis=0)]
            varies = pairs.shape[1] > 2 and np.ptp(pairs, axis=1).all()
            rank_correlation = f"{spearmanr(*pairs).statistic:.2f}" if varies else "-"
            own = [] if found.best is None else [format_cell(found.best[column])]
            cells += [*own, rank_correlation]
        rows.append(cells)
    head = ["controller", "tracks best in"]
    for goal in goals:
        texts = [] if found.best is None else [f"design {found.best['design']}"]
        texts.append("rank correlation")
        head += [f"{column_title(goal.name)}, {text}" for text in texts]
    words = (
        "A design is ranked with the controller that tracks best with it. The rank "
        "correlation (Spearman's, 1 is the same order) shows whether another "
        "controller alone would have ordered the designs as they are ordered here; "
        "where it is far from 1, the number is as much the controller's as the "
        "design's."
    )
    return join_pieces([paragraph(words), short_table(head, rows)])


def trade_offs(found: RankedStudy) -> Html | None:
    members = np.flatnonzero(found.front)
    if len(found.goals) < 2 or members.size < 2:
        return None
    ends = {"best compromise": int(found.order[0])}
    for column, goal in enumerate(found.goals):
        ends[_wish(goal)] = int(members[np.argmin(found.cost[members, column])])
    columns = ["design", *(goal.name for goal in found.goals), *found.varied]
    rows = []
    for title, row in ends.items():
        rows.append([title, *(format_cell(found.rows[row][name]) for name in columns)])
    opening = (
        f"No design beats the {members.size} of the Pareto set in all objectives: to "
        "gain in one, another has to give."
    )
    head = ["", *map(_heading, columns)]
    return join_pieces([paragraph(opening), short_table(head, rows)])


def deciding_variables(found: RankedStudy) -> Html:
    every, goals = {one.metric: one for one in found.sensitivities}, found.goals
    known = [every[goal.name] for goal in goals if goal.name in every]
    unknown = [plain_name(goal.name) for goal in goals if goal.name not in every]
    parts: list[Html] = []
    if unknown:
        lost = list_words(unknown)
        parts.append(paragraph(f"No shares are known of {lost}: {UNKNOWN_REASON}."))
    if not known:
        return parts[0]
    for one in known:
        rows = []
        for name in one.ranked:
            ends, share = one.extremes(name, format_cell), one.total[name]
            if not np.ptp(one.effects[name][1]):  # the surface does without it
                ends = ["-", "-"]
            share_text = index_text(share, one.errors[1].get(name), ".0%")
            bar = join_pieces([share_text, share_bar(share)])
            rows.append([plain_name(name), bar, *ends])
        unit = metric_of(one.metric).unit
        head = ("variable", "share", f"least mean [{unit}]", f"greatest mean [{unit}]")
        how = paragraph(f"{one.how[:1].upper()}{one.how[1:]}.", kind="small")
        parts += [element("h3", plain_name(one.metric)), short_table(head, rows), how]
    words = (
        "The share of the differences between designs that goes when a variable is "
        "held (Sobol's total index; shares overlap where variables act together). "
        "Means are over all values of the other variables; a share below its error "
        "may be 0."
    )
    return join_pieces([paragraph(words), *parts])


def limit_slack(found: RankedStudy) -> Html | None:
    if not found.limits:
        return None
    kept = [pareto.within_limits(found.table, [limit]) for limit in found.limits]
    keeps, row = np.stack(kept, axis=-1), found.best
    rows = []
    for place, limit in enumerate(found.limits):
        rest = np.delete(keeps, place, axis=1).all(axis=1)
        only, alone = rest & ~keeps[:, place], keeps[:, place]
        cells = [limit.text, f"{alone.sum()} of {alone.size}", str(only.sum())]
        if row is not None:
            value = float(str(row[limit.column]))
            left = value - limit.bound if limit.least else limit.bound - value
            cells += [format_quantity(limit.name, each) for each in (value, left)]
        rows.append(cells)
    head = ["limit", "designs that keep it", "that only this one excludes"]
    if row is not None:
        head += [f"design {row['design']}", "left over"]
    return short_table(head, rows)


def local_values(found: follow_up.Around | None) -> Html | None:
    if found is None:
        return None
    parts = [paragraph(SLOPES_NOTE), short_table(*slope_table(found))]
    if found.prices:
        parts += [paragraph(PRICES_NOTE), short_table(*price_table(found))]
    return join_pieces(parts)


def slope_table(found: follow_up.Around) -> tuple[list[str], list[list[str]]]:
    metrics = list(dict.fromkeys(slope.metric for slope in found.slopes))
    rows = []
    for name in dict.fromkeys(slope.variable for slope in found.slopes):
        mine = [slope for slope in found.slopes if slope.variable == name]
        span = f"{format_cell(mine[0].low)} to {format_quantity(name, mine[0].high)}"
        rows.append([plain_name(name), span, *(_slope(slope) for slope in mine)])
    return ["variable", "tried", *map(column_title, metrics)], rows


def price_table(found: follow_up.Around) -> tuple[list[str], list[list[str]]]:
    rows = []
    for price in found.prices:
        name, limit, worth = price.objective, "as they are", "-"
        if price.limit is not None:
            limit, worth = price.limit.text, "does not bind"
            if price.price > 0.0:
                own, other = unit_of(name) or "1", unit_of(price.limit.name) or "1"
                worth = f"{price.price:.3g} {own} per {other}"
        numbers = [format_cell(price.now), format_cell(price.promised)]
        found_text = "fails" if np.isnan(price.found) else format_cell(price.found)
        kept = "yes" if price.kept else "no"
        rows.append([plain_name(name), limit, worth, *numbers, found_text, kept])
    head = ["objective", "limits", "shadow price", "now", "promised", "simulated",
            "keeps the rest"]  # fmt: skip
    return head, rows


def _slope(slope: follow_up.Slope) -> str:
    if np.isnan(slope.change):
        return "-"
    error = "" if np.isnan(slope.error) else f" ± {slope.error:.2g}"
    return f"{slope.change:+.3g}{error}"


def controllers_out(found: RankedStudy) -> list[str]:
    sentences, count = [], len(found.rows)
    for column, law in failure_columns(found.protocol).items():
        reasons = [str(row[column]) for row in found.rows if row[column]]
        if reasons:
            sentences.append(
                f"Controller {law} is out in {len(reasons)} of {count} designs; "
                f"the first: {reasons[0].rstrip('.')}."
            )
    return sentences


def failure_reasons(found: RankedStudy) -> list[str]:
    """Return a sentence per reason of failures, the most frequent first.

    Reasons that differ in their numbers are one, with those of the first design.
    """
    similar: dict[str, list[str]] = {}
    for row in found.rows:
        if row["failed"]:
            reason = str(row["failed"]).rstrip(".")
            key = re.sub(r"-?\d[\d.,e+-]*", "", reason)
            similar.setdefault(key, []).append(reason)
    return [
        f"{len(same)} designs, the first: {same[0]}."
        if len(same) > 1
        else f"1 design: {same[0]}."
        for same in sorted(similar.values(), key=len, reverse=True)
    ]


def failures(found: RankedStudy) -> Html | None:
    sentences = [*failure_reasons(found), *controllers_out(found)]
    for name in found.protocol.metrics:
        lacking = sum(row[name] is None and not row["failed"] for row in found.rows)
        if lacking:
            which = "design ran, but has" if lacking == 1 else "designs ran, but have"
            sentences.append(f"{lacking} {which} no {plain_name(name)}.")
    return bullet_list(sentences) if sentences else None


def common_values(found: RankedStudy) -> Html:
    plan, protocol = found.plan, found.protocol
    rows: list[Sequence[str]] = [
        ("motion of the wearer", protocol.sources[0]),
        ("task of the device", protocol.sources[1]),
        ("controllers", ", ".join(protocol.controllers)),
        ("length of the episode", f"{protocol.duration:g} s"),
        ("seed of all that is random", str(protocol.seed)),
        ("time step of the physics", f"{1e3 * protocol.timestep:g} ms"),
    ]
    for name in plan.ranges:
        if name not in found.varied:
            same = format_quantity(name, plan.designs[0][name])
            rows.append((plain_name(name), same))
    for name, values in protocol.across.levels:
        each = f"{', '.join(map(format_cell, values))} {unit_of(name)}"
        rows.append((f"{plain_name(name)}, from case to case", each))
    mentioned = {*plan.ranges, *protocol.across.names}
    mentioned |= {one for name in mentioned for one in SETS.get(name, ())}
    for cable, key, value in _of_scene(protocol.device):
        if key not in mentioned and f"{cable}.{key}" not in mentioned:
            owner = f"{cable}: " if cable else ""
            text = format_quantity(key, value)
            friction = {"friction", f"{cable}.friction"}
            if key == "static_friction" and mentioned & friction:
                text = "in the scene's proportion to friction"
            rows.append((owner + plain_name(key), text))
    note = (
        "Everything that was not varied is as in the scene; effects of cables that are "
        "off are left out. A conduit is lengths and bend radii in metres; loops, wrap "
        "or length, where varied, bend it otherwise, and a diameter makes the cable "
        "stiffer."
    )
    return join_pieces([paragraph(note), table(("what", "value"), rows)])


def _of_scene(device: Device) -> Iterator[tuple[str, str, object]]:
    """Yield cable, variable and value of the scene, mostly without defaults."""
    for name, cable in device.cables.items():
        for p in PARAMETERS:
            value = getattr(cable, p.name)
            listed = p.name in ("axial_stiffness", "pretension", "friction")
            if listed or value != p.default:
                yield name, p.name, value
        yield name, "conduit", cable.to_config()["conduit"]
        ends = zip(RADII, device.radii[name], device.ends[name], strict=True)
        for key, radius, end in ends:
            if end.trntype == mujoco.mjtTrn.mjTRN_JOINT:  # a lever has no radius
                yield name, key, radius
    axes = device.description.axes
    for axis in axes:
        joint = device.spec.joint(axis.drum)
        name = axis.name if len(axes) > 1 else ""
        yield name, "motor_torque", axis.torque
        yield name, "rotor_inertia", float(joint.armature)
        yield name, "motor_damping", float(np.ravel(joint.damping)[0])
    for key in ("strength", "diameter"):
        known = getattr(device.description, key)
        yield "", key, None if math.isnan(known) else known


def variable_meanings(found: RankedStudy) -> Html:
    protocol = found.protocol
    names = (*protocol.metrics, *found.plan.ranges, *protocol.across.names)
    things = {name: known_metric(name) or describe(name) for name in names}
    rows = [(name, thing.unit, thing.meaning) for name, thing in things.items()]
    return table(("name", "unit", "meaning"), rows)


def _heading(name: str) -> str:
    return column_title(name).replace("@", ", ").replace("_", " ")


def _quantities(row: Row, names: Iterable[str]) -> str:
    return list_words([f"{plain_name(n)} {format_quantity(n, row[n])}" for n in names])


def _range_end(values: Range, value: object) -> str:
    """Return "low" or "high" if a value is within 2 % of that end, else ""."""
    levels = [level for level in values.levels if not isinstance(level, str)]
    ends = values.ends or ((min(levels), max(levels)) if levels else None)
    if ends is None or isinstance(value, str) or ends[0] == ends[1]:
        return ""
    scale = np.log if values.log else np.asarray
    low, high, here = scale([*ends, float(str(value))])
    share = (here - low) / (high - low)
    return "low" if share <= 0.02 else "high" if share >= 0.98 else ""


def unit_of(name: str) -> str:
    name, _, of = name.partition("@")
    if of == WORST_CASE_SUFFIX:
        return ""
    thing = known_metric(name) or VALUES.get(split(name)[1])
    return "" if thing is None or thing.unit == "1" else thing.unit


def column_title(name: str) -> str:
    unit = unit_of(name)
    return f"{name} [{unit}]" if unit else name


def format_cell(value: object) -> str:
    """Return a value to three significant digits, or `-` for None."""
    if value is None:
        return "-"
    if not isinstance(value, float):
        return str(value)
    text = f"{value:.3g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < 1e7 else text


def plain_name(name: str) -> str:
    """Return a name as words of a sentence, an axis's metric as `hip: peak torque`."""
    owner, own = split(name)
    text = own.replace("_", " ")
    return f"{owner}: {text}" if owner else text


def format_quantity(name: str, value: object) -> str:
    """Return a value with its unit, for a sentence."""
    unit, text = unit_of(name), format_cell(value)
    return f"{text} {unit}" if unit and value is not None else text


def index_text(share: float, error: float | None, form: str = ".3f") -> str:
    """Return a Sobol index as text, with its error unless that is None (exact)."""
    if error is None:
        return f"{share:{form}}"
    return f"{share:{form}} ± {error:{form}}" if share else f"- ± {error:{form}}"


def describe_controllers(controllers: Sequence[str]) -> str:
    if len(controllers) == 1:
        return f"controller {controllers[0]}"
    names = ", ".join(controllers)
    return f"for each design the best by tracking of controllers {names}"
