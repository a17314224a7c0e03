"""Metabolic energy of a person, estimated from the work of the joints.

Positive work over 0.25 and negative work over 1.2, efficiencies of muscles by R.
Margaria, "Positive and negative work performances and their efficiencies in human
locomotion", Int. Z. angew. Physiol. 25, 1968. Work that muscles of one joint do against
each other, and the cost of holding a force, are not in it.
"""

from __future__ import annotations

from typing import Any

POSITIVE_EFFICIENCY, NEGATIVE_EFFICIENCY = 0.25, 1.2
"""Work of muscles over the energy that they take [-]."""


def metabolic_energy(positive: Any, negative: Any) -> Any:
    """Return the energy that work takes [J], or power for power [W], elementwise.

    `negative` is at most 0.
    """
    return positive / POSITIVE_EFFICIENCY - negative / NEGATIVE_EFFICIENCY
