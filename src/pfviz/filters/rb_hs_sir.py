"""RB-HS-SIR and RB-SS-HS-SIR: every innovation samples the history that could have produced it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pfviz.filters import steps
from pfviz.model import Model, Proposal, is_missing
from pfviz.particles import ParticleSet
from pfviz.randomness import Streams
from pfviz.record import StepRecord


@dataclass(frozen=True, slots=True)
class RbHsSir:
    """Rao-Blackwellised SIR with history sampling (Tables 3 and 4 of Torma & Szepesvari).

    Draw u_i ~ pi(u | y); draw a history I_i with probability proportional to ``w_l p(u_i | x_l)``; draw the components
    v_i that pi does not cover from ``p(v | u_i, x_{I_i})``; weigh by
    ``p(y | u_i, v_i) / pi(u_i | y) * sum_l w_l p(u_i | x_l)``. Unbiased. Nothing is resampled on its own: the draw of
    the histories does it.

    Why it works: joined to a history drawn at random, u_i would need the weight ``p(u_i | x_l)`` of Basic-SIR, which is
    tiny for most l. Drawing l in proportion to it moves that factor from the weight into the draw, and leaves its mean
    over the histories, the sum, which is the same whatever history was drawn.

    With a proposal that covers the whole innovation this is RB-HS-SIR (Table 3); with one that covers a subspace it is
    RB-SS-HS-SIR (Table 4), for any components and any noise covariance. Two misprints of Table 4 are put right here:
    its sum runs over ``w_l p(u_l | x_l)`` where the derivation needs ``w_l p(u_i | x_l)``; and it weighs by p(y | u)
    where the observation depends on the whole innovation (Assumption D), so ``p(y | u, v)``.

    Assumes A, B, D and E of the sources, and a Gaussian transition. Cost: N likelihoods and N^2 transition densities.

    Attributes:
        n_particles: N.
    """

    n_particles: int = 400

    def __post_init__(self) -> None:
        steps.check_settings(self.n_particles)

    def initial(self, rng: np.random.Generator, model: Model) -> ParticleSet:
        return steps.sample_prior(rng, model, self.n_particles)

    def step(self, rng: np.random.Generator, model: Model, particles: ParticleSet, observation: Any) -> StepRecord:
        streams = Streams(rng)
        if is_missing(observation):
            return steps.predict_only(streams, model, particles, observation)
        return self.weigh_proposed(streams, model, particles, observation, model.proposal(observation))

    def weigh_proposed(
        self, streams: Streams, model: Model, particles: ParticleSet, observation: Any, proposal: Proposal
    ) -> StepRecord:
        """The step with a ``proposal`` other than the model's own, such as one found by a search."""
        dynamics, components = model.dynamics, proposal.components
        proposed = steps.propose(streams, proposal, self.n_particles)
        associated = steps.sample_histories(streams, dynamics, particles, proposed, components)
        chosen = associated.stage.histories
        assert chosen is not None
        completed = steps.complete(streams, dynamics, particles, chosen, associated.stage, components)

        weighed = steps.weigh(
            completed,
            {
                "likelihood": model.log_likelihood(completed.particles.innovation, observation),
                "mixture": associated.log_mixture,
                "proposal": -proposal.log_density(proposed.particles.innovation),
            },
        )
        n, m = self.n_particles, len(particles)
        stages = (proposed, associated.stage, completed, weighed.stage)
        return StepRecord(observation, particles, stages, weighed.log_evidence, n, n * m, weighed.condition)
