"""`cc-mujoco list`: names that other commands accept, such as devices and metrics."""

import difflib
import inspect
import re
import shutil
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from cc_mujoco.errors import CableError

if TYPE_CHECKING:
    from cc_mujoco.cable import Parameter
    from cc_mujoco.device import Device
    from cc_mujoco.metrics import Metric


@dataclass(frozen=True)
class Listing:
    """Show the names that other commands accept; with a word, their meanings."""

    word: Annotated[
        str,
        tyro.conf.Positional,
        tyro.conf.arg(metavar="[WORD]", help_behavior_hint=""),
    ] = ""
    """A group such as effects, a device, whose axes, cables and joints are shown,
    dataset.toml or rig.toml, of which an example with every key is shown, or a part of
    a name or a word of its meaning."""

    def run(self) -> None:
        from cc_mujoco.native import _library as native_library

        if not native_library.is_at_hand():
            native_library.do_without()  # before anything imports MuJoCo
        from cc_mujoco.assets import SCENES

        examples = {"dataset.toml": "datasets", "rig.toml": "hardware"}
        if folder := examples.get(self.word):
            example = Path(__file__).parents[1] / folder / self.word
            print(example.read_text(encoding="utf-8"))
            return
        from cc_mujoco.device import find_device
        from cc_mujoco.device._device_files import is_device_file

        groups = _groups()
        if self.word not in groups:
            native_library.library()  # of which models of devices have a need
            devices = {name: _plays(find_device(name)) for name in SCENES}
            groups = {"devices": devices} | groups
        if not self.word:
            for group, own in groups.items():
                print(f"{group}:")
                print(_wrapped("  ", "  ".join(own)))
            print(
                "\n`cc-mujoco list WORD` shows the meanings: of a group, a device or a "
                "name."
            )
        elif self.word in groups:
            _print_meanings({self.word: groups[self.word]})
        elif self.word in SCENES or is_device_file(Path(self.word)):
            device = find_device(self.word)
            _print_meanings({"devices": {self.word: _plays(device)}} | _parts(device))
        else:
            owner, _, name = self.word.rpartition(".")
            is_owned = owner and name in groups["variables"]
            _print_meanings(_matching(groups, name if is_owned else self.word))


def _groups() -> dict[str, Mapping[str, str]]:
    from cc_mujoco.control import CONTROLLERS, POSITION_CONTROLLERS
    from cc_mujoco.control._registry import DECOUPLED
    from cc_mujoco.device import MATERIALS, MOTORS, VARIABLES
    from cc_mujoco.diagnosis import EFFECTS
    from cc_mujoco.human import TASKS, TRAJECTORIES
    from cc_mujoco.metrics import METRICS

    return {
        "trajectories": _summaries(TRAJECTORIES),
        "tasks": _summaries(TASKS),
        "controllers": {
            **_summaries(CONTROLLERS),
            f"{DECOUPLED}NAME": "Any of them where cables pass joints of other axes.",
        },
        "position-controllers": _summaries(POSITION_CONTROLLERS),
        "effects": {name: effect.title for name, effect in EFFECTS.items()},
        "variables": {
            **_with_units(VARIABLES),
            "OWNER.NAME": "Variable of one cable or axis alone, as `flexor.friction`.",
        },
        "materials": {
            name: f"{material.meaning}; friction {material.friction.low:.2g} to "
            f"{material.friction.high:.2g}, typically {material.friction.typical:.2g}"
            for name, material in MATERIALS.items()
        },
        "motors": {
            name: f"{motor.continuous_torque:g} N m continuously, {motor.mass:g} kg; "
            f"{motor.source}"
            for name, motor in MOTORS.items()
        },
        "metrics": _with_units(METRICS),
    }


def _matching(
    groups: Mapping[str, Mapping[str, str]], word: str
) -> dict[str, Mapping[str, str]]:
    """Return the entries whose name has `word` or, if none has, whose meaning."""
    part = re.escape(word)
    # A word, as `foo` is no foot; its plural is the same word.
    for looked_at, pattern in enumerate((part, rf"(?<!\w){part}(s|es)?(?!\w)")):
        sought = re.compile(pattern, re.IGNORECASE)
        found = {
            group: {e[0]: e[1] for e in own.items() if sought.search(e[looked_at])}
            for group, own in groups.items()
        }
        if any(found.values()):
            return {group: own for group, own in found.items() if own}
    names = {*groups, *(name for own in groups.values() for name in own)}
    near = difflib.get_close_matches(word, names, n=1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    raise CableError(
        f"no name has {word!r} and no meaning that word; {hint}"
        "`cc-mujoco list` shows all names."
    )


def _print_meanings(groups: Mapping[str, Mapping[str, str]]) -> None:
    width = max(len(name) for group in groups.values() for name in group)
    for number, (group, entries) in enumerate(groups.items()):
        print(("\n" if number else "") + group)
        for name, meaning in entries.items():
            print(_wrapped(f"  {name:{width}}  ", meaning, " " * (width + 4)))


def _wrapped(first: str, text: str, later: str = "  ") -> str:
    width = max(shutil.get_terminal_size().columns, len(later) + 30)
    return textwrap.fill(
        text, width, initial_indent=first, subsequent_indent=later,
        break_on_hyphens=False,
    )  # fmt: skip


def _plays(device: "Device") -> str:
    from cc_mujoco._utils.user_code import without_mark

    about = device.description
    tasks = {axis.task for axis in about.axes}
    if len(about.axes) > 1:
        tasks = {f"{axis.name}={axis.task}" for axis in about.axes}
    played = f"{about.trajectory}, {', '.join(sorted(tasks))}"
    return f"{about.meaning}; plays {without_mark(played)}"


def _parts(device: "Device") -> dict[str, dict[str, str]]:
    about = device.description
    return {
        f"axes of {device.name}": {
            axis.name: f"motor {axis.motor} drives joint {axis.joint} by cable "
            f"{', '.join(axis.cables)}"
            for axis in about.axes
        },
        f"cables of {device.name}": {
            name: f"{cable.length:.3g} m, friction {cable.friction:g}, pretension "
            f"{cable.pretension:g} N"
            for name, cable in device.cables.items()
        },
        f"joints of {device.name} that the wearer moves": {
            joint: f"actuator {name}" for joint, name in about.movers.items()
        },
    }


def _summaries(registry: Mapping[str, object]) -> dict[str, str]:
    lines = {name: inspect.getdoc(entry) or "" for name, entry in registry.items()}
    return {name: text.partition("\n")[0] for name, text in lines.items()}


def _with_units(registry: "Mapping[str, Metric | Parameter]") -> dict[str, str]:
    return {
        name: entry.meaning + ("" if entry.unit == "1" else f" [{entry.unit}]")
        for name, entry in registry.items()
    }
