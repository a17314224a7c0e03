"""The folder of an exported controller in C, written whole or not at all."""

import itertools
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from cc_mujoco._utils import atomic_io
from cc_mujoco._utils.provenance import write_manifest
from cc_mujoco.cable._layout import STATE_HEADER, state_size
from cc_mujoco.control import _guard as guard
from cc_mujoco.control import _law_steps as law_steps
from cc_mujoco.export._controllers import AxisPlan, ExportPlan
from cc_mujoco.export._joint_torques import own_readings
from cc_mujoco.export._ros2_control import ROS2_FILES, ros2_texts
from cc_mujoco.export._templates import fill
from cc_mujoco.native import _library as native_library
from cc_mujoco.native._c99 import CLibrary, literal
from cc_mujoco.native._kinds import python_function

HEADER_FILE, HEADER_MARK = "cc_controller.h", "/* Written by cc-mujoco export: "
"""The header, and its first words."""
SOURCE_FILES = ("cc_controller.c", "cc_parameters.c")
"""Files that are compiled into a user's program."""
EXPORT_FILES = (
    HEADER_FILE, *SOURCE_FILES, "cc_native.h", "cc_example.c", "CMakeLists.txt",
    "README.md", atomic_io.MANIFEST,
)  # fmt: skip
"""Files that a folder holds; the manifest is the last."""


def readme(plan: ExportPlan, what: str, notes: Sequence[str]) -> str:
    """Return the text of the folder's README; arguments as of `write`."""
    listed = "\n".join(f"- {note}" for note in notes)
    return f"""# {what}

`cc_controller_step` every {plan.period:g} s gives the torque of every motor. See
`cc_controller.h` for readings and parameters, and `cc_example.c` for a program.

- memory: {8 * plan.memory_size} bytes
{listed}

```sh
cmake -S . -B build && cmake --build build
```
"""


def header(plan: ExportPlan, what: str, notes: Sequence[str] = ()) -> str:
    places = []  # two of the last torque in the memory, -1 where none is kept
    for start, axis in zip(plan.starts, plan.axes, strict=False):
        first, second = [*(start + k for k in axis.tables.given), -1, -1][:2]
        places.append(f"{{{first}, {second}}}")
    readings = "\n".join(
        f"    double {name}; /* {meaning} */"
        for axis in plan.axes
        for name, meaning in zip(axis.seen, _meanings(axis), strict=True)
    )
    indices = ""
    for field in plan.fields:
        unit = "-" if field.unit == "1" else field.unit
        meaning = f"{field.meaning} [{unit}]".replace("*/", "* /")
        least = "above 0" if 0.0 < field.low < 1e-300 else f"{field.low:g}"
        indices += f"    CC_{field.name.upper()}, /* {meaning}, {least} to "
        indices += f"{field.high:g} */\n"
    named = [f"CC_AXIS_{n.upper()} = {k}, " for k, n in enumerate(plan.names) if n]
    return fill(
        "cc_controller.h",
        mark=HEADER_MARK,
        what=what,
        comments="".join(f"/* {note}. */\n" for note in notes),
        memory=plan.memory_size,
        parameters=len(plan.fields),
        axes="".join(named),
        axis_count=len(plan.axes),
        readings=readings,
        indices=indices,
        limit=f"{guard.MAX_READING:g}",
        ride=f"{1e3 * guard.RIDE_TIME:g}",
        given=", ".join(places),
        most=f"{guard.MAX_READING:.1f}",
        least=f"{-guard.MAX_READING:.1f}",
        observer=_observer_functions(plan),
    )


def _meanings(axis: AxisPlan) -> Iterator[str]:
    known = {
        "motor_angle_rad": "angle of the motor; of a round pulley only its changes "
        "matter",
        "joint_angle_rad": "angle of the joint, from its encoder; likewise",
        "motor_velocity_rad_s": "its velocity",
        "joint_velocity_rad_s": "velocity of the joint, from its encoder",
        "winding_angle_rad": "angle at which a pulley of the arm in the neutral pose "
        "would wind the cables; likewise",
        "winding_velocity_rad_s": "velocity at which a pulley of the neutral arm would "
        "wind the cables",
        "leverage_ratio": "arm of the cables at the joint over that of the neutral "
        "pose",
        "joint_torque_nm": "measured torque of the cables on the joint",
        "desired_torque_nm": "torque that the cables shall put into the joint",
    }
    if axis.law.is_policy:
        known |= {
            "motor_angle_rad": "angle of the motor, 0 where it is in the scene",
            "joint_angle_rad": "angle of the joint, 0 where it is in the scene",
            "phase_sine": "sine of the phase of the gait",
            "phase_cosine": "its cosine",
            "reference_angle_rad": "angle that the task commands",
        }
    for name in axis.columns:
        yield known[name]
    for _, cable, node in axis.tension_readings:
        yield f"tension of {cable} at node {node}, from its sensor [N]"
    for name in axis.other_columns:
        yield known.get(name, "torque at that joint per torque of this motor")


def _observer_functions(plan: ExportPlan) -> str:
    cables = [cable for axis in plan.axes for cable in axis.cables]
    if not cables:
        return ""
    first: list[int] = []
    joints: list[int] = []
    nodes: list[int] = []
    for start, axis in zip(plan.starts, plan.axes, strict=False):
        joints.append(start + law_steps.JOINT_ANGLE if axis.cables else -1)
        if not axis.cables:
            continue
        segments = axis.tables.shape[1 : 1 + len(axis.cables)]
        nodes += (1 + each for each in segments)
        state = start + axis.tables.states + STATE_HEADER
        width = state_size(max(segments))
        first += (state + k * width for k in range(len(axis.cables)))
    names = ", ".join(f"CC_CABLE_{name.upper()} = {k}" for k, name in enumerate(cables))
    numbers = {"nodes": nodes, "first": first, "joints": joints}
    listed = {key: ", ".join(map(str, own)) for key, own in numbers.items()}
    return fill("observer.h", names=names, count=len(cables), **listed)


def parameters(plan: ExportPlan) -> str:
    rows = ""
    for field in plan.fields:
        value = repr(float(field.value)).replace("inf", "INFINITY")
        unit = "-" if field.unit == "1" else field.unit
        rows += f"    [CC_{field.name.upper()}] = {value}, /* {unit} */\n"
    return fill("cc_parameters.c", rows=rows)


def example(plan: ExportPlan) -> str:
    """Return a C program that reads measurements and writes torques."""
    seen = plan.seen
    torques = [f"{n}_motor_torque_nm" if n else "motor_torque_nm" for n in plan.names]
    return fill(
        "cc_example.c",
        names=",".join(seen),
        size=max(512, 40 * len(seen)),
        torques=",".join(torques),
        numbers=",".join("%lf" for _ in seen),
        arguments=", ".join(f"&r.{name}" for name in seen),
        count=len(seen),
    )


def controller_source(plan: ExportPlan, what: str) -> str:
    """Return the C99 source of the controller, without included files.

    The functions of the header call those of each axis in turn. Memory, parameters and
    readings are stored axis after axis, and the numbers of `own_readings` after the
    memory of the last axis.
    """
    library = CLibrary({}, native_library.PACKAGE.parent)

    def called(function: Callable[..., Any], *arguments: str, depth: int = 8) -> str:
        plain = python_function(function)
        assert plain is not None
        listed = (",\n" + " " * depth).join(arguments)
        return f"{library.require(plain).name}(\n{' ' * depth}{listed});"

    tables = [
        _table("double", "least", [field.low for field in plan.fields]),
        _table("double", "most", [field.high for field in plan.fields]),
        _table("int64_t", "guarded", plan.guarded),
    ]
    if plan.torques.changes:
        tables.append(_table("int64_t", "shape", plan.torques.shape))
        tables.append(_table("double", "tables", plan.torques.tables))
    for k, axis in enumerate(plan.axes):
        tables.append(_table("int64_t", f"shape{k}", axis.tables.shape))
        tables.append(_table("double", f"tables{k}", axis.tables.numbers))
    ends = itertools.pairwise(plan.starts)
    memories = [_view("Reals", f"memory + {a}", b - a) for a, b in ends]
    # The parameters of all axes are looked at before those of one are taken.
    checks, stores, steps, first, read = [], [], [], 0, 0
    for k, (axis, memory) in enumerate(zip(plan.axes, memories, strict=True)):
        count, names = len(axis.fields), ("given", "least", "most")
        shape = _view("Ints", f"shape{k}", len(axis.tables.shape))
        own = [_view("Reals", f"{name} + {first}", count) for name in names]
        gains = str(len(axis.law.gains))
        wrong = called(law_steps.wrong_parameters, shape, *own, gains)
        checks.append(f"""    wrong = {wrong}
    if (wrong != 0) {{
        return (int)(wrong + {first});
    }}""")
        store = called(axis.law.store_parameters, memory, shape, own[0])
        stores.append(f"    {store}")
        numbers = _view("Reals", f"tables{k}", len(axis.tables.numbers))
        own_seen = _view("Reals", f"seen + {read}", len(axis.seen))
        data = f"(LawData){{{memory}, {shape}, {numbers}, {own_seen}}}"
        steps.append(f"    torques[{k}] = {called(axis.law.step, data)}")
        first, read = first + count, read + len(axis.seen)
    # An impossible reading of any axis is refused before a state changes.
    count, start = len(plan.seen), plan.starts[-1]
    given, guarded = _view("Reals", "seen", count), _view("Ints", "guarded", count)
    wrong, changed = called(law_steps.impossible, given, str(count), guarded), ""
    if plan.torques.changes:
        own = [
            _view("Reals", f"memory + {start}", plan.memory_size - start),
            _view("Ints", "shape", len(plan.torques.shape)),
            _view("Reals", "tables", len(plan.torques.tables)),
            given,
        ]
        changed = f"""    if (wrong == 0) {{
        {called(own_readings, *own, depth=12)}
        memcpy(seen, memory + {start}, sizeof seen);
        /* It may be over an arm of 0. */
        wrong = {wrong}
    }}
"""
    flags = [begin + law_steps.FIRST_STEP for begin in plan.starts[:-1]]
    lines = {
        "tables": tables,
        "checks": checks,
        "stores": stores,
        "restarts": [f"    controller->number[{k}] = 1.0;" for k in flags],
        "nothing": [f"        torques[{k}] = 0.0;" for k in range(len(plan.axes))],
        "steps": steps,
    }
    texts = {name: "\n".join(own) for name, own in lines.items()} | {"own": changed}
    functions = library.text()
    return fill("cc_controller.c", what=what, functions=functions, wrong=wrong, **texts)


def _view(kind: str, place: str, count: int) -> str:
    element = {"Reals": "double", "Ints": "int64_t"}[kind]
    place = place.removesuffix(" + 0")
    if " " in place:
        place = f"({place})"
    return f"({kind}){{({element} *){place}, {count}}}"


def _table(kind: str, name: str, numbers: Sequence[float]) -> str:
    """Return C text of a constant array, bit for bit; one zero if it is empty."""
    is_whole = kind == "int64_t"
    cells = [str(n) if is_whole else literal(float(n)).text for n in numbers] or ["0"]
    rows = [", ".join(cells[i : i + 8]) for i in range(0, len(cells), 8)]
    return f"static const {kind} {name}[] = {{\n    " + ",\n    ".join(rows) + "\n};"


def require_ours(folder: str | os.PathLike[str]) -> None:
    """Raise a `CableError`, before long work, if a folder must not be written to."""
    names = (*ROS2_FILES, *EXPORT_FILES)
    try:
        text = Path(folder, HEADER_FILE).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):  # there is no earlier one
        text = ""
    atomic_io.require_ours(folder, lambda _: text.startswith(HEADER_MARK))
    atomic_io.require_unmodified(folder, names[:-1])


def write(
    folder: str | os.PathLike[str],
    plan: ExportPlan,
    what: str,
    notes: Sequence[str] = (),
    *,
    ros2_control: bool = False,
) -> None:
    """Write a controller as C99, with all that a C compiler needs.

    An earlier export in the folder is replaced unless a user changed it. The header
    contains `what`, a text on controller and scene, and the notes. If `ros2_control`, a
    package of ROS 2 is written around the controller.

    Raises:
        CableError: It cannot be written there.
    """
    require_ours(folder)
    texts = {
        HEADER_FILE: header(plan, what, notes),
        "cc_controller.c": controller_source(plan, what),
        "cc_native.h": (native_library.PACKAGE / "native/native.h").read_text(),
        "cc_parameters.c": parameters(plan),
        "cc_example.c": example(plan),
        "CMakeLists.txt": fill("CMakeLists.txt"),
        "README.md": readme(plan, what, notes),
    }
    if ros2_control:
        texts |= ros2_texts(plan)
        texts["CMakeLists.txt"] += fill("CMakeLists_ros2.txt")
    with atomic_io.replacing_folder(folder) as partial:
        for name, text in texts.items():
            (partial / name).write_text(text, encoding="utf-8", newline="\n")
        write_manifest(partial, [path.name for path in partial.iterdir()])
