"""LS-N-IPS: predicted particles climb the likelihood before they are weighed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pfviz.filters import steps
from pfviz.filters.local_search import LocalSearch
from pfviz.model import Model, is_missing, shift
from pfviz.particles import ParticleSet
from pfviz.randomness import Streams
from pfviz.record import Stage, StepRecord


@dataclass(frozen=True, slots=True)
class LsNIps:
    """Local search in the N-interacting particle system (Torma & Szepesvari, NOLCOS 2001). Biased.

    CONDENSATION with one more move: resample; predict x ~ p(x1' | x); let each prediction climb to ``S(x)``, a place
    within ``radius`` where the likelihood is larger; weigh by ``p(y | S(x))``. The search is a ``LocalSearch``: any
    that finds a larger likelihood within the radius would do.

    It trades bias for variance: a few particles reach a narrow peak of the likelihood that prediction alone
    would miss, but they all gather there. The cloud is narrower than the posterior, it believes the observation more
    and the dynamics less than the model does, and the mean weight overestimates the evidence, always: no particle
    weighs less than without the search. With a radius that goes to zero it becomes CONDENSATION.

    Assumes A, D of the sources; a likelihood without flat regions. Cost: N (1 + 2 k rounds) likelihoods and N draws of
    the dynamics, in k dimensions.

    Attributes:
        n_particles: N.
        radius: how far a particle may climb, in standard deviations of the system noise (the lambda of the source).
        rounds: of the search, each with half the step of the one before.
        resampling: "systematic", "stratified", "residual" or "multinomial".
        ess_threshold: resample only when the ESS falls below this share of N; 1 resamples always.
    """

    n_particles: int = 400
    radius: float = 1.0
    rounds: int = 3
    resampling: str = "systematic"
    ess_threshold: float = 1.0

    def __post_init__(self) -> None:
        steps.check_settings(self.n_particles, self.resampling, self.ess_threshold)
        LocalSearch(self.radius, self.rounds)

    def initial(self, rng: np.random.Generator, model: Model) -> ParticleSet:
        return steps.sample_prior(rng, model, self.n_particles)

    def step(self, rng: np.random.Generator, model: Model, particles: ParticleSet, observation: Any) -> StepRecord:
        streams = Streams(rng)
        if is_missing(observation):
            return steps.predict_only(streams, model, particles, observation)

        resampled = steps.resample(streams, particles, self.resampling, self.ess_threshold)
        predicted = steps.predict(streams, model.dynamics, resampled)
        found = LocalSearch(self.radius, self.rounds)(model, observation, predicted.particles.innovation)
        states = shift(resampled.particles.states, found.points)
        everyone = np.arange(len(particles))
        climbed = ParticleSet(states, predicted.particles.log_weights)
        searched = Stage("search", climbed, everyone, predicted.histories)
        weighed = steps.weigh(searched, {"likelihood": found.log_likelihood})

        stages = (resampled, predicted, searched, weighed.stage)
        n = len(particles)
        return StepRecord(observation, particles, stages, weighed.log_evidence, found.evaluations, n, weighed.condition)
