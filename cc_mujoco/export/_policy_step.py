"""Compiled step of a policy for C, and the numbers that it needs."""

from __future__ import annotations

import numpy as np

from cc_mujoco.control import Policy
from cc_mujoco.control import _guard as guard
from cc_mujoco.control import _policy as policy
from cc_mujoco.control._controller import LawTables, SteppedLaw
from cc_mujoco.control._law_steps import (
    OWN_MEMORY,
    LawData,
    begun,
    part,
    rows_of,
    tables_of,
    whole_part,
)
from cc_mujoco.control._network import WIDTHS, PackedNetwork, shares_of
from cc_mujoco.device import _observation as observation
from cc_mujoco.device._sensors import WINDING_COLUMNS
from cc_mujoco.native import internal

_COLUMNS, _HOLD, _HISTORY, _PLAYS, _IS_WOUND, _NETWORK = range(6)
"""Places of `LawTables.shape` of a policy; the shape of the network is last."""
_BEGUN, _SAMPLE, _SHARE, _POLICY_SIZE = range(guard.MEMORY_SIZE, guard.MEMORY_SIZE + 4)
"""Places in the memory behind the guard: 1 once the policy has begun; samples since the
last action; that action. Then what is measured, plays, past frames, scratch."""


@internal
def step_policy(data: LawData) -> float:
    memory, shape, tables, readings = data
    columns, history, plays = shape[_COLUMNS], shape[_HISTORY], shape[_PLAYS]
    gains, spring, law, _ = begun(data, policy.GAINS, _POLICY_SIZE, 0)
    first = OWN_MEMORY + policy.GAINS + _POLICY_SIZE
    place = policy.GAINS - guard.LIMITS + guard.SPRING_SIZE  # of the numbers of `Past`
    measured = part(memory, first, columns)
    measured[:] = readings[:columns]
    wound = len(WINDING_COLUMNS) if shape[_IS_WOUND] != 0 else 0
    guarded = guard.Guarded(gains, spring, law)
    policy.admit_measured(guarded, measured, part(readings, columns, wound))
    past = observation.Past(
        tables[place],
        part(tables, place + 1, columns),
        part(tables, place + 1 + columns, plays),
        rows_of(memory, first, 1, columns),
        rows_of(memory, first + columns, 1, plays),
        tables_of(memory, first + columns + plays, 1, history, columns + 1),
    )
    if law[guard.STARTED] != 0.0:
        if law[_BEGUN] == 0.0:
            observation.begin_past(past, 0)
            law[_BEGUN], law[_SAMPLE] = 1.0, 0.0
        else:
            observation.follow_past(past, 0)
        if law[_SAMPLE] == 0.0:
            scratch = first + columns + plays + history * (columns + 1)
            place, widest = place + 1 + columns + plays, 0
            net = PackedNetwork(
                whole_part(shape, _NETWORK, shape.size - _NETWORK),
                part(tables, place, tables.size - place),
            )
            for i in range(WIDTHS, net.sizes.size):
                widest = max(widest, net.sizes[i])
            work = rows_of(memory, scratch, 2, widest)
            observation.write_observation(past, rows_of(memory, scratch, 1, widest), 0)
            law[_SHARE] = np.float32(work[shares_of(net, work), 0])
            observation.act_past(past, 0, law[_SHARE])
        law[_SAMPLE] += 1.0
        if law[_SAMPLE] >= shape[_HOLD]:
            law[_SAMPLE] = 0.0
    torque = law[_SHARE] * gains[policy.WHOLE]
    return guard.passed(guarded, gains[policy.RELEASE], torque)


class SteppedPolicy(Policy):
    """A policy of one axis as a controller with a compiled step."""

    @property
    def stepped(self) -> SteppedLaw:
        (axis,), (observed,) = self.axes, self.observed
        return SteppedLaw(
            step_policy,
            fixed=frozenset({"ratio", "period", "one_way", "inertia"}),
            seen=(*observed.columns, *(WINDING_COLUMNS if axis.is_wound else ())),
            unguarded=frozenset(axis.unguarded),
            is_round=False,
            is_policy=True,
        )

    def parameters(self) -> list[float]:
        return [float(limit) for limit in self.limits]

    def law_tables(self) -> LawTables:
        (axis,), (own,), net = self.axes, self.observed, self.network.packed
        past = observation.ObservationHistory(own, 1).past
        observed = [past.ratio], past.units, past.reach
        numbers = axis.gains[guard.LIMITS :], axis.spring, *observed, net.numbers
        counts = own.frame, own.hold, own.history, past.reach.size, int(axis.is_wound)
        first = OWN_MEMORY + policy.GAINS
        size = past.measured.size + past.plays.size + past.frames.size
        size += first + _POLICY_SIZE + 2 * int(net.sizes[WIDTHS:].max())
        shape, given = (*counts, *net.sizes.tolist()), (first + guard.COMMAND,)
        return LawTables(shape, tuple(np.concatenate(numbers).tolist()), size, given)
