r"""Put tables of the package, claims and both benchmarks beside or into their pages.

    python scripts/diagnosis_study/diagnose_benchmark.py ...   # see `validation.md`
    python scripts/benchmarks/check_structure.py ...   # see there
    python scripts/fill_readme.py [tables] [claims] [benchmark] [structure] [diagnosis]

Writes the tables of materials and effects as CSV files, runs the claims and what is not
done yet of the benchmark, and replaces what stands between the marks of each block, on
its page and, in short, on the front page; claims and the benchmark's scores by
condition also go into CSV files. The benchmark is what `cc-mujoco benchmark` plays with
`ENTRIES`; the structure is what `check_structure.py` has left in v2-conditions.csv.
"""

from __future__ import annotations

import argparse
import csv
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from tqdm import tqdm

from cc_mujoco import benchmark
from cc_mujoco._utils.atomic_io import replacing
from cc_mujoco._utils.command_options import progress_options
from cc_mujoco.device import MATERIALS
from cc_mujoco.device._materials import Figure
from cc_mujoco.diagnosis import EFFECTS
from cc_mujoco.report import table
from thesis._outcome import CLAIM_FILE, claims_of
from thesis.reproduce import EXPERIMENTS, run

ROOT = Path(__file__).resolve().parents[1]
FRONT = ROOT / "README.md"
PAGES = {
    "claims": ROOT / "scripts" / "thesis" / "README.md",
    "benchmark": ROOT / "cc_mujoco" / "benchmark" / "README.md",
    "structure": FRONT,
    "diagnosis": ROOT / "cc_mujoco" / "diagnosis" / "validation.md",
}
"""Page of every block."""
TABLES = {
    name: ROOT / "cc_mujoco" / folder / f"{name}.csv"
    for name, folder in {
        "materials": "design",
        "effects": "diagnosis",
    }.items()
}
"""File of every table of the package, which a page links to."""
STRUCTURE = PAGES["benchmark"].with_name("v2-conditions.csv")
"""Scores of the controllers in every condition of suite `v2`."""
OURS = "predictive", "adaptive"
"""Controllers with the model of the cables; all others are baselines."""
ENTRIES = (
    "pi", "stiction", "pi_tuned", "pi_feed_forward", "inverse", "lqg", "predictive",
    "adaptive",
)  # fmt: skip
"""Controllers in the table of the benchmark, beside `none` and the references."""
SHORT = {"claims": 1, "diagnosis": 1}
"""Paragraphs of a block that the front page shows, if any."""


def block(rows: Sequence[Mapping[str, str]]) -> str:
    """Return a sentence with the number of claims of each verdict."""
    order = ("agrees", "better", "in part", "disagrees", "misprint", "cannot")
    whole = Counter(row["verdict"] for row in rows)
    counts = ", ".join(f"{whole[verdict]} {verdict}" for verdict in order)
    return f"{whole.total()} claims: {counts}."


def tables(results: benchmark.Results) -> str:
    """Return a benchmark's overview, without intervals, and references, as Markdown."""
    references = benchmark.reference_definitions(benchmark.REFERENCES)
    whole = [
        benchmark.OVERVIEW_HEADING,
        table(*benchmark.overview_table(results)),
        "\n".join(references),
    ]
    left_out = r" \([\d.]+ to [\d.]+\)| with its 95 % interval"
    return re.sub(left_out, "", "\n\n".join(whole))


def plain(table: tuple[Sequence[str], Sequence[Sequence[str]]]) -> list[list[str]]:
    head, rows = table
    return [[re.sub(r"[`*]", "", entry) for entry in row] for row in (head, *rows)]


def material_rows() -> list[list[str]]:
    """Return pairs of materials as rows of text, the first of column names."""
    head = ["material", "rope and conduit", "friction", "modulus [GPa]"]
    head += ["density [kg/m^3]", "strength [GPa]", "hottest [degC]"]
    rows = [
        [
            one.name,
            one.meaning,
            interval_text(one.friction),
            interval_text(one.modulus, 1e-9),
            interval_text(one.density),
            interval_text(one.strength, 1e-9),
            "-" if one.hottest is None else interval_text(one.hottest),
        ]
        for one in MATERIALS.values()
    ]
    return [head, *rows]


def interval_text(figure: Figure, scale: float = 1.0) -> str:
    """`typical (low to high; sources)`, without a range where there is none."""
    values = (figure.low, figure.typical, figure.high)
    low, typical, high = (f"{float(f'{scale * value:.3g}'):g}" for value in values)
    span = "" if low == high else f"{low} to {high}; "
    return f"{typical} ({span}{', '.join(figure.sources)})"


def effect_rows() -> list[list[str]]:
    """Return effects as rows of text, the first of column names; a star: rare."""
    named = [(e.id + ("*" if e.rare else ""), e) for e in EFFECTS.values()]
    rows = [[name, e.equation, e.required_excitation] for name, e in named]
    return [["effect", "term", "required excitation"], *rows]


def package_tables() -> dict[str, list[list[str]]]:
    return {
        "materials": material_rows(),
        "effects": effect_rows(),
    }


def structure(path: Path) -> str:
    """Return the Markdown of suite `v2`: its table, and where a baseline is best."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    errors: dict[tuple[str, str], dict[str, float]] = {}
    for row in rows:
        of_condition = errors.setdefault((row["scene"], row["condition"]), {})
        of_condition[row["controller"]] = float(row["rms_torque_error"])
    scenes = list(dict.fromkeys(scene for scene, _ in errors))

    def cell(law: str, scene: str) -> str:
        ratios = [
            of[law] / min(of.values()) for at, of in errors.items() if at[0] == scene
        ]
        own = [r for r in rows if (r["scene"], r["controller"]) == (scene, law)]
        chatter, peak = (
            float(np.median([float(row[name]) for row in own]))
            for name in ("chatter", "peak_motor_torque")
        )
        spread = f"{np.median(ratios):.2f}/{max(ratios):.2f}"
        return f"{spread}, {1e3 * chatter:.0f}, {peak:.2g}"

    def worse(scene: str) -> str:
        own = {name: of for (at, name), of in errors.items() if at == scene}
        lost = []
        for name, of in own.items():
            best = min(of, key=of.__getitem__)
            if best not in OURS:
                ratio = min(of[law] for law in OURS) / of[best]
                lost.append(f"`{name.removeprefix('structure-')}` {ratio:.2f}")
        listed = f" ({', '.join(lost)})" if lost else ""
        return f"{scene} {len(lost)} of {len(own)}{listed}"

    laws = dict.fromkeys(row["controller"] for row in rows)
    lines = [[f"`{law}`", *(cell(law, scene) for scene in scenes)] for law in laws]
    return (
        f"{table(['controller', *scenes], lines)}\n\n"
        f"A baseline beats {' and '.join(f'`{law}`' for law in OURS)} by this factor: "
        f"{'; '.join(map(worse, scenes))}."
    )


def write_results(results: benchmark.Results) -> None:
    """Write scores by condition, and ranks, as CSV beside the page."""
    names = [score.name for score in benchmark.SCORES]
    conditions = [["scene", "condition", "controller", *names]]
    for cell, played in results:
        scores = (played.scores[name] for name in names)
        known = (one[np.isfinite(one)] for one in scores)
        means = [f"{np.mean(one):.4g}" if one.size else "" for one in known]
        at = cell.condition
        conditions.append([at.label, at.name, cell.controller, *means])
    ranks = [["scene", "rank", "controller", "error", "less_pi", "better_than"]]
    for scene, errors in benchmark.rms_errors(results).items():
        _, *ranked = plain(benchmark.ranks_table(errors, benchmark.DEFAULT_BASELINE))
        ranks += [[scene, *row] for row in ranked]
    for stem, lines in (("v1-conditions", conditions), ("v1-ranks", ranks)):
        write_csv(PAGES["benchmark"].with_name(f"{stem}.csv"), lines)


def write_csv(path: Path, rows: Sequence[Sequence[str]]) -> None:
    with replacing(path) as place, place.open("w", newline="", encoding="utf-8") as to:
        csv.writer(to, lineterminator="\n").writerows(rows)


def played(folder: Path, seeds: int | None) -> benchmark.Results:
    """Play the unfinished cells of the suite, and return all results."""
    plan = benchmark.BenchmarkPlan(ENTRIES, seeds=seeds)
    with tqdm(total=len(plan.cells()), unit="cell", **progress_options()) as bar:
        return benchmark.run(
            plan, folder, workers=0, progress=lambda done: bar.update(done - bar.n)
        )


def studies(folder: Path) -> str:
    """Return the Markdown of a study, without folded parts."""
    path = folder / "table.md"
    if not path.is_file():
        raise SystemExit(f"{path} is missing; diagnose_benchmark.py writes it")
    return path.read_text(encoding="utf-8").partition("<details>")[0].strip()


def between(page: str, name: str) -> str:
    return _marked(name).findall(page)[0].rstrip("\n")


def filled(page: str, name: str, text: str) -> str:
    """Return a page's text with `text` between the marks of the block `name`."""
    found, number = _marked(name).subn(lambda _: text + "\n", page)
    if number != 1:
        raise SystemExit(f"the page of {name} needs its two marks, once")
    return found


def write(name: str, text: str) -> None:
    """Put a block on its page and, if it has a place there, on the front page."""
    places = [(PAGES[name], text)]
    if name in SHORT:
        places.append((FRONT, "\n\n".join(text.split("\n\n")[: SHORT[name]])))
    for path, part in places:
        page = filled(path.read_text(encoding="utf-8"), name, part)
        with replacing(path) as place:
            place.write_text(page, encoding="utf-8")


def _marked(name: str) -> re.Pattern[str]:
    begin, end = (f"<!-- {name}: {word} -->" for word in ("begin", "end"))
    return re.compile(f"(?<={re.escape(begin)}\n).*?(?={re.escape(end)})", re.S)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "blocks", nargs="*", help=f"of tables, {', '.join(PAGES)}; all if none"
    )
    parser.add_argument("--benchmark", type=Path, default=Path("runs", "benchmark"))
    parser.add_argument("--seeds", type=int, default=None)
    parser.add_argument("--sealed", type=Path, default=Path("runs", "sealed"))
    options = parser.parse_args()
    options.blocks = options.blocks or ["tables", *PAGES]
    if unknown := set(options.blocks) - {"tables", *PAGES}:
        parser.error(f"no block is called {', '.join(sorted(unknown))}")
    if "tables" in options.blocks:
        for name, rows in package_tables().items():
            write_csv(TABLES[name], rows)
    if "claims" in options.blocks:
        claims = [row for name in EXPERIMENTS for row in claims_of(name, run(name))]
        write("claims", block(claims))
        write_csv(CLAIM_FILE, [list(claims[0]), *(list(c.values()) for c in claims)])
    if "benchmark" in options.blocks:
        results = played(options.benchmark, options.seeds)
        write("benchmark", tables(results))
        write_results(results)
    if "structure" in options.blocks:
        write("structure", structure(STRUCTURE))
    if "diagnosis" in options.blocks:
        write("diagnosis", studies(options.sealed))


if __name__ == "__main__":
    main()
