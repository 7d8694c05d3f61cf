"""How much of an iteration is shown: all of it, or its first stages only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pfviz.particles import FloatArray, IntArray, ParticleSet
from pfviz.record import Stage, StageKind, StepRecord


@dataclass(frozen=True, slots=True)
class Seen:
    """A step as far as it has been walked through.

    Attributes:
        record: the step.
        last: the index of the last stage that is shown; None when all are, and the posterior with them.
    """

    record: StepRecord
    last: int | None

    @property
    def stages(self) -> tuple[Stage, ...]:
        return self.record.stages if self.last is None else self.record.stages[: self.last + 1]

    @property
    def whole(self) -> bool:
        """Whether the step is over and the posterior is shown."""
        return self.last is None

    def stage(self, *kinds: StageKind) -> Stage | None:
        """The last of the stages shown that is of one of these kinds."""
        return next((stage for stage in reversed(self.stages) if stage.kind in kinds), None)

    def before_strengths(self) -> FloatArray:
        """``(M,)`` from 0 to 1: of the particles before the step; after resampling, by how often each was chosen."""
        previous = self.record.previous
        stage = self.stages[-1]
        if stage.kind == "resample" and stage.histories is not None and not self.whole:
            counts = np.bincount(stage.histories, minlength=len(previous)).astype(float)
            return counts / counts.max()
        return relative(previous.weights)

    def after(self) -> tuple[ParticleSet, IntArray, FloatArray] | None:
        """The new particles, their histories and their strengths from 0 to 1; None before there are any.

        They are shown as they were weighed, before any resampling that follows; equally strong before the weighing.
        """
        stage = self.stage("weight") or self.stage("complete", "predict")
        if stage is None or stage.histories is None:
            return None
        weighed = stage.kind == "weight"
        strengths = relative(stage.particles.weights) if weighed else np.full(len(stage.particles), 0.6)
        return stage.particles, stage.histories, strengths


def relative(weights: FloatArray) -> FloatArray:
    """Weights as strengths: the largest is 1."""
    return weights / weights.max()
