"""Reports on cables that a model was given, and on what acted on their tendons."""

import dataclasses
from collections.abc import Sequence

import mujoco

from cc_mujoco.plugin._tendons.burden import Burden, can_push, kind_of
from cc_mujoco.plugin._tendons.winch import Winch

ENDS = ("proximal", "distal")
"""Suffixes of the names of a cable's two actuators."""


@dataclasses.dataclass(frozen=True)
class AddedCables:
    """Report on cables that a model was given; its text is one line for each change.

    Attributes:
        cables: names of the cables; of a tendon with pulleys one for every branch.
        winch: name of the new drive of the proximal ends: the fixed tendon on which the
            loads of a tendon act now, or the joint of a motor; empty if there is none,
            or if `parts` have winches of their own.
        lines: report on every element and load, or one line for each of `parts`.
        parts: the reports on several tendons, in their order.
    """

    cables: tuple[str, ...]
    winch: str
    lines: tuple[str, ...]
    parts: "tuple[AddedCables, ...]" = ()

    def __str__(self) -> str:
        return "\n".join(self.lines)


def actuator_label(model: mujoco.MjModel, actuator: int) -> str:
    """Return the kind of an actuator and its name, or its index without one."""
    return f"{kind_of(model, actuator)} {model.actuator(actuator).name or actuator!r}"


def summary_line(original: mujoco.MjModel, burden: Burden, report: AddedCables) -> str:
    """Return one line on a tendon: its cables, and the loads that its winch carries."""
    moved = [actuator_label(original, i) for i in burden.actuators]
    moved += burden.fields
    if burden.equalities:
        moved.append("equality")
    if burden.sensors:
        moved.append("sensor")
    text = report.lines[0]
    if report.winch:
        text += f"; winch {report.winch!r}: {', '.join(moved) or 'its pulleys'}"
    elif burden.is_band:
        text += "; its stiffness is that of the cable"
    return text


def describe_winch(
    original: mujoco.MjModel, spec: mujoco.MjSpec, winch: Winch
) -> list[str]:
    burden = winch.burden
    index, place = burden.index, f"winch {burden.winch!r}"
    lines = []
    if burden.has_pulleys:
        parts = ", ".join(f"{b.name!r} (1/{b.divisor:g})" for b in burden.branches)
        lines.append(
            f"<pulley>: the branches are the cables {parts}, each with its share of "
            f"the force; tendon {burden.tendon!r} stays as their length"
        )
    for i in burden.actuators:
        label = actuator_label(original, i)
        law = "the same command, gains and ranges"
        if spec.actuators[i].gaintype == mujoco.mjtGain.mjGAIN_MUSCLE:
            low, high = original.actuator_lengthrange[original.actuator_outadr[i]]
            law = f"the same excitation and length range {low:.4g} to {high:.4g} m"
        lines.append(f"{label}: pulls at the first site, through {place}, by {law}")
    if can_push(original, burden):
        lines.append(
            f"pushing: a cable cannot; the actuators of {place} give no force that "
            "would lengthen it"
        )
    if "stiffness" in burden.fields:
        low, high = burden.rest
        text = (
            f"stiffness {burden.spring[0]:g} N/m: a spring at the first site, on "
            f"{place}, without force up to {high:.4g} m"
        )
        if low > 0.0:
            text += f"; below {low:.4g} m, where it pushed, the cable is slack"
        lines.append(text)
    if "springyield" in burden.fields:
        value = original.tendon_springyield[index]
        lines.append(
            f"springyield {value:g} m: the spring on {place} yields for good beyond "
            "that stretch"
        )
    dry, mass = original.tendon_frictionloss[index], original.tendon_armature[index]
    texts = {
        "damping": f"damping: acts on {place}, on what moves past the first site",
        "frictionloss": f"frictionloss {dry:g} N: acts on {place}",
        "armature": f"armature {mass:g} kg: turns with {place}",
    }
    lines += [text for field, text in texts.items() if field in burden.fields]
    if "range" in burden.fields:
        least, most = original.tendon_range[index]
        text = f"range: {place} pays out no more than {most:.4g} m"
        if least > 0.0:
            text += (
                f" and winds up to {least:.4g} m; a path that joints make shorter than "
                "that hangs slack, so limit the joints"
            )
        lines.append(text)
        lines += range_lines(burden, original)
    if "actuatorfrcrange" in burden.fields:
        lines.append(f"actuatorfrcrange: limits the actuators of {place}")
    for i in burden.equalities:
        name = spec.equalities[i].name or f"number {i}"
        lines.append(f"equality {name!r}: holds the length that {place} pays out")
    for i in burden.sensors:
        lines.append(f"sensor {spec.sensors[i].name or i!r}: reads {place}")
    kept = [
        sensor.name or str(i)
        for i, sensor in enumerate(spec.sensors)
        if sensor.objtype == mujoco.mjtObj.mjOBJ_TENDON
        and sensor.objname == burden.tendon
    ]
    if kept:
        lines.append(
            f"sensors {', '.join(map(repr, kept))}: still read the length of the path"
        )
    joints = ", ".join(map(repr, winch.names))
    mass = ", ".join(f"{m:.2g}" for m in winch.inertias)
    drag = ", ".join(f"{c:.2g}" for c in winch.damping)
    word = "joint" if len(winch.names) == 1 else "joints"
    unit = "angle" if winch.radius else "length paid out"
    lines.append(
        f"new {word} {joints}, last in qpos: {unit}, of inertia {mass} kg and damping "
        f"{drag} N s/m at the tendon; a pose set by hand needs the length of the path "
        "there, then `cc_mujoco.plugin.settle`"
    )
    return lines


def range_lines(burden: Burden, original: mujoco.MjModel) -> list[str]:
    """Return a sentence where `qpos0` violates the `range` of a tendon, with its size.

    The limit then pulls the tendon from the first step on.
    """
    low, high = original.tendon_range[burden.index]
    off = max(low - burden.length, burden.length - high)
    if "range" not in burden.fields or off <= 0.0:
        return []
    return [
        f"tendon {burden.tendon!r} is {burden.length:.4g} m long in `qpos0`, "
        f"{off:.4g} m out of its `range` of {low:.4g} to {high:.4g} m, which pulls it "
        "there from the first step on; change the range or the pose."
    ]


def describe_band(burden: Burden, stiffness: float, pretension: float) -> str:
    """Return a report's line on a tendon made an elastic cable of `stiffness` [N]."""
    low, high = burden.rest
    text = (
        f"stiffness {burden.spring[0]:g} N/m beyond {high:.4g} m: an elastic band, "
        f"axial_stiffness {stiffness:.4g} N, {pretension:.4g} N in the pose qpos0"
    )
    if low > 0.0:
        text += f"; below {low:.4g} m, where the tendon pushed, it is slack"
    return text


def order_line(model: mujoco.MjModel, cables: Sequence[str], before: int) -> str:
    """Return the line on cable ends in `ctrl`, beside `before` other actuators."""
    ends = [model.actuator(f"{name}_{end}").id for name in cables for end in ENDS]
    places = sorted(int(model.actuator_ctrladr[end]) for end in ends)
    text = "the places of all others stay"
    if places[0] < before:
        text = "the places of those behind them change"
    return (
        f"ctrl: the ends of the cable are {places[0]} to {places[-1]}, which take no "
        f"command; {text}"
    )
