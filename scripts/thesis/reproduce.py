"""Run the experiments of the thesis again; keep what is done.

    python scripts/thesis/reproduce.py [--out runs/reproduce] [--again] [NAME ...]

Each experiment has a folder with its figures, data and `result.json`, which appears
whole when it is done. A second run passes over experiments whose folder was written by
the same code.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from tqdm import tqdm

from cc_mujoco._utils.atomic_io import replacing, replacing_folder, require_ours
from cc_mujoco._utils.parsing import parse_json
from cc_mujoco._utils.provenance import (
    code_provenance,
    earlier_results_message,
    file_digests,
    provenance_differences,
)
from cc_mujoco.errors import CableError
from cc_mujoco.report import _markdown as markdown
from cc_mujoco.report._figures import save, style

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from thesis._outcome import (
    Claim,
    Finding,
    Outcome,
    Progress,
    claims_of,
    drawn,
    write_data,
)

FOLDER = Path(__file__).resolve().parent

EXPERIMENTS: dict[str, str] = {
    "solver": "Fig. 2.4: time of a solution against the number of segments",
    "rules": "2.1-2.2: the rules as printed, where they depend on the mesh or fail",
    "pretension": "Experiment 1a: locked output, four pretensions",
    "loops": "Experiment 1b: locked output, one to three loops",
    "magnitudes": "Table 2.2 against Experiment 1, and what would reconcile them",
    "tunnel": "Experiment 2: virtual tunnel, residual against velocity",
    "follower": "Experiment 3: position-position follower, ideal and real",
    "parameters": "2.4.2: stiffness and friction from tests, with intervals",
    "kalman": "3.1: why a Kalman filter has nothing to work with",
    "sensors": "3.2.1: redundant tension sensors, direction of motion known",
    "directions": "3.2.2: redundant tension sensors, direction of motion unknown",
    "noise": "3.2.2: noise of every sensor from data, and weights",
    "online": "3.2.3: friction, bend and stiffness estimated while running",
    "tracking": "Simulation 1: one cable, output moving, six schemes of control",
    "spring": "Simulation 2: two cables render a spring, with and without a model",
    "predecessors": "Chapter 1: the models that came before, and what each can show",
}
"""Names that `reproduce` takes, in the order of the thesis, with what they are.

The module `thesis._experiments.NAME` has `run(progress) -> Outcome`.
"""
TOGETHER = {
    "pretension": "blocked", "loops": "blocked", "magnitudes": "blocked",
    "tracking": "simulations", "spring": "simulations",
}  # fmt: skip
"""Modules that have several experiments, each a function of its name."""

RESULT_FILE = "result.json"
SUMMARY_FILE = "summary.md"


class FinishedExperiment(NamedTuple):
    name: str
    claims: tuple[Claim, ...]
    fresh: bool  # whether it was run just now


def reproduce(
    names: Iterable[str],
    out: str | os.PathLike[str],
    *,
    again: bool = False,
    progress: Callable[[str, float], None] = lambda name, share: None,
    finished: Callable[[FinishedExperiment], None] = lambda record: None,
    say: Callable[[str], None] = lambda sentence: None,
) -> list[FinishedExperiment]:
    """Run experiments and write figures, data and the summary table.

    Without names all of `EXPERIMENTS` are run. Each has its own folder in `out`;
    `summary.md` covers all that exist. `progress` is called with an experiment and its
    fraction done, `finished` with every new record, and `say` with a sentence on
    results of an earlier run, if there are any. Returns one record per name, in the
    order of `EXPERIMENTS`.
    """
    wanted = set(names) or set(EXPERIMENTS)
    for name in sorted(wanted):
        if name not in EXPERIMENTS:
            raise CableError.unknown("experiment", name, EXPERIMENTS)
    require_ours(out, lambda place: any(_is_ours(place / name) for name in EXPERIMENTS))
    out = Path(out)
    for name in wanted:
        require_ours(out / name, _is_ours)
    out.mkdir(parents=True, exist_ok=True)
    names = [name for name in EXPERIMENTS if name in wanted]
    found = {n: one for n in names if (one := _read(out / n)) is not None}
    changed = {
        n: provenance_differences(one[0], _provenance()) for n, one in found.items()
    }
    kept = [n for n in found if not (again or changed[n])]
    if kept or any(changed.values()):
        other = [text for texts in changed.values() for text in texts]
        say(earlier_results_message(len(kept), len(names), "experiments", other))
    records = []
    for name in names:
        progress(name, 0.0)
        claims = found[name][1] if name in kept else None
        if fresh := claims is None:
            outcome = run(name, partial(progress, name))
            _write(out / name, outcome)
            claims = claims_of(name, outcome.findings)
        progress(name, 1.0)
        _summarize(out)
        records.append(FinishedExperiment(name, claims, fresh))
        finished(records[-1])
    return records


def function_of(name: str) -> Callable[[Progress], Outcome]:
    module = importlib.import_module(f"thesis._experiments.{TOGETHER.get(name, name)}")
    found: Callable[[Progress], Outcome]
    found = getattr(module, name if name in TOGETHER else "run")
    return found


def run(name: str, progress: Progress = lambda share: None) -> Outcome:
    return function_of(name)(progress)


def table(claims: Iterable[Claim]) -> str:
    return markdown.table(
        ("where", "printed", "ours", "verdict", "why"),
        [(c.where, c.printed, c.ours, c.verdict, c.why) for c in claims],
    )


def _write(folder: Path, outcome: Outcome) -> None:
    with replacing_folder(folder) as place, style():
        for stem, panels in outcome.figures.items():
            save(place / f"{stem}.png", drawn(panels))
            write_data(place / f"{stem}.csv", panels)
        claims = [finding._asdict() for finding in outcome.findings]
        text = json.dumps({"made_by": _provenance(), "claims": claims}, indent=1)
        (place / RESULT_FILE).write_text(text, encoding="utf-8")


def _provenance() -> dict[str, Any]:
    own = file_digests(sorted(FOLDER.rglob("*.py")), FOLDER.parent)
    return code_provenance(files=own)


def _is_ours(folder: Path) -> bool:
    """Return whether some version of this package wrote the folder of an experiment."""
    try:
        found = parse_json((folder / RESULT_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(found, dict) and "claims" in found


def _read(folder: Path) -> tuple[object, tuple[Claim, ...]] | None:
    try:
        found = parse_json((folder / RESULT_FILE).read_text(encoding="utf-8"))
        findings = [Finding(**claim) for claim in found["claims"]]
        return found["made_by"], claims_of(folder.name, findings)
    except (OSError, ValueError, TypeError, KeyError):
        return None


def _summarize(out: Path) -> None:
    parts = ["# The thesis, reproduced"]
    for name in EXPERIMENTS:
        found = _read(out / name)
        if found is not None:
            heading = f"## {name}\n\n{EXPERIMENTS[name]}."
            other = ", ".join(provenance_differences(found[0], _provenance()))
            stale = f"\n\nMade by other code, which differs in {other}." * bool(other)
            parts.append(f"{heading}{stale}\n\n{table(found[1])}")
    with replacing(out / SUMMARY_FILE) as place:
        place.write_text("\n\n".join(parts) + "\n", encoding="utf-8")


def main(words: Sequence[str] | None = None) -> int:
    listed = "\n".join(f"  {name:12} {what}" for name, what in EXPERIMENTS.items())
    parser = argparse.ArgumentParser(
        description="Run the experiments of the thesis again.",
        epilog=f"experiments:\n{listed}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="all unless given")
    parser.add_argument("--out", type=Path, default=Path("runs", "reproduce"))
    parser.add_argument("--again", action="store_true", help="run also what is done")
    options = parser.parse_args(words)
    shares: dict[str, float] = {}
    with tqdm(
        total=float(len(set(options.names)) or len(EXPERIMENTS)),
        bar_format="{desc:12} {bar}| {percentage:3.0f} %  {elapsed}",
        disable=not sys.stderr.isatty(),
    ) as bar:

        def advance(name: str, share: float) -> None:
            shares[name] = share
            bar.set_description_str(name, refresh=False)
            bar.update(sum(shares.values()) - bar.n)

        try:
            reproduce(
                options.names, options.out, again=options.again, progress=advance,
                finished=_show, say=tqdm.write,
            )  # fmt: skip
        except CableError as error:
            print(f"reproduce: {error}", file=sys.stderr)
            return 2
        except KeyboardInterrupt:
            print(
                "reproduce: interrupted, experiments that were finished are kept.",
                file=sys.stderr,
            )
            return 130
    print(f"\nsummary:  {options.out / SUMMARY_FILE}")
    return 0


def _show(record: FinishedExperiment) -> None:
    tqdm.write(f"{record.name}{'' if record.fresh else '  (done before)'}")
    for claim in record.claims:
        tqdm.write(f"  {claim.verdict:9}  {claim.where}: {claim.ours}")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
