"""Looking for an object that is lost: some particles start anew where the detector points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pfviz.filters import steps
from pfviz.filters.registry import Filter
from pfviz.model import is_missing
from pfviz.particles import ParticleSet
from pfviz.randomness import Streams
from pfviz.record import Stage, StepRecord
from pfviz.vision.tracker import TrackerModel


@dataclass(frozen=True, slots=True)
class Restarting:
    """Any filter; while the object is lost, a share of its particles starts anew in every frame.

    The step is that of ``filter``. Then, if the model says that the object is lost (``TrackerModel.searching``) and the
    estimate's score in this frame is still below that at which it would count as found, one more stage follows: the
    posterior is resampled, and the last ``share`` of the copies are replaced by states drawn from the model's prior of
    an object that may be anywhere, moved to where the detector points, u ~ pi(u | y), velocity and all. They have no
    history (-1), as the re-initialised particles of ICondensation (Isard & Blake 1998), and are weighed for the first
    time in the next step, by whatever ``filter`` does there.

    While the object is tracked the record is that of ``filter``, unchanged, and so are its properties. A restart puts
    in a probability that the dynamics know nothing of, where the data point, so the evidence of a run with restarts in
    it is biased.

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
        count = round(self.share * len(record.posterior))
        searching = getattr(model, "searching", False) and not is_missing(observation)
        if not searching or count == 0 or model.score(record) >= model.presence_rule.found_threshold:
            return record
        return steps.extend(record, _restarted(Streams(rng), model, record, count))


def _restarted(streams: Streams, model: TrackerModel, record: StepRecord, count: int) -> Stage:
    """The posterior resampled, its last ``count`` particles begun anew."""
    kept = steps.resample(streams, record.posterior, "systematic")
    proposal = model.proposal(record.observation)
    places = proposal.sample(streams.of("propose"), count)
    fresh = model.sample_prior(streams.of("prior"), count)
    chosen = list(proposal.components)
    fresh[:, :, chosen] += (places - fresh[:, 0, chosen])[:, None, :]
    states = np.array(kept.particles.states)
    states[-count:] = fresh
    assert kept.ancestors is not None
    histories = np.array(record.histories[kept.ancestors])
    histories[-count:] = -1
    return Stage("resample", ParticleSet.uniform(states), kept.ancestors, histories, proposal=proposal)
