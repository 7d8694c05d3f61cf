"""Innovation-SIR: every history samples an innovation that it could have produced."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pfviz import kernels
from pfviz.filters import steps
from pfviz.model import Dynamics, Model, Proposal, is_missing
from pfviz.particles import FloatArray, ParticleSet
from pfviz.randomness import Streams
from pfviz.record import Association, Stage, StepRecord


@dataclass(frozen=True, slots=True)
class InnovationSir:
    """The mirror image of history sampling: histories are kept, innovations are sampled (section 2, "other variants").

    Draw a pool u_j ~ pi(u | y); keep history i and draw for it an innovation J_i with probability proportional to
    ``p(y | u_j) p(u_j | x_i) / pi(u_j | y)``; weigh by ``w_i`` times the mean of these over the pool. That mean is an
    estimate, by importance sampling, of p(y | x_i), how well history i predicts what is seen, and the draw is one from
    p(u | x_i, y), the best proposal there is. Unbiased.

    The sources set it aside: it serves who trusts the particles more than the detector. All histories draw on one pool,
    so their weights err together: one look at the evidence is noisier than that of RB-HS-SIR.

    Where the proposal covers a subspace only, the likelihood cannot be known before the rest of the innovation is: J_i
    is then drawn in proportion to ``p(u_j | x_i) / pi(u_j | y)``, v_i from ``p(v | u_J, x_i)``, and ``p(y | u_J, v_i)``
    goes into the weight.

    Assumes A, B, D and E of the sources, and a Gaussian transition. Cost: N likelihoods and N^2 transition densities.

    Attributes:
        n_particles: N.
        resampling: "systematic", "stratified", "residual" or "multinomial".
        ess_threshold: resample only when the ESS falls below this share of N; 1 resamples always.
    """

    n_particles: int = 400
    resampling: str = "systematic"
    ess_threshold: float = 0.5

    def __post_init__(self) -> None:
        steps.check_settings(self.n_particles, self.resampling, self.ess_threshold)

    def initial(self, rng: np.random.Generator, model: Model) -> ParticleSet:
        return steps.sample_prior(rng, model, self.n_particles)

    def step(self, rng: np.random.Generator, model: Model, particles: ParticleSet, observation: Any) -> StepRecord:
        streams = Streams(rng)
        if is_missing(observation):
            return steps.predict_only(streams, model, particles, observation)
        dynamics, proposal = model.dynamics, model.proposal(observation)
        covers_all = len(proposal.components) == dynamics.dimension

        resampled = steps.resample(streams, particles, self.resampling, self.ess_threshold)
        proposed = steps.propose(streams, proposal, self.n_particles)
        pool = proposed.particles.innovation
        log_worth = -proposal.log_density(pool)
        if covers_all:
            log_worth = log_worth + model.log_likelihood(pool, observation)

        joined, log_mean = _sample_innovations(streams, dynamics, resampled, proposed, log_worth, proposal)
        everyone = np.arange(len(particles))
        completed = steps.complete(
            streams,
            dynamics,
            resampled.particles,
            everyone,
            joined,
            proposal.components,
            resampled.particles.log_weights,
        )
        factors = {"mixture": log_mean}
        if not covers_all:
            factors["likelihood"] = model.log_likelihood(completed.particles.innovation, observation)
        weighed = steps.weigh(completed, factors)

        n, m = self.n_particles, len(particles)
        stages = (resampled, proposed, joined, completed, weighed.stage)
        likelihoods = n if covers_all else m
        return StepRecord(observation, particles, stages, weighed.log_evidence, likelihoods, n * m, weighed.condition)


def _sample_innovations(
    streams: Streams,
    dynamics: Dynamics,
    histories: Stage,
    proposed: Stage,
    log_worth: FloatArray,
    proposal: Proposal,
) -> tuple[Stage, FloatArray]:
    """The stage that gives each history its innovation J_i, and the log of the mean over the pool.

    A Gaussian transition depends on u_j and the mean of p(u | x_i) through their difference alone: with the two in each
    other's place, this is the sampling of histories. Where nothing in the pool is worth anything, J_i is drawn as if
    all of it were worth the same.
    """
    pool = proposed.particles.innovation
    means, covariance = steps.restricted(dynamics, histories.particles.states, proposal.components)
    uniforms = streams.of("associate").random(len(means))
    worthless = bool(np.isneginf(log_worth).all())
    values = np.zeros_like(log_worth) if worthless else log_worth
    log_sum, chosen = kernels.sample_histories(means, pool, values, covariance, uniforms)
    log_mean = np.full_like(log_sum, -np.inf) if worthless else log_sum - np.log(len(pool))
    association = Association(
        histories.particles,
        pool[chosen],
        np.arange(len(means)),
        means,
        covariance,
        pool=pool,
        log_pool_weights=values,
    )
    drawn = ParticleSet.uniform(pool[chosen][:, None, :])
    return Stage("associate", drawn, chosen, histories.histories, association=association), log_mean
