"""CONDENSATION, the bootstrap filter: the dynamics propose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pfviz.filters import steps
from pfviz.model import Model, is_missing
from pfviz.particles import ParticleSet
from pfviz.randomness import Streams
from pfviz.record import StepRecord


@dataclass(frozen=True, slots=True)
class Condensation:
    """CONDENSATION (Isard & Blake 1998), also known as the bootstrap filter (Gordon et al. 1993) or N-IPS.

    Resample; draw each innovation from p(x1' | x); weigh by p(y | x1'). It never looks at the proposal pi. Unbiased.

    Cost: N likelihoods and N draws of the dynamics.

    Attributes:
        n_particles: N.
        resampling: "systematic", "stratified", "residual" or "multinomial".
        ess_threshold: resample only when the ESS falls below this share of N; 1 resamples always.
    """

    n_particles: int = 400
    resampling: str = "systematic"
    ess_threshold: float = 1.0

    def __post_init__(self) -> None:
        steps.check_settings(self.n_particles, self.resampling, self.ess_threshold)

    def initial(self, rng: np.random.Generator, model: Model) -> ParticleSet:
        return steps.sample_prior(rng, model, self.n_particles)

    def step(self, rng: np.random.Generator, model: Model, particles: ParticleSet, observation: Any) -> StepRecord:
        streams = Streams(rng)
        if is_missing(observation):
            return steps.predict_only(streams, model, particles, observation)

        resampled = steps.resample(streams, particles, self.resampling, self.ess_threshold)
        predicted = steps.predict(streams, model.dynamics, resampled)

        likelihood = model.log_likelihood(predicted.particles.innovation, observation)
        weighed = steps.weigh(predicted, {"likelihood": likelihood})

        n = len(particles)
        stages = (resampled, predicted, weighed.stage)
        return StepRecord(observation, particles, stages, weighed.log_evidence, n, n, weighed.condition)
