"""What a tracker adds to a filter: it forgets what it hardly believes, and looks for an object that is lost."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pfviz.filters import steps
from pfviz.filters.registry import Filter
from pfviz.particles import ParticleSet
from pfviz.randomness import Streams
from pfviz.record import Stage, StepRecord
from pfviz.vision.presence import NOT_YET_FOUND
from pfviz.vision.tracker import TrackerModel


@dataclass(frozen=True, slots=True)
class Restarting:
    """Any filter, whose posterior is resampled, and some of whose particles start anew while the object is lost.

    The step is that of ``filter``, unchanged. One more stage may follow.

    *Resampling*, where the filter itself has not resampled. A filter that keeps its weights keeps the smallest too: a
    place that looks like the object keeps drawing histories, if only with weights of 1e-100, and grows from that as
    soon as it looks a little more like the object than the object does, in frame after frame, as if frames were
    independent. In N equal particles a place that is believed in with less than 1/N has probably none. Unbiased.

    *Restarts*, while the model says that the object is lost (``TrackerModel.searching``), as long as the estimate's
    score in the frame is below that at which it would count as found; and at once where the score is that of
    background, as when the object has turned back more sharply than the dynamics can follow. The last ``share`` of the
    copies made by the resampling are replaced by states drawn from the model's prior of an object that may be anywhere,
    moved to where the detector points, u ~ pi(u | y), velocity and all. They have no history (-1), as the
    re-initialised particles of ICondensation (Isard & Blake 1998), and are weighed for the first time in the next step,
    by whatever ``filter`` does there. That puts in a probability that the dynamics know nothing of, where the data
    point, so the evidence of a run with restarts in it is biased.

    Attributes:
        filter: what runs.
        share: of the particles that start anew in every frame in which the object is lost; 0 for never.
    """

    filter: Filter
    share: float = 0.25

    def __post_init__(self) -> None:
        steps.check_share("share", self.share)

    def initial(self, rng: np.random.Generator, model: TrackerModel) -> ParticleSet:
        return self.filter.initial(rng, model)

    def step(
        self, rng: np.random.Generator, model: TrackerModel, particles: ParticleSet, observation: Any
    ) -> StepRecord:
        record = self.filter.step(rng, model, particles, observation)
        if record.condition == "missing":
            return record
        count = round(self.share * len(record.posterior))
        rule = model.presence_rule
        threshold = rule.found_threshold if model.searching else rule.hopeless_threshold
        if count and model.score(record) < threshold:
            return steps.extend(record, _restarted(Streams(rng), model, record, count))
        if record.stage("resample") is None:
            return steps.extend(record, steps.select(Streams(rng), record.stages[-1], "systematic"))
        return record


def _restarted(streams: Streams, model: TrackerModel, record: StepRecord, count: int) -> Stage:
    """The posterior resampled, its last ``count`` particles begun anew."""
    kept = steps.resample(streams, record.posterior, "systematic")
    lost = model.given(NOT_YET_FOUND)
    proposal = lost.proposal(record.observation)
    places = proposal.sample(streams.of("propose"), count)
    fresh = lost.sample_prior(streams.of("prior"), count)
    chosen = list(proposal.components)
    fresh[:, :, chosen] += (places - fresh[:, 0, chosen])[:, None, :]
    states = np.array(kept.particles.states)
    states[-count:] = fresh
    assert kept.ancestors is not None
    histories = np.array(record.histories[kept.ancestors])
    histories[-count:] = -1
    return Stage("resample", ParticleSet.uniform(states), kept.ancestors, histories, proposal=proposal)
