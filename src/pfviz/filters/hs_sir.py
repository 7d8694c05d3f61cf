"""HS-SIR: innovations and histories are both sampled, in that order."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pfviz.filters import steps
from pfviz.filters.rb_hs_sir import RbHsSir
from pfviz.model import Model, Proposal, is_missing
from pfviz.particles import ParticleSet
from pfviz.randomness import Streams
from pfviz.record import StepRecord


@dataclass(frozen=True, slots=True)
class HsSir:
    """SIR with history sampling (Table 2 of Torma & Szepesvari).

    All N^2 pairs of an innovation u_j ~ pi(u | y) and a history l are candidates, with weights
    ``p(y | u_j) w_l p(u_j | x_l) / pi(u_j | y)``. N pairs are drawn from them in two steps: an innovation J with
    probability proportional to the pair weights summed over the histories,
    ``alpha_j = p(y | u_j) / pi(u_j | y) * sum_l w_l p(u_j | x_l)``, and then for each a history I given J, with
    probability proportional to ``w_l p(u_J | x_l)``. The new particles ``(u_J, f2(x_I))`` weigh the same, and the mean
    of the alpha_j estimates the evidence. Unbiased (with ``residual`` or ``systematic`` draws of J too).

    Table 2 of the first text prints f2(x^(J)): a misprint for f2(x^(I)), as its derivation and the second text have it.

    Drawing J adds noise that RB-HS-SIR leaves out by keeping alpha_j as the weight of u_j; look for copies of one
    innovation with different histories.

    Where the proposal covers a subspace only, alpha_j would need the likelihood of components that are not known before
    the history is. So I_j and then v_j ~ p(v | u_j, x_{I_j}) are drawn first, as in Table 4, and J from the weights.

    Assumes A, B, D and E of the sources, and a Gaussian transition. Cost: N likelihoods and 2 N^2 transition densities
    (the sums and the draws; N^2 with a subspace).

    Attributes:
        n_particles: N.
        resampling: how J is drawn: "systematic", "stratified", "residual" or "multinomial".
    """

    n_particles: int = 400
    resampling: str = "systematic"

    def __post_init__(self) -> None:
        steps.check_settings(self.n_particles, self.resampling)

    def initial(self, rng: np.random.Generator, model: Model) -> ParticleSet:
        return steps.sample_prior(rng, model, self.n_particles)

    def step(self, rng: np.random.Generator, model: Model, particles: ParticleSet, observation: Any) -> StepRecord:
        streams = Streams(rng)
        if is_missing(observation):
            return steps.predict_only(streams, model, particles, observation)
        proposal = model.proposal(observation)
        if len(proposal.components) == model.dynamics.dimension:
            return self._pairs(streams, model, particles, observation, proposal)
        return self._triples(streams, model, particles, observation, proposal)

    def _pairs(
        self, streams: Streams, model: Model, particles: ParticleSet, observation: Any, proposal: Proposal
    ) -> StepRecord:
        """J, then I given J: Table 2 to the letter."""
        dynamics, components = model.dynamics, proposal.components
        proposed = steps.propose(streams, proposal, self.n_particles)
        innovations = proposed.particles.innovation
        weighed = steps.weigh(
            proposed,
            {
                "likelihood": model.log_likelihood(innovations, observation),
                "mixture": steps.log_mixture(dynamics, particles, innovations, components),
                "proposal": -proposal.log_density(innovations),
            },
        )
        chosen = steps.select(streams, weighed.stage, self.resampling)
        associated = steps.sample_histories(streams, dynamics, particles, chosen, components).stage
        assert associated.histories is not None
        joined = steps.complete(streams, dynamics, particles, associated.histories, associated, components)
        n, m = self.n_particles, len(particles)
        stages = (proposed, weighed.stage, chosen, associated, joined)
        return StepRecord(observation, particles, stages, weighed.log_evidence, n, 2 * n * m, weighed.condition)

    def _triples(
        self, streams: Streams, model: Model, particles: ParticleSet, observation: Any, proposal: Proposal
    ) -> StepRecord:
        """I_j and v_j for every u_j, then J: the stages of RB-SS-HS-SIR and a draw from its weights."""
        record = RbHsSir(self.n_particles).weigh_proposed(streams, model, particles, observation, proposal)
        chosen = steps.select(streams, record.stages[-1], self.resampling)
        return steps.extend(record, chosen)
