"""Is the object where the tracker says? Found and lost, from the scores of the estimates so far.

The state is the existence variable of Odobez' lecture (a_t = 1, the object is in view; a_t = 0, it is not): a Markov
chain of two states, filtered exactly. What it observes of a frame is the *score*, the log-likelihood of the frame's
estimate. Two levels are learnt with the object: the score on the object itself, and what the same outline typically
scores on the background of that frame. A score nearer to the one speaks for the object, one nearer to the other
against it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from pfviz.particles import FloatArray, ParticleSet
from pfviz.record import Stage, StepRecord

Status = Literal["tracked", "lost"]

_SMALLEST_GAP = 1.0


@dataclass(frozen=True, slots=True)
class Presence:
    """What is believed of the object being where the tracker says.

    Attributes:
        probability: of the object being there, given the scores so far.
        tracked: the verdict; with hysteresis, so that it does not flicker.
        score: of the latest estimate; NaN before the first and where there was nothing to observe.
        expected: where the object will be in the next frame, in pixels; None where that is not known.
        patch: ``(M,)``, how the object looked there, where the model measures implicit motion.
    """

    probability: float
    tracked: bool
    score: float = float("nan")
    expected: tuple[float, float] | None = None
    patch: FloatArray | None = field(default=None, compare=False, repr=False)

    @property
    def status(self) -> Status:
        return "tracked" if self.tracked else "lost"


AT_START = Presence(0.95, True)
NOT_YET_FOUND = Presence(0.05, False)


@dataclass(frozen=True, slots=True)
class PresenceRule:
    """How scores become a verdict.

    There are two thresholds between the levels, by the part of the gap that a score lies below that of the object. An
    object that turns or is half hidden scores less than it did, and is not lost for it: while it is tracked a score
    counts against it only below ``lost_threshold``. A filter that has no object to follow finds the best of the
    background instead: while it is lost a score counts for it only above ``found_threshold``. A score s is worth the
    log-odds ``weight * (s - threshold) / gap``, at the most ``weight / 2`` either way; they are added to those of the
    state that the chain predicts. "Lost" is said when the probability falls below 1/2 less ``margin``, "tracked" when
    it rises above 1/2 plus ``margin``.

    Attributes:
        object_score: of the outline on the object, in the frame that it was learnt from.
        background_score: the median of the outline's scores elsewhere in that frame.
        lost_share: the part of the gap at which the lower threshold lies.
        found_share: the part of the gap at which the upper threshold lies.
        weight: log-odds of the whole gap.
        change: the probability of the object's coming or going between two frames.
        margin: what keeps the verdict from flickering.
    """

    object_score: float
    background_score: float
    lost_share: float = 0.55
    found_share: float = 0.3
    weight: float = 8.0
    change: float = 0.05
    margin: float = 0.25

    @property
    def gap(self) -> float:
        return max(self.object_score - self.background_score, _SMALLEST_GAP)

    @property
    def lost_threshold(self) -> float:
        """The score below which a tracked object seems to be lost."""
        return self.object_score - self.lost_share * self.gap

    @property
    def found_threshold(self) -> float:
        """The score above which a lost object seems to be found."""
        return self.object_score - self.found_share * self.gap

    @property
    def hopeless_threshold(self) -> float:
        """The score below which a single frame is enough: the estimate lies on background."""
        return 0.5 * (self.lost_threshold + self.background_score)

    def log_odds(self, score: float, tracked: bool) -> float:
        """What ``score`` says for (positive) or against the object being there."""
        threshold = self.lost_threshold if tracked else self.found_threshold
        most = 0.5 * self.weight
        return float(np.clip(self.weight * (score - threshold) / self.gap, -most, most))

    def after(self, before: Presence, score: float) -> Presence:
        """The state one frame later; with a ``score`` of NaN nothing was observed."""
        predicted = self.change + (1.0 - 2.0 * self.change) * before.probability
        odds = predicted / (1.0 - predicted)
        if not np.isnan(score):
            odds *= np.exp(self.log_odds(score, before.tracked))
        probability = float(odds / (1.0 + odds))
        tracked = probability >= 0.5 - self.margin if before.tracked else probability > 0.5 + self.margin
        return Presence(probability, tracked, score)

    def scaled(self, factor: float) -> PresenceRule:
        """The rule for scores that are all multiplied by ``factor``."""
        return replace(self, object_score=self.object_score * factor, background_score=self.background_score * factor)


def is_restart(stage: Stage) -> bool:
    """Whether a stage put particles without a history among those that were weighed."""
    return stage.kind == "resample" and stage.proposal is not None


def weighed_posterior(record: StepRecord) -> ParticleSet:
    """The posterior of a step as it was weighed, before any resampling or restart that followed it."""
    last = len(record.stages) - 1
    while last > 0 and record.stages[last].kind == "resample":
        last -= 1
    return record.stages[last].particles if record.stages[last].kind == "weight" else record.posterior
