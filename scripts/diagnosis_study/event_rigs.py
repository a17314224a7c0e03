"""Events in recordings of rigs: share found, error of time and size, false alarms.

    python scripts/diagnosis_study/event_rigs.py --rounds 2 --out runs/events

Every kind of event (`rig/events.py`) happens once in a rig of every make, alone and
beside a hidden effect. It is found if its trial is named and its time is within 0.2 s.
Rigs in which nothing happens, with and without the effect, count false alarms.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import tyro
from kept_cases import complete

from cc_mujoco.assets import scene_path
from cc_mujoco.datasets import Bench
from cc_mujoco.diagnosis import Diagnosis, infer
from cc_mujoco.report import table
from rig.events import KINDS, Happening, with_event
from rig.generate import facts_of, write_data
from rig.makes import MAKES
from rig.nominal import make_rig
from rig.strength import calibrate

KEYS = "make", "event", "hidden", "seed"
TRIALS = "rich_standard"
NAMES = {
    "cable_off": ("silent",), "cable_off_for_good": ("silent",),
    "slip": ("joint_angle_offset",), "slip_between": ("joint_angle_offset",),
    "zeroed": ("joint_angle_offset",), "zeroed_between": ("joint_angle_offset",),
    "dead": ("dead",), "frozen": ("",), "gain": ("gain",),
    "gain_between": ("gain",), "friction": ("friction",),
    "pretension": ("pretension",), "one_trial": ("pretension",),
    "drift": ("drift",), "saturated": ("",),
    "devices": ("device", "axial_stiffness", "friction", "pretension"),
}  # fmt: skip
"""Right kinds of `Event` by what happened; "" where the reader itself reports it."""
MOST = 0.2  # error of the time up to which an event is found [s]


def run(make: str, event: str, hidden: str, seed: int) -> dict[str, Any]:
    """Diagnose a rig with an event; return what was found of it."""
    rig = make_rig(seed, make=make)
    effects = {}
    if hidden != "none":
        effects[hidden] = calibrate(rig, hidden, 4.0, TRIALS, seed)
    data, happened = with_event(rig, effects, TRIALS, seed, event)
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder, "data")
        write_data(place, data, facts_of(TRIALS, seed))
        found = infer(Bench.of(scene_path("bench")), [place])[0].diagnosis
    case = {"make": make, "event": event, "hidden": hidden, "seed": seed}
    return case | judged(found, happened) | {
        "verdict": found.verdict,
        "named": [effect.id for effect in found.missing],
    }  # fmt: skip


def judged(found: Diagnosis, happened: Happening | None) -> dict[str, Any]:
    """Return whether the event was found and named, its time's error, and others."""
    kinds = [event.kind for event in found.events]
    if happened is None:
        return {"found": not kinds, "kinds": kinds, "late": 0.0, "sure": True}
    trial, late, sure = f"trial_{happened.trial:02d}", math.inf, True
    before = f"trial_{happened.trial - 1:02d}"
    for event in found.events:
        parts = math.isnan(event.time) and happened.time == 0.0
        # Either side of a division of the trials may be called the event.
        if parts and (trial in event.spans) != (before in event.spans):
            late = 0.0
            break
        if event.file.endswith(f"{trial}.csv") and not math.isnan(event.time):
            late = event.time - happened.time
            low, high = event.interval
            sure = low - MOST / 10 <= happened.time <= high + MOST / 10
            break
    if "" in NAMES[happened.kind] and not kinds:
        late = 0.0 if trial in found.question else math.inf
        kinds = [""]
    known = abs(late) <= MOST and kinds[0] in NAMES[happened.kind]
    return {"found": known, "kinds": kinds, "late": late, "sure": sure}


def summary(records: Sequence[Mapping[str, Any]]) -> str:
    """Return a table by kind of event, and what was not found."""
    rows = []
    for event in dict.fromkeys(record["event"] for record in records):
        own = [record for record in records if record["event"] == event]
        right = [
            r for r in own if r["named"] == [h for h in [r["hidden"]] if h != "none"]
        ]
        known = [abs(r["late"]) for r in own if r["found"]]
        worst = f"{max(known, default=math.nan):.3f}"
        counts = (str(len(each)) for each in (own, known, right))
        rows.append((event, *counts, worst))
    missed = [
        (*(str(r[key]) for key in KEYS), ", ".join(r["kinds"]), f"{r['late']:.3f}",
         f"{r['verdict']} {', '.join(r['named'])}")
        for r in records if not r["found"]
    ]  # fmt: skip
    heads = ("event", "rigs", "found", "rest named right", "worst time [s]")
    text = table(heads, rows)
    if missed:
        text += "\n\n" + table((*KEYS, "kinds", "late", "rest"), missed)
    return text


def main(
    makes: tuple[str, ...] = tuple(MAKES),
    events: tuple[str, ...] = ("none", *KINDS),
    hidden: tuple[str, ...] = ("none", "viscous_friction"),
    rounds: int = 1,
    first: int = 51000,
    jobs: int = 1,
    out: Path = Path("runs", "events"),
) -> None:
    """Diagnose the rigs that are not done; write and print the table.

    Args:
        makes: makes of rigs.
        events: kinds of events, "none" for nothing.
        hidden: effects hidden beside them, "none" for nothing.
        rounds: rigs of each make, event and effect.
        first: seed of the first rig.
        jobs: processes.
        out: folder of the records and the table.
    """
    kinds = [(m, e, h) for e in events for m in makes for h in hidden]
    cases = [(*kind, first + k) for k, kind in enumerate(kinds * rounds)]
    complete(out, KEYS, cases, run, summary, jobs)


if __name__ == "__main__":
    tyro.cli(main)
