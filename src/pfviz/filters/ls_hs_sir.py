"""LS-HS-SIR: scouts search the likelihood, innovations are drawn about what they found, histories are sampled."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pfviz import kernels
from pfviz.filters import steps
from pfviz.filters.local_search import LocalSearch
from pfviz.filters.rb_hs_sir import RbHsSir
from pfviz.model import Components, Model, is_missing
from pfviz.particles import FloatArray, ParticleSet
from pfviz.randomness import Streams
from pfviz.record import StepRecord

_SMALLEST = -500.0  # logarithm of a share that is never drawn


@dataclass(frozen=True, slots=True)
class LsHsSir:
    """Local search and history sampling together: what both texts of Torma & Szepesvari name as future work. Unbiased.

    A few *scouts* find out where the likelihood is large: one half of them start from the detector, u ~ pi(u | y) with
    a sampled history and v ~ p(v | u, x), the other half from the dynamics, as the particles of CONDENSATION do; all
    climb the likelihood as in LS-N-IPS. Then the innovations are drawn from a density that is made of the places found
    and is known exactly,

        q(x1') = (1 - defence) sum_j b_j N(x1'; c_j, h^2 Q) + defence sum_l w_l p(x1' | x_l),

    Gaussians about the places c_j, h times as wide as the system noise of covariance Q, and the prediction of the
    particles themselves. The rest is RB-HS-SIR with q for pi: I_i ~ w_l p(u_i | x_l), weight
    ``p(y | u_i) / q(u_i) * sum_l w_l p(u_i | x_l)``.

    Given the scouts, q is a fixed density that is positive everywhere, so that the weights are right whatever the
    search did, and LS-N-IPS' bias is gone; they are bounded by ``p(y | u) / defence`` (a defensive mixture, Hesterberg
    1995). The shares b_j are in proportion to ``p(y | c_j) sum_l w_l p(c_j | x_l)``, so that a look-alike, which no
    history explains, draws few.

    It pays where the likelihood is much narrower than what is proposed, and on all components of the innovation, those
    that the detector does not cover too; where pi is good already, the scouts are spent for nothing. One thing it gives
    up: RB-HS-SIR with a good detector is on a target that jumped at once, because it has no particle elsewhere. This
    filter has some where the model says that the target is, and right weights prefer them: like the exact posterior, it
    is slow to believe what the model excludes.

    Assumes A, B, D and E of the sources, and a Gaussian transition. Cost: N + S (1 + 2 k rounds) likelihoods for S
    scouts in k dimensions, and N (2 N + S) densities of the dynamics and of q.

    Attributes:
        n_particles: N.
        scouts: S as a share of N.
        radius: how far a scout may climb, in standard deviations of the system noise.
        rounds: of the search, each with half the step of the one before.
        bandwidth: h.
        defence: the share of innovations drawn as the particles predict.
    """

    n_particles: int = 400
    scouts: float = 0.25
    radius: float = 2.0
    rounds: int = 3
    bandwidth: float = 0.5
    defence: float = 0.2

    def __post_init__(self) -> None:
        steps.check_settings(self.n_particles)
        steps.check_share("scouts", self.scouts)
        steps.check_share("defence", self.defence)
        LocalSearch(self.radius, self.rounds)
        if self.defence == 0.0:
            raise steps.FilterError("defence must be positive: without it q may miss what the particles predict")
        if not (isinstance(self.bandwidth, (int, float)) and 0.0 < self.bandwidth < np.inf):
            raise steps.FilterError(f"bandwidth must be positive, got {self.bandwidth!r}")

    def initial(self, rng: np.random.Generator, model: Model) -> ParticleSet:
        return steps.sample_prior(rng, model, self.n_particles)

    def step(self, rng: np.random.Generator, model: Model, particles: ParticleSet, observation: Any) -> StepRecord:
        streams = Streams(rng)
        if is_missing(observation):
            return steps.predict_only(streams, model, particles, observation)
        count = max(2, round(self.scouts * self.n_particles))
        start = _scouts(streams, model, particles, observation, count)
        found = LocalSearch(self.radius, self.rounds)(model, observation, start)
        proposal = self._proposal(model, particles, found.points, found.log_likelihood)
        record = RbHsSir(self.n_particles).weigh_proposed(streams, model, particles, observation, proposal)
        return steps.with_cost(record, found.evaluations, (self.n_particles + count) * len(particles))

    def _proposal(
        self, model: Model, particles: ParticleSet, places: FloatArray, log_likelihood: FloatArray
    ) -> FoundPlaces:
        dynamics = model.dynamics
        everything = tuple(range(dynamics.dimension))
        log_shares = log_likelihood + steps.log_mixture(dynamics, particles, places, everything)
        peak = log_shares.max()
        log_shares = np.maximum(log_shares - peak, _SMALLEST) if peak > -np.inf else np.zeros(len(places))
        return FoundPlaces(
            places,
            log_shares - np.logaddexp.reduce(log_shares),
            self.bandwidth**2 * dynamics.noise_covariance,
            dynamics.predict(particles.states),
            particles.log_weights,
            dynamics.noise_covariance,
            self.defence,
        )


@dataclass(frozen=True, slots=True)
class FoundPlaces:
    """Gaussians about the places that a search has found, and the prediction of the particles: the density q above.

    Attributes:
        places: ``(S, k)``, the c_j.
        log_shares: ``(S,)``, of the b_j; normalised.
        covariance: ``(k, k)``, of the Gaussians.
        predicted: ``(M, k)``, the means of p(x1' | x_l).
        log_weights: ``(M,)``, of the particles.
        noise_covariance: ``(k, k)``, of the dynamics.
        defence: the share of the prediction.
    """

    places: FloatArray
    log_shares: FloatArray
    covariance: FloatArray
    predicted: FloatArray
    log_weights: FloatArray
    noise_covariance: FloatArray
    defence: float

    @property
    def components(self) -> Components:
        return tuple(range(self.places.shape[1]))

    def sample(self, rng: np.random.Generator, count: int) -> FloatArray:
        """``(count, k)`` draws."""
        plain = rng.random(count) < self.defence
        noise = rng.standard_normal((count, self.places.shape[1]))
        place = steps.draw_ancestors(rng, np.exp(self.log_shares), "stratified", count)
        history = steps.draw_ancestors(rng, np.exp(self.log_weights), "stratified", count)
        found = self.places[place] + noise @ np.linalg.cholesky(self.covariance).T
        predicted = self.predicted[history] + noise @ np.linalg.cholesky(self.noise_covariance).T
        return np.where(plain[:, None], predicted, found)

    def log_density(self, proposed: FloatArray) -> FloatArray:
        """``(N,)``: the log-density at ``proposed (N, k)``."""
        found = kernels.log_mixture_density(proposed, self.places, self.log_shares, self.covariance)
        predicted = kernels.log_mixture_density(proposed, self.predicted, self.log_weights, self.noise_covariance)
        with np.errstate(divide="ignore"):
            log_found, log_plain = np.log([1.0 - self.defence, self.defence])
        return np.logaddexp(log_found + found, log_plain + predicted)


def _scouts(streams: Streams, model: Model, particles: ParticleSet, observation: Any, count: int) -> FloatArray:
    """``(count, k)``: where the searches start, the first half from the detector, the others from the dynamics."""
    rng, dynamics, proposal = streams.of("search"), model.dynamics, model.proposal(observation)
    detected = proposal.sample(rng, (count + 1) // 2)
    means, covariance = steps.restricted(dynamics, particles.states, proposal.components)
    uniforms = rng.random(len(detected))
    _, chosen = kernels.sample_histories(detected, means, particles.log_weights, covariance, uniforms)
    whole = dynamics.complete(rng, detected, particles.states[chosen], proposal.components)
    ancestors = steps.draw_ancestors(rng, particles.weights, "systematic", count // 2)
    predicted = dynamics.sample(rng, particles.states[ancestors])
    return np.concatenate([whole, predicted])
