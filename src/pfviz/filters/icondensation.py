"""ICondensation: prediction, importance sampling and re-initialisation, mixed particle by particle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfviz.filters import steps
from pfviz.model import Components, Model, Proposal, is_missing, shift
from pfviz.particles import FloatArray, IntArray, ParticleSet
from pfviz.randomness import Streams
from pfviz.record import Association, Stage, StepRecord

PLAIN, IMPORTANCE, REINITIALISED = 0, 1, 2


@dataclass(frozen=True, slots=True)
class ICondensation:
    """ICondensation (Isard & Blake 1998), as Torma & Szepesvari read it. Biased as published.

    For each particle a history is resampled and one of three ways is chosen at random:

    - *plain*: the innovation is predicted by the dynamics, as in CONDENSATION, and weighs ``p(y | x)``;
    - *importance*: u ~ pi(u | y) is joined to the history at hand, whatever it is, as in Basic-SIR, but weighs
      ``p(y | u, v) / pi(u | y) * sum_l w_l p(u | x_l)``, as in RB-HS-SIR;
    - *re-initialised*: a state is drawn from the prior and moved to where u ~ pi(u | y) is, velocity and all; it has no
      history, and weighs ``p(y | x)``.

    The second is inconsistent: that weight is right for a history that was *sampled* in proportion to
    ``w_l p(u | x_l)``, not for an arbitrary one, so wrong pairs of innovation and history keep their weight and lead
    the next prediction astray. It does not show in the innovation of one step, it does in all that depends on the
    history: in the step that follows, and in orders above one. (In order one a state has no history, and the second way
    alone *is* RB-HS-SIR.) The third puts in a probability that the model knows nothing of. What is given as the
    evidence is the mean weight, and is biased likewise. It works where the particles are so close together that any
    history will do, and it recovers from a loss of the target.

    ``repaired`` gives the weight that is right for how the innovation was drawn: from the mixture
    ``q(u | x_i) = (importance + reinitialise) pi(u | y) + plain p(u | x_i)``, hence
    ``p(y | u, v) p(u | x_i) / q(u | x_i)``. A state without a history cannot be given a right weight by this model, so
    the third way then keeps its history, as the second does. Unbiased.

    Assumes A, B, D and E of the sources, and a Gaussian transition. Cost: N likelihoods and up to N^2 transition
    densities (N when repaired).

    Attributes:
        n_particles: N.
        importance: the probability of the second way.
        reinitialise: the probability of the third; the first has the rest.
        repaired: weigh rightly instead of as published.
        resampling: "systematic", "stratified", "residual" or "multinomial".
        ess_threshold: resample only when the ESS falls below this share of N; 1 resamples always.
    """

    n_particles: int = 400
    importance: float = 0.5
    reinitialise: float = 0.1
    repaired: bool = False
    resampling: str = "systematic"
    ess_threshold: float = 1.0

    def __post_init__(self) -> None:
        steps.check_settings(self.n_particles, self.resampling, self.ess_threshold)
        steps.check_share("importance", self.importance)
        steps.check_share("reinitialise", self.reinitialise)
        if self.plain < 0.0:
            raise steps.FilterError(
                f"importance and reinitialise must sum to at most 1, got {self.importance!r} and {self.reinitialise!r}"
            )

    @property
    def plain(self) -> float:
        """The probability of the first way."""
        rest = 1.0 - self.importance - self.reinitialise
        return 0.0 if abs(rest) < 1e-12 else rest

    def initial(self, rng: np.random.Generator, model: Model) -> ParticleSet:
        return steps.sample_prior(rng, model, self.n_particles)

    def step(self, rng: np.random.Generator, model: Model, particles: ParticleSet, observation: Any) -> StepRecord:
        streams = Streams(rng)
        if is_missing(observation):
            return steps.predict_only(streams, model, particles, observation)
        proposal = model.proposal(observation)
        components = proposal.components
        n = len(particles)

        resampled = steps.resample(streams, particles, self.resampling, self.ess_threshold)
        ways = self._ways(streams, n)
        proposed = _propose(streams, model, resampled.particles, proposal, ways)
        joined = _join(model, resampled, proposed, components, ways)
        completed = _complete(streams, model, resampled, joined, components, ways)

        innovations = proposed.particles.innovation
        if self.repaired:
            factors = self._right_factors(model, resampled.particles, innovations, proposal)
            transitions = 2 * n
        else:
            drawn = ways == IMPORTANCE
            factors = _published_factors(model, particles, innovations, proposal, drawn)
            transitions = n + int(drawn.sum()) * n
        likelihood = model.log_likelihood(completed.particles.innovation, observation)
        weighed = steps.weigh(completed, {"likelihood": likelihood, **factors})
        stages = (resampled, proposed, joined, completed, weighed.stage)
        return StepRecord(observation, particles, stages, weighed.log_evidence, n, transitions, weighed.condition)

    def _ways(self, streams: Streams, count: int) -> IntArray:
        uniforms = streams.of("choose").random(count)
        ways = np.where(uniforms < self.importance + self.reinitialise, IMPORTANCE, PLAIN)
        if not self.repaired:
            ways[uniforms < self.reinitialise] = REINITIALISED
        return ways

    def _right_factors(
        self, model: Model, histories: ParticleSet, innovations: FloatArray, proposal: Proposal
    ) -> Mapping[str, FloatArray]:
        transition = model.dynamics.log_transition(innovations, histories.states, proposal.components)
        with np.errstate(divide="ignore"):
            log_plain, log_drawn = np.log([self.plain, self.importance + self.reinitialise])
        log_density = np.logaddexp(log_plain + transition, log_drawn + proposal.log_density(innovations))
        return {"transition": transition, "proposal": -log_density}


def _published_factors(
    model: Model, particles: ParticleSet, innovations: FloatArray, proposal: Proposal, drawn: NDArray[np.bool_]
) -> Mapping[str, FloatArray]:
    """The correction f/g of Isard & Blake for the innovations ``drawn`` by importance sampling; one for the others."""
    mixture, density = np.zeros(len(innovations)), np.zeros(len(innovations))
    if drawn.any():
        mixture[drawn] = steps.log_mixture(model.dynamics, particles, innovations[drawn], proposal.components)
        density[drawn] = proposal.log_density(innovations[drawn])
    return {"mixture": mixture, "proposal": -density}


def _propose(streams: Streams, model: Model, histories: ParticleSet, proposal: Proposal, ways: IntArray) -> Stage:
    """Each particle's innovation, predicted or drawn from pi, restricted to the components that pi covers."""
    drawn = proposal.sample(streams.of("propose"), len(ways))
    predicted = model.dynamics.sample(streams.of("predict"), histories.states)[:, list(proposal.components)]
    innovations = np.where((ways == PLAIN)[:, None], predicted, drawn)
    return Stage("propose", ParticleSet.uniform(innovations[:, None, :]))


def _join(model: Model, resampled: Stage, proposed: Stage, components: Components, ways: IntArray) -> Stage:
    """Innovation i goes with history i, or with none where it was re-initialised."""
    stage = steps.join_by_index(model.dynamics, resampled, proposed, components)
    association = stage.association
    assert stage.histories is not None and isinstance(association, Association)
    histories = np.where(ways == REINITIALISED, -1, stage.histories)
    return Stage("associate", stage.particles, stage.ancestors, histories, association=association)


def _complete(
    streams: Streams, model: Model, resampled: Stage, joined: Stage, components: Components, ways: IntArray
) -> Stage:
    """Whole states: v ~ p(v | u, x_i), and for the re-initialised a draw from the prior, moved to u."""
    histories = resampled.particles
    states = histories.states
    u = joined.particles.innovation
    innovation = model.dynamics.complete(streams.of("complete"), u, states, components)
    states = shift(states, innovation)
    anew = np.flatnonzero(ways == REINITIALISED)
    if len(anew):
        fresh = np.array(model.sample_prior(streams.of("prior"), len(anew)))
        chosen = list(components)
        fresh[:, :, chosen] += (u[anew] - fresh[:, 0, chosen])[:, None, :]
        states[anew] = fresh
    particles = ParticleSet(states, histories.log_weights)
    return Stage("complete", particles, np.arange(len(ways)), joined.histories)
