"""Cases of a study kept in a file, so that finished ones are not repeated."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from tqdm import tqdm

from cc_mujoco._utils.atomic_io import replacing
from cc_mujoco._utils.command_options import progress_options

Record = dict[str, Any]


def complete(
    out: Path,
    keys: tuple[str, ...],
    cases: Iterable[tuple[Any, ...]],
    make: Callable[..., Record],
    table: Callable[[list[Record]], str],
    jobs: int = 1,
) -> None:
    """Make the cases that a folder lacks, in so many processes; print the table.

    A case that fails is reported; the others are made before it is raised.

    `keys` are the fields of a record that identify its case, in the order of `cases`.
    """
    out.mkdir(parents=True, exist_ok=True)
    kept = out / "cases.jsonl"
    text = kept.read_text(encoding="utf-8") if kept.exists() else ""
    records: list[Record] = [json.loads(line) for line in text.splitlines()]
    done = {tuple(record[key] for key in keys) for record in records}
    missing = [tuple(case) for case in cases if tuple(case) not in done]
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        futures = {pool.submit(make, *case): case for case in missing}
        failed: list[tuple[tuple[Any, ...], BaseException]] = []
        for one in tqdm(
            as_completed(futures), total=len(missing), **progress_options()
        ):
            if error := one.exception():
                tqdm.write(f"{futures[one]}: {error!r}", sys.stderr)
                failed.append((futures[one], error))
                continue
            records.append(one.result())
            with kept.open("a", encoding="utf-8") as file:
                file.write(json.dumps(records[-1]) + "\n")
            with replacing(out / "table.md") as partial:
                partial.write_text(table(records), encoding="utf-8")
    print(table(records))
    for case, error in failed[:1]:
        raise RuntimeError(f"{len(failed)} cases failed, first {case}") from error
