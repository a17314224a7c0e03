"""Folder of a study: finished batches while it runs, and its table at the end.

`study.json` describes the study. `parts` has a complete file for every finished batch,
so that an interrupted study can continue. `table.parquet` is the table of all, and
replaces the parts. Tables and parts carry the provenance of their code (`identity`):
results of other code are not mixed with this study's.
"""

import contextlib
import hashlib
import json
import math
from collections.abc import Container, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from cc_mujoco._utils import atomic_io, provenance
from cc_mujoco._utils.atomic_io import replacing
from cc_mujoco._utils.parsing import parse_json
from cc_mujoco._utils.user_code import named_in_file
from cc_mujoco.design import _protocol as protocols
from cc_mujoco.design import _scenarios as scenarios
from cc_mujoco.design._evaluation import DesignResult
from cc_mujoco.design._plan import VALUES_KEY, Plan
from cc_mujoco.design._protocol import EpisodeProtocol
from cc_mujoco.device._variables import describe
from cc_mujoco.errors import CableError
from cc_mujoco.human import TASKS, TRAJECTORIES

STUDY_FILE, PARTS_FOLDER, TABLE_FILE = "study.json", "parts", "table.parquet"
_DESIGN_COLUMN = "design_json"  # column of a part: the variables of its designs
_KEY_NAMES = {
    VALUES_KEY: "designs",
    "batches": "designs",
    "digest": "designs",
    "turned": "objectives",
    "own": "metrics of the user",
}
"""Words in messages for keys of a study's description that users do not know."""
FAILED_COLUMN = "failed"  # why a design failed; `failed@NAME` is of a controller
CONTROLLER_COLUMN = "controller"  # of the metrics, if several were tried


class Store:
    """Finished designs of a study, kept in a folder or, without one, in memory."""

    def __init__(self, plan: Plan, folder: Path | None, again: bool = False) -> None:
        """Open the folder, or make it, and find the finished batches.

        With `again` all are simulated anew; an existing table stays until the new one
        replaces it. A folder with another study, or with results of other code, is
        refused.
        """
        self.plan, self._folder = plan, folder  # the study; that of a search grows
        self._code_provenance = plan.made_by()
        self._done: dict[int, tuple[int, bytes]] = {}
        self._tables: dict[int, pa.Table] = {}  # without a folder
        self.whole: pa.Table | None = None  # the table of an earlier run that finished
        self.finished = 0  # designs of a search that an earlier run finished
        if folder is None:
            return
        require_ours(folder)
        about = plan.describe()
        parts = _parts(folder)
        if parts or (folder / TABLE_FILE).exists():
            _require_same(folder, about)
        else:
            folder.mkdir(parents=True, exist_ok=True)
            with replacing(folder / STUDY_FILE) as partial:
                partial.write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
        if again:
            _remove_parts(folder)
            return
        changed: list[str] = []
        for path in parts:
            # A part that cannot be read is done again.
            with contextlib.suppress(pa.ArrowException, OSError):
                part = pq.read_table(path)
                if other := self._differences(part):
                    changed = other
                else:
                    written = part.column(_DESIGN_COLUMN).to_pylist()
                    self._done[int(path.stem)] = _design_digest(written)
        if (folder / TABLE_FILE).exists() and (plan.search or not self._done):
            table = read_table(folder)
            other = self._differences(table)
            # Parts of this code next to a table of other code: a rerun was requested.
            if not self._done:
                changed = changed or other
            if plan.search is None:
                self.whole = table
            elif not other:
                self.finished = len(table)
        if changed:
            raise CableError(
                f"{folder} holds results of other code or files: it differs in "
                f"{', '.join(changed)}; --again replaces them, another --out keeps "
                "them."
            )

    def _differences(self, table: pa.Table) -> list[str]:
        return provenance.provenance_differences(
            provenance.read_provenance(table), self._code_provenance
        )

    @property
    def kept(self) -> int:
        if self.whole is not None:
            return len(self.whole)
        return sum(count for count, _ in self._done.values())

    def missing(self) -> list[int]:
        if self.whole is not None:
            return []
        # A search that goes on beyond an incomplete generation has other batches.
        digests = map(_design_digest, map(self._written, range(len(self.plan.batches))))
        return [n for n, digest in enumerate(digests) if self._done.get(n) != digest]

    def _written(self, batch: int) -> list[str]:
        designs = self.plan.designs
        return [json.dumps(designs[i]) for i in self.plan.batches[batch]]

    def keep(self, batch: int, results: Sequence[DesignResult]) -> None:
        written = self._written(batch)
        columns = _columns(results, self.plan.protocol)
        columns[_DESIGN_COLUMN] = pa.array(written, pa.string())
        self._done[batch] = _design_digest(written)
        if self._folder is None:
            self._tables[batch] = pa.table(columns)
            return
        place = _part(self._folder, batch)
        place.parent.mkdir(exist_ok=True)
        table = provenance.with_provenance(pa.table(columns), self._code_provenance)
        with replacing(place) as partial:
            pq.write_table(table, partial)

    def _kept(self, batch: int) -> pa.Table:
        """Return the results of a batch from its file, or from memory."""
        if self._folder is None:
            return self._tables[batch]
        part = _part(self._folder, batch)
        try:
            return pq.read_table(part)
        except FileNotFoundError:
            raise CableError(
                f"{part} is gone: another run writes to {self._folder} as well, or "
                "somebody deleted it; wait for that one, and run this one again."
            ) from None

    def table(self) -> pa.Table:
        """Return the table of all designs in order; none may be missing."""
        if self.whole is None:
            self.whole = provenance.with_provenance(self._join(), self._code_provenance)
            if self._folder is not None:
                with replacing(self._folder / TABLE_FILE) as partial:
                    pq.write_table(self.whole, partial, compression="zstd")
                if self.plan.search is None:  # a search may be gone on with
                    _remove_parts(self._folder)
        return self.whole

    def results(self, first: int = 0) -> list[DesignResult]:
        """Return the results of all designs from `first` on; none may be missing."""
        names = protocols.number_columns(self.plan.protocol)
        rows: dict[int, DesignResult] = {}
        for number, members in enumerate(self.plan.batches):
            if max(members) < first:
                continue
            for index, row in zip(members, self._kept(number).to_pylist(), strict=True):
                found = {n: math.nan if row[n] is None else row[n] for n in names}
                rows[index] = DesignResult(found, row[FAILED_COLUMN] or "")
        return [rows[i] for i in range(first, len(self.plan.designs)) if i in rows]

    def _join(self) -> pa.Table:
        plan, batches = self.plan, self.plan.batches
        kept = map(self._kept, range(len(batches)))
        whole = pa.concat_tables([part.replace_schema_metadata(None) for part in kept])
        order = np.argsort([index for members in batches for index in members])
        found = whole.take(pa.array(order))
        found = found.drop_columns([_DESIGN_COLUMN])
        columns: dict[str, Any] = {"design": pa.array(range(len(found)))}
        for name in plan.ranges:
            columns[name] = pa.array([design[name] for design in plan.designs])
        columns |= {name: found.column(name) for name in found.column_names}
        fields = [_field(name, a.type, plan.protocol) for name, a in columns.items()]
        return pa.Table.from_arrays(list(columns.values()), schema=pa.schema(fields))


def _design_digest(written: Sequence[str]) -> tuple[int, bytes]:
    digest = hashlib.sha256("\n".join(written).encode())
    return len(written), digest.digest()


def require_ours(folder: Path) -> None:
    """Refuse a folder in which a study cannot be kept; call before long work."""
    atomic_io.require_ours(folder, _has_study)


def _has_study(folder: Path) -> bool:
    try:
        found = parse_json((folder / STUDY_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(found, dict) and found.keys() >= {"protocol", "variables"}


def _part(folder: Path, batch: int) -> Path:
    return folder / PARTS_FOLDER / f"{batch:06d}.parquet"


def _parts(folder: Path) -> list[Path]:
    return sorted((folder / PARTS_FOLDER).glob("[0-9]*.parquet"))


def _remove_parts(folder: Path) -> None:
    for part in _parts(folder):
        part.unlink(missing_ok=True)
    with contextlib.suppress(OSError):  # it holds something else, or is not there
        (folder / PARTS_FOLDER).rmdir()


def read_study(folder: Path) -> dict[str, Any]:
    try:
        found = dict(parse_json((folder / STUDY_FILE).read_text(encoding="utf-8")))
        _ = found["variables"], found["protocol"]["duration"]
    except (OSError, ValueError, TypeError, KeyError):
        raise CableError(
            f"{folder} holds no study; give the folder of `cc-mujoco whatif --out`."
        ) from None
    return found


def read_protocol(folder: Path) -> dict[str, Any]:
    """Return the protocol of the study in a folder, to simulate designs again."""
    protocol: dict[str, Any] = read_study(folder)["protocol"]
    free: dict[str, Container[str]]
    free = {"trajectory": TRAJECTORIES, "task": TASKS, "controllers": (), "own": ()}
    for key, names in free.items():
        given = protocol.get(key, ())
        texts = given.values() if isinstance(given, dict) else given
        for text in [given] if isinstance(given, str) else texts:
            named_in_file(str(text), folder / STUDY_FILE, key, free=names)
    return protocol


def read_table(folder: Path) -> pa.Table:
    path = folder / TABLE_FILE
    if not path.exists():
        raise CableError(f"the study in {folder} is not finished; run it again.")
    try:
        return pq.read_table(path)
    except (pa.ArrowException, OSError) as error:
        reason = str(error).split(". ")[0].rstrip(".")
        raise CableError(
            f"{path} cannot be read: {reason}; delete it and run the study again."
        ) from None


def _require_same(folder: Path, about: Mapping[str, Any]) -> None:
    there = read_study(folder)
    # Earlier code stored no values; the digest behind them is of all designs.
    keys = [key for key in about if key in there or key != VALUES_KEY]
    if other := next((key for key in keys if there.get(key) != about[key]), None):
        differing = _describe_difference(other, there.get(other), about[other])
        raise CableError(
            f"{folder} holds a study that differs in {differing}; choose another "
            "folder, or delete that one."
        )


def _describe_difference(key: str, found: object, value: object) -> str:
    if isinstance(value, dict) and isinstance(found, dict):
        inside = [k for k in {**found, **value} if found.get(k) != value.get(k)]
        if key == VALUES_KEY:
            return f"the values of {', '.join(inside)}"
        if inside[0] == "ranges":
            return _describe_difference(VALUES_KEY, found["ranges"], value["ranges"])
        key = inside[0]
    return f"its {_KEY_NAMES.get(key, key)}"


def _columns(
    results: Sequence[DesignResult], protocol: EpisodeProtocol
) -> dict[str, pa.Array]:
    """Return columns of metrics (null without a number), controllers and failures."""
    columns = {}
    for name in protocols.number_columns(protocol):
        values = [row.metrics[name] for row in results]
        columns[name] = pa.array(values, pa.float64(), from_pandas=True)
    texts: dict[str, list[str | None]] = {}
    if len(protocol.controllers) > 1:
        texts[CONTROLLER_COLUMN] = [row.controller or None for row in results]
    for place, name in enumerate(protocol.metrics if protocol.across.several else ()):
        worst = [row.worst[place] if row.worst else None for row in results]
        texts[f"{name}@{scenarios.WORST_CASE_SUFFIX}"] = worst
    texts[FAILED_COLUMN] = [row.failed or None for row in results]
    for column, law in failure_columns(protocol).items():
        texts[column] = [row.out.get(law) for row in results]
    return columns | {name: pa.array(t, pa.string()) for name, t in texts.items()}


def failure_columns(protocol: EpisodeProtocol) -> dict[str, str]:
    """Return the controller of each column `failed@CONTROLLER`; {} for one."""
    laws = protocol.controllers if len(protocol.controllers) > 1 else ()
    return {f"{FAILED_COLUMN}@{law}": law for law in laws}


def _field(column: str, kind: pa.DataType, protocol: EpisodeProtocol) -> pa.Field:
    name, _, law = column.partition("@")
    unit = "1"
    if name == "design":
        meaning = "number of the design"
    elif name == CONTROLLER_COLUMN:
        meaning = "controller that the metrics are of"
    elif name == FAILED_COLUMN:
        by = f" with controller {law}" if law else ""
        meaning = f"why the simulation failed{by}, if it did"
    elif law == scenarios.WORST_CASE_SUFFIX:
        meaning = "case in which it is worst, or the first in which it has no number: "
        meaning += protocols.metric_of(name).meaning
    else:
        metric = protocols.known_metric(name)
        thing = metric or describe(name)
        ends = {scenarios.LEAST_SUFFIX: "least", scenarios.MOST_SUFFIX: "greatest"}
        rank = scenarios.RANK_NAMES[protocol.across.rank]
        of = f"{ends.get(law, rank)} over the cases: "
        if law not in ends and (metric is None or not protocol.across.several):
            of = ""
        if metric is not None and protocol.axes and metric.of_axis and "." not in name:
            of += "worst axis: "
        by = f"with controller {law}: " if law in protocol.controllers else ""
        unit, meaning = thing.unit, of + by + thing.meaning
    return pa.field(column, kind, metadata={"unit": unit, "meaning": meaning})
