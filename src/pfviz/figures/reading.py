"""What the figures read from a record: what was proposed, how it was joined, and what came of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pfviz.figures.style import relative
from pfviz.particles import FloatArray, IntArray, ParticleSet
from pfviz.record import Association, Stage, StageKind, StepRecord

_MADE: tuple[StageKind, ...] = ("complete", "predict", "search", "weight")


@dataclass(frozen=True, slots=True)
class Outcome:
    """The new particles as they were weighed, before any resampling that follows.

    Attributes:
        particles: the set.
        strengths: ``(N,)``, their weights relative to the largest.
        histories: ``(N,)``, indices into ``record.previous``; -1 for none.
        proposed: ``(N,)``, indices into what was proposed.
    """

    particles: ParticleSet
    strengths: FloatArray
    histories: IntArray
    proposed: IntArray


@dataclass(frozen=True, slots=True)
class Pairs:
    """Arrows from the particles before the step to what was proposed in it.

    Attributes:
        sources: ``(n,)``, indices into ``record.previous``.
        targets: ``(n,)``, indices into what was proposed.
        strengths: ``(n,)``, from 0 to 1.
    """

    sources: IntArray
    targets: IntArray
    strengths: FloatArray


def proposal_stage(record: StepRecord) -> Stage:
    """Where innovations were drawn: from pi(u | y), or else from the dynamics."""
    return record.stages[_drawn(record)]


def _drawn(record: StepRecord) -> int:
    """The position of the stage in which innovations were drawn; the last, where a filter of one's own names none."""
    for kind in ("propose", "predict"):
        for position, stage in enumerate(record.stages):
            if stage.kind == kind:
                return position
    return len(record.stages) - 1


def outcome(record: StepRecord) -> Outcome:
    """The new particles, each with its history and the innovation that it came from."""
    made = [i for i, stage in enumerate(record.stages) if stage.kind in _MADE and stage.histories is not None]
    position = made[-1] if made else len(record.stages) - 1
    stage = record.stages[position]
    histories = np.full(len(stage.particles), -1) if stage.histories is None else stage.histories
    return Outcome(stage.particles, relative(stage.particles.weights), histories, _traced(record, position))


def _traced(record: StepRecord, position: int) -> IntArray:
    """``(N,)``: which proposed innovation each particle of the stage at ``position`` goes back to."""
    drawn = _drawn(record)
    indices = np.arange(len(record.stages[position].particles))
    for stage in reversed(record.stages[drawn + 1 : position + 1]):
        if stage.ancestors is not None:
            indices = stage.ancestors[indices]
    return indices


def innovation_strengths(record: StepRecord) -> FloatArray:
    """``(N,)``: of what was proposed; by weight where innovations were weighed before they were joined (HS-SIR)."""
    stage = proposal_stage(record)
    weighed = record.stage("weight")
    if weighed is not None and weighed.histories is None:
        return relative(weighed.particles.weights)
    return np.ones(len(stage.particles))


def made_pairs(record: StepRecord) -> Pairs:
    """The joins that were made. Their strength is p(u | x) relative to its peak: how well the history explains u."""
    new = outcome(record)
    joined = np.flatnonzero(new.histories >= 0)
    association = record.association
    if association is None or not association.arbitrary:
        strengths = np.ones(len(joined))
    else:
        strengths = association.plausibility()[joined]
    return Pairs(new.histories[joined], new.proposed[joined], strengths)


def possible_pairs(record: StepRecord, at_least: float = 0.01, most: int = 60) -> Pairs | None:
    """The joins that could have been made, strength their probability; None where there was no choice.

    Args:
        record: the step.
        at_least: pairs of a smaller probability are left out.
        most: of how many innovations (histories, where these chose) the pairs are looked at.
    """
    association = record.association
    if association is None or association.arbitrary:
        return None
    sources = record.origins
    choosers = np.arange(len(association.innovations))[:most]
    found: list[tuple[int, int, float]] = []
    targets = _targets(record, association)
    for index in choosers:
        if association.pool is not None:
            row = association.pool_row(int(index))
            found += [(int(sources[index]), int(j), float(row[j])) for j in np.flatnonzero(row >= at_least)]
        else:
            row = np.bincount(sources, association.row(int(index)), minlength=len(record.previous))
            found += [(int(j), int(targets[index]), float(row[j])) for j in np.flatnonzero(row >= at_least)]
    a, b, p = (np.array(column) for column in zip(*found, strict=True)) if found else (np.empty(0),) * 3
    return Pairs(a.astype(np.int64), b.astype(np.int64), p.astype(np.float64))


def _targets(record: StepRecord, association: Association) -> IntArray:
    """``(N,)``: which proposed innovation each associated one is."""
    position = next(i for i, stage in enumerate(record.stages) if stage.association is association)
    return _traced(record, position)
