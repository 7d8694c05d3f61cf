"""How much of an iteration is shown, and how its particles hang together from stage to stage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pfviz.figures.style import relative
from pfviz.genealogy import first_of_equals
from pfviz.particles import FloatArray, IntArray, ParticleSet
from pfviz.record import Stage, StageKind, StepRecord


@dataclass(frozen=True, slots=True)
class After:
    """The new particles as they are drawn.

    Attributes:
        particles: the set.
        histories: ``(N,)``, indices into ``record.previous``; -1 for none.
        strengths: ``(N,)``, from 0 to 1.
        weighed: ``(N,)``, which of the weighed particles each one is.
    """

    particles: ParticleSet
    histories: IntArray
    strengths: FloatArray
    weighed: IntArray


@dataclass(frozen=True, slots=True)
class Seen:
    """A step as far as it has been walked through.

    Filters differ in their order: most weigh particles that have been joined to a history, HS-SIR weighs innovations
    first and joins those that it has drawn. Here is what the drawings need to know of that.

    Attributes:
        record: the step.
        last: the index of the last stage that is shown; None when all are, and the posterior with them.
    """

    record: StepRecord
    last: int | None = None

    @property
    def stages(self) -> tuple[Stage, ...]:
        return self.record.stages if self.last is None else self.record.stages[: self.last + 1]

    @property
    def whole(self) -> bool:
        """Whether the step is over and the posterior is shown."""
        return self.last is None

    def stage(self, *kinds: StageKind) -> Stage | None:
        """The last of the stages shown that is of one of these kinds."""
        position = self._position(*kinds)
        return None if position is None else self.stages[position]

    def _position(self, *kinds: StageKind) -> int | None:
        found = [i for i, stage in enumerate(self.stages) if stage.kind in kinds]
        return found[-1] if found else None

    def before_strengths(self) -> FloatArray:
        """``(M,)`` from 0 to 1: of the particles before the step; after resampling, by how often each was chosen."""
        previous, stage = self.record.previous, self.stages[-1]
        histories = stage.histories if stage.kind == "resample" and self._joined is None else None
        if histories is not None and not self.whole:
            counts = np.bincount(histories, minlength=len(previous)).astype(float)
            return counts / counts.max()
        return relative(previous.weights)

    def proposed(self) -> tuple[ParticleSet, FloatArray] | None:
        """What was proposed, by detector or dynamics, with strengths; None before anything was."""
        stage = self.stage("propose") or self.stage("predict")
        if stage is None:
            return None
        weight = self.stage("weight")
        weighed_alone = weight is not None and weight.particles.order < self.record.previous.order
        weighed_alone = weighed_alone or (weight is not None and weight.histories is None)
        strengths = (
            relative(weight.particles.weights) if weight and weighed_alone else np.full(len(stage.particles), 0.9)
        )
        return stage.particles, strengths

    @property
    def _joined(self) -> int | None:
        """The position of the stage after which each particle has an innovation and a history."""
        found = self._position("associate")
        return self._position("predict") if found is None else found

    def joins(self) -> tuple[IntArray, IntArray, IntArray] | None:
        """The joins that were made: sources in ``record.previous``, targets among the proposed, and weighed particles.

        None before any were.
        """
        joined = self._joined
        if joined is None:
            return None
        stage = self.stages[joined]
        n = len(stage.particles)
        histories = np.full(n, -1) if stage.histories is None else stage.histories
        targets = self._traced(joined, "propose") if stage.kind == "associate" else np.arange(n)
        weighed_before = any(s.kind == "weight" and s.histories is None for s in self.stages[:joined])
        weighed = self._traced(joined, "weight") if weighed_before else np.arange(n)
        return histories, targets, weighed

    def of_innovations(self) -> tuple[IntArray, IntArray]:
        """What became of the proposed: indices of those that were weighed, and of the weighed particles they became."""
        weight, joins = self.stage("weight"), self.joins()
        if weight is not None and weight.histories is None:
            return np.arange(len(weight.particles)), np.arange(len(weight.particles))
        return (np.empty(0, np.int64), np.empty(0, np.int64)) if joins is None else joins[1:]

    def _traced(self, position: int, kind: StageKind) -> IntArray:
        """``(N,)``: which particle of the last stage of ``kind`` each particle at ``position`` goes back to."""
        indices = np.arange(len(self.stages[position].particles))
        while self.stages[position].kind != kind and position > 0:
            ancestors = self.stages[position].ancestors
            if ancestors is None:
                break
            indices = ancestors[indices]
            position -= 1
        return indices

    def after(self) -> After | None:
        """The new particles; None before there are any.

        They are shown as they were weighed, before any resampling that follows; equally strong before the weighing.
        """
        made = self._position("complete", "predict")
        joins = self.joins()
        if made is None or joins is None:
            return None
        later = [stage for stage in self.stages[made:] if stage.kind in ("complete", "predict", "search", "weight")]
        stage = later[-1]
        weighed = stage.kind == "weight"
        strengths = relative(stage.particles.weights) if weighed else np.full(len(stage.particles), 0.6)
        histories = np.full(len(stage.particles), -1) if stage.histories is None else stage.histories
        return After(stage.particles, histories, strengths, joins[2])


def likeliest_histories(record: StepRecord, innovation: int, count: int) -> tuple[IntArray, FloatArray]:
    """The histories in ``record.previous`` that could best have produced an associated innovation, with probabilities.

    Particles of equal state, the copies that resampling has made, count together, under the index of the first. Empty
    where nothing was associated.
    """
    association = record.association
    if association is None or innovation >= len(association.innovations):
        return np.empty(0, np.int64), np.empty(0)
    totals = np.zeros(len(record.previous))
    np.add.at(totals, first_of_equals(record.previous)[record.origins], association.row(innovation))
    best = np.argsort(-totals, kind="stable")[:count]
    return best, totals[best]
