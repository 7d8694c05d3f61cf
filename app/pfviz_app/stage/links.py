"""Which arrows to draw between the particles before a step and the innovations of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pfviz.particles import FloatArray, IntArray
from pfviz.record import Association, StepRecord


@dataclass(frozen=True, slots=True)
class Links:
    """Arrows from the particles before the step to what was proposed in it.

    Attributes:
        sources: ``(n,)``, indices into ``record.previous``.
        targets: ``(n,)``, indices into the proposed innovations.
        strengths: ``(n,)``, from 0 to 1.
    """

    sources: IntArray
    targets: IntArray
    strengths: FloatArray


_NONE = Links(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0))


def sample_evenly(total: int, count: int) -> IntArray:
    """At most ``count`` of ``total`` indices, evenly spread."""
    if total <= count:
        return np.arange(total)
    return np.unique(np.linspace(0, total - 1, max(count, 1)).astype(np.int64))


def made_links(record: StepRecord, count: int) -> Links:
    """The joins that were made, of at most ``count`` innovations spread evenly.

    The strength is p(u | x) relative to its peak: how well the history explains the innovation.
    """
    association = record.association
    histories = _histories(record)
    targets = sample_evenly(len(histories), count)
    targets = targets[histories[targets] >= 0]
    if not count or not len(targets):
        return _NONE
    strengths = np.full(len(targets), 0.45) if association is None else _plausibility(association, targets)
    return Links(histories[targets], targets, strengths)


def possible_links(record: StepRecord, count: int) -> Links:
    """The ``count`` most probable joins of history sampling; none where histories are not sampled.

    The strength is w_l p(u_i | x_l), relative to the strongest one.
    """
    association = record.association
    if association is None or association.arbitrary or not count:
        return _NONE
    rows = sample_evenly(len(association.innovations), max(count // 3, 8))
    targets, sources, log_joint = association.strongest_pairs(count, rows)
    return Links(sources, targets, np.exp(log_joint - log_joint.max()))


def _histories(record: StepRecord) -> IntArray:
    """For each proposed innovation the index of its history in ``record.previous``."""
    stage = record.stage("associate") or record.stage("predict")
    if stage is None or stage.histories is None:
        return record.histories
    return stage.histories


def _plausibility(association: Association, indices: IntArray) -> FloatArray:
    deviations = association.innovations[indices] - association.means[association.chosen[indices]]
    whitened = np.linalg.solve(np.linalg.cholesky(association.covariance), deviations.T)
    return np.exp(-0.5 * np.sum(whitened * whitened, axis=0))
