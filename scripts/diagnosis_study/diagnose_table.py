"""Results of a study of `diagnose_benchmark.py`, as Markdown."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from lowest_bic import comparison

from cc_mujoco.report import table

STUDIES = {
    "development": 1000, "calibration": 2000, "final": 3000, "second": 4000,
    "third": 5000, "fourth": 6000, "fifth": 7000, "sixth": 8000, "seventh": 9000,
    "eighth": 10000, "ninth": 11000, "tenth": 12000,
    "eleventh": 13000, "twelfth": 14000, "thirteenth": 15000,
    "fourteenth": 16000, "fifteenth": 17000,
}  # fmt: skip
"""First seed of every study, in the order in which they were run."""
LAST = "fourteenth"
"""The last that was run whole, which the page of the diagnosis shows."""
SHOWN = 1.5
"""Error over the floor that effect-free rigs stay below: beyond it, something shows."""


def judged(
    kind: str,
    hidden: Sequence[str],
    verdict: str,
    named: Sequence[str] = (),
    ties: Sequence[Sequence[str]] = (),
) -> str:
    """Return one word for how a case went: right, tie, half, missed or wrong.

    `kind` of what is hidden is named, pair, unknown or none, `ties` are groups of ids.
    """
    tied = [set(tie) for tie in ties]
    if kind == "none":
        return "right" if verdict == "none" else "wrong"
    if kind == "unknown":
        return {"unknown": "right", "none": "missed"}.get(verdict, "wrong")
    sure = set(named).difference(*tied)
    if kind == "pair":
        if set(hidden) <= sure:
            return "right"
        either = sure.union(*(tie for tie in tied if len(tie) == 2))
        if set(hidden) <= either:
            return "tie"
        return "half" if set(hidden) & either else "wrong"
    if verdict == "unknown":
        return "missed"  # whatever it added: it reports that most of the error is left
    for tie in tied:
        if hidden[0] in tie:
            return "tie" if len(tie) == 2 else "missed"
    if named and named[0] == hidden[0]:
        return "right"
    return "missed" if not named else "wrong"


def went(record: dict[str, Any]) -> str:
    """Return the same of a record."""
    names = ("kind", "hidden", "verdict", "named", "ties")
    return judged(**{name: record[name] for name in names})


def is_right(record: dict[str, Any]) -> bool:
    """Return whether a verdict is right as a whole, as its odds mean it.

    Names are right if they are all that is hidden, a tie if one of its effects is.
    """
    hidden, verdict = set(record["hidden"]), record["verdict"]
    if verdict == "tie":
        return any(hidden & set(tie) for tie in record["ties"])
    if record["kind"] in ("named", "pair"):
        return verdict == "named" and hidden == set(record["named"])
    return bool(verdict == record["kind"])


def verdict_rates(records: list[dict[str, Any]]) -> list[list[str]]:
    """Return rows of a table: verdict, times it was given, share that is right.

    `RELIABILITY` of `_judge` is copied from it.
    """
    found = []
    for verdict in ("named", "none", "tie", "unknown"):
        right = [is_right(r) for r in records if r["verdict"] == verdict]
        if right:
            share = (
                f"{_share(sum(right), len(right))} ({exact(sum(right), len(right))})"
            )
            found.append([verdict, str(len(right)), share])
    return found


def summary(records: list[dict[str, Any]]) -> str:
    """Return Markdown of a study; what stands before the first fold is for the page.

    Rates by kind and figures come first; rates by make and strength and all cases are
    folded.
    """
    columns = {
        "right": "right", "in a tie": "tie", "one of two": "half",
        "missed": "missed", "wrong": "wrong",
    }  # fmt: skip
    kinds = [
        kind
        for kind in ("named", "pair", "unknown", "none")
        if any(r["kind"] == kind for r in records)
    ]
    whole, rates = [], []
    for kind in kinds:
        by_size: dict[tuple[str, str], list[str]] = {}
        for r in sorted(records, key=lambda r: (r["make"], r["strength"])):
            if r["kind"] == kind:
                size = "-" if kind == "none" else f"{r['strength']:g}"
                by_size.setdefault((r["make"], size), []).append(went(r))
        every = [word for words in by_size.values() for word in words]
        whole.append([kind, *_shares(every, columns.values())])
        for (make, size), words in by_size.items():
            rates.append([kind, make, size, *_shares(words, columns.values())])
    head: Sequence[str] = ("cases", *columns)
    parts = [table(("hidden", *head), whole), *_figures(records)]
    if any("bic" in r for r in records):
        parts.append(comparison(records, went))
    parts += [
        "<details><summary>By verdict, rigs and strength</summary>",
        table(("verdict", "given", "right"), verdict_rates(records)),
        table(("hidden", "rigs", "R", *head), rates),
        "</details>",
    ]
    cases = []
    for r in sorted(records, key=lambda record: record["seed"]):
        hidden = ", ".join(r["hidden"]) or "none"
        ties = "; ".join(", ".join(tie) for tie in r["ties"])
        cases.append(
            (
                hidden, r["make"], f"{r['strength']:g}", f"{r['reached']:.1f}",
                _number(r.get("misfit", math.nan), 1), r["verdict"],
                ", ".join(r["named"]) or "-", ties or "-",
                _number(r.get("closed", math.nan), 2),
            )
        )  # fmt: skip
    head = (
        "hidden", "rigs", "R", "reached", "error", "verdict", "named", "ties",
        "gap closed",
    )  # fmt: skip
    parts += [
        "<details><summary>Every case: what was hidden, what was said</summary>",
        table(head, cases),
        "</details>",
    ]
    return "\n\n".join(parts) + "\n"


def _shares(words: Sequence[str], wanted: Iterable[str]) -> list[str]:
    """Return the number of cases, and of each word, the first with its interval."""
    whole = len(words)
    found = [_share(words.count(word), whole) for word in wanted]
    right = f"{found[0]} ({exact(words.count('right'), whole)})"
    return [str(whole), right, *found[1:]]


def _share(count: int, whole: int) -> str:
    return f"{count / whole:.0%}" if whole else "-"


def exact(count: int, whole: int) -> str:
    """Return a 95 % interval [%] (C. Clopper, E. Pearson, Biometrika 26, 1934)."""
    from scipy.stats import binomtest

    low, high = binomtest(count, whole).proportion_ci(method="exact")
    return f"{100 * low:.0f} to {100 * high:.0f}"


def _number(value: float, digits: int) -> str:
    return "-" if math.isnan(value) else f"{value:.{digits}f}"


def _figures(records: list[dict[str, Any]]) -> list[str]:
    """Return sentences: the gap, what intervals cover, how long it took."""
    found = _strengths(records)
    right = [r for r in records if r["kind"] == "named" and went(r) == "right"]
    if right:
        closed: dict[float, list[float]] = {}
        for r in sorted(right, key=lambda record: record["strength"]):
            closed.setdefault(r["strength"], []).append(r["closed"])
        shares = [
            f"{np.nanmedian(each):.2f} at R = {size:g} ({len(each)})"
            for size, each in closed.items()
        ]
        found.append(f"Median gap closed: {', '.join(shares)}.")
    shown = [r for r in records if r["kind"] == "named" and r.get("misfit", 0) > SHOWN]
    if shown:
        words = [went(r) for r in shown]
        found.append(
            f"Single effects at which the tuned baseline is more than {SHOWN:g} times "
            f"the floor off: {len(shown)}, of which right "
            f"{words.count('right') / len(words):.0%}, right or in a tie "
            f"{(words.count('right') + words.count('tie')) / len(words):.0%}."
        )
    tied = [r for r in records if r.get("settled")]
    if tied:
        single = [r for r in tied if r["kind"] == "named"]
        found.append(
            f"Ties: {len(tied)}; with the proposed experiment done as well, what was "
            f"hidden was named and no longer tied in {sum(map(_well, tied))}; of the "
            f"{len(single)} of single effects in {sum(map(_well, single))}."
        )
    more = [len(set(r["named"]) - set(r["hidden"])) for r in right]
    if more:
        found.append(
            "Rightly named cases in which another effect was named as well: "
            f"{sum(count > 0 for count in more)} of {len(more)}."
        )
    for make in dict.fromkeys(r["make"] for r in records):
        given = [
            r["intervals"] for r in records if r["make"] == make and r.get("intervals")
        ]
        shares = []
        for name in given[0] if given else ():
            of = [each[name] for each in given]
            held = sum(low <= true <= high for _, low, high, true in of)
            shares.append(f"{name} {_share(held, len(of))} ({exact(held, len(of))})")
        if shares:
            found.append(
                f"Intervals of 95 % that cover, of {len(given)} rigs ({make}): "
                f"{', '.join(shares)}."
            )
    return found


def _well(record: dict[str, Any]) -> bool:
    """Return whether the proposed experiment settled a tie."""
    last = record["settled"]
    return last["verdict"] == "named" and set(record["hidden"]) <= set(last["named"])


def _strengths(records: list[dict[str, Any]]) -> list[str]:
    """Return sentences: what was right by strength, effect-free rigs, times."""
    found = []
    for kind, what in (("named", "single effects"), ("pair", "pairs")):
        some = [r for r in records if r["kind"] == kind]
        sizes = sorted({r["strength"] for r in some})
        rates = []
        for size in sizes:
            words = [went(r) for r in some if r["strength"] == size]
            right = words.count("right")
            rates.append(
                f"{right} of {len(words)} at R = {size:g} ({exact(right, len(words))}%)"
            )
        if rates:
            found.append(f"Right, of {what}: {', '.join(rates)}.")
    free = [r for r in records if r["kind"] == "none"]
    if free:
        errors = [r.get("misfit", math.nan) for r in free]
        coarse = sum(r["trials"] == "restful" for r in free)
        found.append(
            f"Effect-free rigs are {min(errors):.2f} to {max(errors):.2f} floors off; "
            f"{coarse} of {len(free)} have coarse encoders and long rests."
        )
    times: dict[str, list[float]] = {}
    for r in sorted(records, key=lambda record: record["strength"]):
        size = "none hidden" if r["kind"] == "none" else f"R = {r['strength']:g}"
        times.setdefault(size, []).append(r["seconds"])
    if times:
        by_size = [f"{np.median(each):.0f} s ({size})" for size, each in times.items()]
        longest = max(records, key=lambda record: record["seconds"])
        found.append(
            f"Median time of a diagnosis: {', '.join(by_size)}; longest "
            f"{longest['seconds']:.0f} s ({', '.join(longest['hidden']) or 'none'}, "
            f"R = {longest['strength']:g})."
        )
    return found
