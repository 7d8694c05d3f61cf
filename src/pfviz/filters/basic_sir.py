"""Basic-SIR: innovations from the proposal, joined to histories by index."""

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
class BasicSir:
    """Basic-SIR (Table 1 of Torma & Szepesvari): the straightforward use of a proposal pi(u | y).

    Resample; draw u_i ~ pi(u | y); keep history i; weigh by ``p(y | u_i) p(u_i | x_i) / pi(u_i | y)``. Unbiased, but
    u_i knows nothing of the history it is joined to, so p(u_i | x_i) is tiny for most pairs when the system noise is
    small: the weights degenerate. Components that pi does not cover are drawn from p(v | u, x), as in Table 4.

    Cost: N likelihoods and N transition densities.

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
        dynamics, proposal = model.dynamics, model.proposal(observation)
        components = proposal.components

        resampled = steps.resample(streams, particles, self.resampling, self.ess_threshold)
        histories = resampled.particles

        proposed = steps.propose(streams, proposal, len(particles))
        joined = steps.join_by_index(dynamics, resampled, proposed, components)
        completed = steps.complete(
            streams, dynamics, histories, np.arange(len(particles)), joined, components, histories.log_weights
        )

        innovations = proposed.particles.innovation
        weighed = steps.weigh(
            completed,
            {
                "likelihood": model.log_likelihood(completed.particles.innovation, observation),
                "transition": dynamics.log_transition(innovations, histories.states, components),
                "proposal": -proposal.log_density(innovations),
            },
        )
        n = len(particles)
        stages = (resampled, proposed, joined, completed, weighed.stage)
        return StepRecord(observation, particles, stages, weighed.log_evidence, n, n, weighed.condition)
