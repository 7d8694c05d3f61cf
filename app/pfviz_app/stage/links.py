"""Which arrows to draw between the particles before a step and the innovations of it."""

from __future__ import annotations

import numpy as np

from pfviz.figures.reading import Pairs
from pfviz.particles import IntArray
from pfviz.record import StepRecord
from pfviz_app.stage.seen import Seen

_NONE = Pairs(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0))


def sample_evenly(total: int, count: int) -> IntArray:
    """At most ``count`` of ``total`` indices, evenly spread."""
    if total <= count:
        return np.arange(total)
    return np.unique(np.linspace(0, total - 1, max(count, 1)).astype(np.int64))


def made_links(record: StepRecord, count: int) -> Pairs:
    """The joins that were made, at most ``count`` of them, spread evenly.

    The strength is p(u | x) relative to its peak: how well the history explains the innovation.
    """
    joins = Seen(record).joins()
    if joins is None or not count:
        return _NONE
    sources, targets, _ = joins
    shown = sample_evenly(len(sources), count)
    shown = shown[sources[shown] >= 0]
    if not len(shown):
        return _NONE
    association = record.association
    strengths = np.full(len(shown), 0.45) if association is None else association.plausibility(shown)
    return Pairs(sources[shown], targets[shown], strengths)


def possible_links(record: StepRecord, count: int) -> Pairs:
    """The ``count`` most probable joins of history sampling; none where histories are not sampled.

    The strength is w_l p(u_i | x_l), relative to the strongest one.
    """
    association, joins = record.association, Seen(record).joins()
    if association is None or joins is None or association.arbitrary or not count:
        return _NONE
    rows = sample_evenly(len(association.innovations), max(count // 3, 8))
    innovations, histories, log_joint = association.strongest_pairs(count, rows)
    return Pairs(record.origins[histories], joins[1][innovations], np.exp(log_joint - log_joint.max()))
