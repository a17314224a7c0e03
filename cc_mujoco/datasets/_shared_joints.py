"""Cables of other axes that pull at the joint of a recording: their torque, taken off.

A sensor at the joint shows all cables that pull there, and a diagnosis plays those of
one axis. What the others do follows from their measured tensions along the paths of
the scene.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from cc_mujoco.datasets import _channels as channels
from cc_mujoco.datasets._bench import Bench
from cc_mujoco.datasets._clock import SampledTrack
from cc_mujoco.datasets._coupled_route import PullingCable, pulling_torque
from cc_mujoco.datasets._data_findings import DataFinding, error, warning
from cc_mujoco.datasets._reading import Recording
from cc_mujoco.datasets._trials import Noise
from cc_mujoco.native import FloatArray
from cc_mujoco.report._html import list_words

_LEAD_ROWS = 100
"""Rows from the pose of the scene to the first sample."""


@dataclass
class OtherAxes:
    """Torques of other axes' cables at the joint of a bench, trial by trial.

    Attributes:
        bench: of the axis that is diagnosed.
        doubts: variances by trial of what friction leaves open in the torques that were
            taken off [N^2 m^2].
        scatter: the same of the noise of their tensions.
    """

    bench: Bench
    doubts: list[float] = field(default_factory=list)
    scatter: list[float] = field(default_factory=list)

    def take_off(self, recording: Recording, track: SampledTrack) -> list[DataFinding]:
        """Take the torque of other axes' cables off that of the joint, in place.

        Tensions of other axes' cables are then left out.
        """
        findings = []
        if channels.JOINT_TORQUE in track.values:
            for cable in self.bench.pulled_by:
                findings.append(self._take_off(cable, recording, track))
        ends = ("proximal", "distal")
        for name in self.bench.strangers:
            for end in ends:
                track.values.pop(f"tension_{name}_{end}_n", None)
        return findings

    def _take_off(
        self, cable: PullingCable, recording: Recording, track: SampledTrack
    ) -> DataFinding:
        bench, values = self.bench, track.values
        names = [f"tension_{cable.name}_{end}_n" for end in ("proximal", "distal")]
        there = [name for name in names if name in values]
        what = f"cable {cable.name} of another axis pulls at joint {bench.joint!r}, too"
        if not there:
            message = (
                f"{recording.path}: {what}, and its torque is part of "
                f"{recording.column(channels.JOINT_TORQUE)}; record its tension "
                f"({' and '.join(names)}), take it off the rig and out of the scene, "
                f"or declare [columns.{channels.JOINT_TORQUE}] measured = false."
            )
            return error(message, recording.name, channels.JOINT_TORQUE)
        lead = np.linspace(0.0, 1.0, _LEAD_ROWS + 1)[:-1]

        def led(name: str) -> FloatArray:
            signal = values[name]
            known = np.flatnonzero(np.isfinite(signal))
            filled = np.interp(np.arange(signal.size), known, signal[known])
            return np.concatenate([lead * filled[0], filled])

        proximal, distal = (
            np.concatenate([np.full(_LEAD_ROWS, values[name][0]), values[name]])
            if name in values
            else None
            for name in names
        )
        low, high = (
            bound[_LEAD_ROWS:]
            for bound in pulling_torque(
                bench.coupled,
                cable,
                led(channels.JOINT_ANGLE),
                {joint: led(channels.other_angle(joint)) for joint in cable.others},
                proximal,
                distal,
            )
        )
        taken, doubt = 0.5 * (low + high), 0.5 * (high - low)
        values[channels.JOINT_TORQUE] = values[channels.JOINT_TORQUE] - taken
        self.doubts.append(float(np.nanmean(doubt**2)))
        rough = np.nanmedian(np.abs(np.diff(taken, 3)))
        self.scatter.append(float(1.4826**2 * rough**2 / 20.0))
        size = float(np.sqrt(np.nanmean(taken**2)))
        message = (
            f"{recording.path}: {what}; its torque there by {list_words(there)}, "
            f"{size:.2g} N m RMS, is taken off column "
            f"{recording.labels.get(channels.JOINT_TORQUE, channels.JOINT_TORQUE)}"
        )
        unsure = float(np.sqrt(self.doubts[-1]))
        if unsure > 1e-6 * size:
            message += (
                f", known to {unsure:.2g} N m RMS by the friction of the scene, which "
                "counts as noise"
            )
        return warning(f"{message}.", recording.name, channels.JOINT_TORQUE)

    def noise(self, known: Noise, passed: float) -> Noise:
        """Return the noise of the joint's torque with what the others add to it.

        What friction leaves open is slow, and passes a low-pass whole; `passed` is the
        share of the variance of white noise that it leaves.
        """
        if not self.doubts:
            return known
        variance = known.deviation**2 + float(np.mean(self.doubts)) / passed
        if known.source == "declared":  # of the joint's sensor alone
            variance += float(np.mean(self.scatter))
        return known._replace(deviation=variance**0.5)
