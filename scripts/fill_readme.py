"""Put the claims of `cc-mujoco reproduce` into the README.

    cc-mujoco reproduce
    python scripts/fill_readme.py [--results runs/reproduce]

Runs what is not done yet, and replaces what stands between the two marks.
"""

from __future__ import annotations

import argparse
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from cc_mujoco.files import replacing
from cc_mujoco.reproduce import EXPERIMENTS, Claim, reproduce, table

README = Path(__file__).resolve().parents[1] / "README.md"
BEGIN, END = "<!-- claims: begin -->", "<!-- claims: end -->"


def block(claims: Mapping[str, Sequence[Claim]]) -> str:
    """Markdown of all claims by experiment, after a line that counts the verdicts."""
    count = Counter(claim.verdict for found in claims.values() for claim in found)
    order = ("agrees", "better", "in part", "disagrees", "misprint", "cannot")
    told = ", ".join(f"{count[verdict]} {verdict}" for verdict in order)
    parts = [f"{sum(count.values())} claims: {told}.", "<details><summary>All of them"]
    parts[-1] += ": as printed, ours, and why</summary>"
    for name, found in claims.items():
        parts.append(f"**{name}**: {EXPERIMENTS[name]}\n\n{table(found)}")
    parts.append("</details>")
    return "\n\n".join(parts)


def filled(readme: str, text: str) -> str:
    """The README with this text between the marks."""
    pattern = re.compile(f"(?<={re.escape(BEGIN)}\n).*?(?={re.escape(END)})", re.S)
    found, number = pattern.subn(lambda _: text + "\n", readme)
    if number != 1:
        raise SystemExit(f"{README.name} needs one `{BEGIN}` and one `{END}`")
    return found


def main() -> None:
    """Collect the claims and write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--results", type=Path, default=Path("runs", "reproduce"))
    options = parser.parse_args()
    records = reproduce([], options.results)
    text = block({record.name: record.claims for record in records})
    with replacing(README) as place:
        place.write_text(
            filled(README.read_text(encoding="utf-8"), text), encoding="utf-8"
        )


if __name__ == "__main__":
    main()
