"""`cc-mujoco cite`: how the results in a folder were made, and how to cite them."""

import hashlib
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from cc_mujoco._utils.atomic_io import MANIFEST, METADATA_KEY
from cc_mujoco._utils.parsing import one_sentence, parse_json
from cc_mujoco._utils.provenance import RECORD
from cc_mujoco.errors import CableError

RECORDS = ("verdict.json", "results.parquet", "table.parquet", "log.parquet")
"""Files with a record of how they were made: of `diagnose`, `benchmark`, `whatif` and
`play`.
"""
BIBTEX = """\
@software{{cc_mujoco,
  author = {{{{The cc_mujoco maintainers}}}},
  title = {{{{cc_mujoco: cable-conduit transmissions for MuJoCo}}}},
  version = {{{version}}},
  year = {{2026}},
}}
@misc{{borowski,
  author = {{Borowski, Andrew}},
  title = {{{{Model-based control of remote actuation based on cable-conduit \
transmissions}}}},
  howpublished = {{Thesis, University of Delaware}},
}}
@inproceedings{{todorov2012,
  author = {{Todorov, Emanuel and Erez, Tom and Tassa, Yuval}},
  title = {{{{MuJoCo: A physics engine for model-based control}}}},
  booktitle = {{IEEE/RSJ International Conference on Intelligent Robots and Systems}},
  pages = {{5026--5033}},
  year = {{2012}},
}}"""


@dataclass(frozen=True)
class Cite:
    """Show how results were made (versions, seeds, command, hashes), and BibTeX."""

    folder: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="DIR")]
    """Folder that play, whatif, benchmark or diagnose wrote."""

    def run(self) -> None:
        folder = Path(self.folder)
        if not folder.is_dir():
            raise CableError(f"{folder} is no folder; name one with results.")
        if not any((folder / name).is_file() for name in RECORDS):
            raise CableError(
                f"{folder} has none of {', '.join(RECORDS)}, the records of play, "
                "whatif, benchmark and diagnose."
            )
        made, hashes = _manifest(folder / MANIFEST)
        for name in filter(lambda name: (folder / name).is_file(), RECORDS):
            with one_sentence(folder / name, "make the results again"):
                made = {**made, **_record(folder / name)}
            hashes.setdefault(name, "")
        versions = made["versions"]
        lines = [*_lines(made, versions)]
        for name, written in hashes.items():
            lines.append(f"result    {name}  {_compared(folder / name, written)}")
        for line in lines:  # of a file that may be of others
            print("".join(c if c.isprintable() else "?" for c in line))
        print("\n" + BIBTEX.format(version=versions.get("cc_mujoco", "unknown")))


def _manifest(path: Path) -> tuple[dict[str, Any], dict[str, str]]:
    """Return what a manifest states of the run, and the hashes of files as written."""
    if not path.is_file():
        return {}, {}
    with one_sentence(path, "delete it, or make the results again"):
        lines = path.read_text(encoding="utf-8").splitlines()
        records = [line for line in lines if line.startswith(RECORD)]
        made = [parse_json(line.removeprefix(RECORD)) for line in records]
        files = (re.fullmatch(r"([^/\\]+) as written: (\w+)", line) for line in lines)
        hashes = {found[1]: found[2] for found in files if found}
        return dict(made[0]) if made else {}, hashes


def _record(path: Path) -> dict[str, Any]:
    """Return command, versions, seeds and inputs as far as a file of `RECORDS` does."""
    import pyarrow.parquet as pq

    if path.suffix == ".json":
        found = dict(parse_json(path.read_text(encoding="utf-8"))["provenance"])
        inputs = {found["scene"]["path"]: found["scene"]["sha256"], **found["data"]}
        versions = dict(found["versions"])
        return {
            "command": found["command"],
            "python": versions.pop("python"),
            "versions": versions,
            "seeds": [found["seed"]],
            "inputs": inputs,
        }
    about = dict(parse_json(pq.read_schema(path).metadata[METADATA_KEY]))
    about = dict(about.get("made_by", about))  # of a benchmark
    seeds = [about["seed"]] if "seed" in about else []
    if path.name == "results.parquet":
        column = pq.read_table(path, columns=["seed"])["seed"]
        seeds = sorted(column.unique().to_pylist())
    elif (study := path.with_name("study.json")).is_file():
        seeds = [parse_json(study.read_text(encoding="utf-8"))["protocol"]["seed"]]
    sources = {"sources of cc_mujoco": about["sources"]} if "sources" in about else {}
    if "model_xml" in about:
        scene = str(about["model_xml"]).encode()
        sources["model as MJCF"] = hashlib.sha256(scene).hexdigest()
    inputs = {**sources, **dict(about.get("files", {}))}
    return {"versions": dict(about["versions"]), "seeds": seeds, "inputs": inputs}


def _lines(made: Mapping[str, Any], versions: Mapping[str, Any]) -> Iterator[str]:
    listed = ", ".join(f"{name} {number}" for name, number in versions.items())
    yield f"command   {made.get('command', 'not recorded')}"
    yield f"versions  {listed}, Python {made.get('python', 'not recorded')}"
    yield f"seeds     {', '.join(map(str, made['seeds'])) or 'not recorded'}"
    for name, digest in made["inputs"].items():
        yield f"input     {name}  {digest}"


def _compared(path: Path, written: str) -> str:
    """Return the SHA-256 of a result, and whether it is as it was written."""
    if not path.is_file():
        return "deleted since"
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return digest + (", changed since" if written and written != digest else "")
