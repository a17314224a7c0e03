"""Run the experiments of the thesis again, and print a verdict for every claim.

python scripts/thesis/reproduce.py [NAME ...]
"""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from thesis._outcome import Finding, claims_of

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
"""Names of experiments, in the order of the thesis, with what they are.

The module `thesis._experiments.NAME` has `run() -> tuple[Finding, ...]`.
"""
TOGETHER = {
    "pretension": "blocked", "loops": "blocked", "magnitudes": "blocked",
    "tracking": "simulations", "spring": "simulations",
}  # fmt: skip
"""Modules that have several experiments, each a function of its name."""


def run(name: str) -> tuple[Finding, ...]:
    """Run an experiment; return a finding for each of its rows in `claims.csv`."""
    module = importlib.import_module(f"thesis._experiments.{TOGETHER.get(name, name)}")
    findings: tuple[Finding, ...]
    findings = getattr(module, name if name in TOGETHER else "run")()
    return findings


def main(words: Sequence[str] | None = None) -> None:
    listed = "\n".join(f"  {name:12} {what}" for name, what in EXPERIMENTS.items())
    parser = argparse.ArgumentParser(
        description="Run the experiments of the thesis again.",
        epilog=f"experiments:\n{listed}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="all unless given")
    wanted = parser.parse_args(words).names or list(EXPERIMENTS)
    if unknown := sorted(set(wanted) - set(EXPERIMENTS)):
        parser.error(f"no experiment is called {', '.join(unknown)}")
    for name in (name for name in EXPERIMENTS if name in wanted):
        print(name)
        for row in claims_of(name, run(name)):
            print(f"  {row['verdict']:9}  {row['where']}: {row['ours']}", flush=True)


if __name__ == "__main__":
    main()
