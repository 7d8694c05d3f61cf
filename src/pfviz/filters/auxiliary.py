"""The auxiliary particle filter: look ahead, then resample."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pfviz.filters import steps
from pfviz.model import Model, is_missing
from pfviz.particles import FloatArray, ParticleSet
from pfviz.randomness import Streams
from pfviz.record import Stage, StepRecord


@dataclass(frozen=True, slots=True)
class Auxiliary:
    """The auxiliary particle filter (Pitt & Shephard 1999).

    Look ahead: weigh each history by ``w_k p(y | m_k)``, where m_k is the mean of p(x1' | x_k); resample with these
    first-stage weights; draw x1' ~ p(x1' | x_k); weigh by ``p(y | x1') / p(y | m_k)``, which takes the look ahead back.
    The mean weight times the sum of the first-stage weights estimates the evidence. Unbiased.

    The look ahead helps when what is seen tells the histories apart and m_k stands well for its particle: small system
    noise, or a broad likelihood. It never looks at the detector.

    With ``draws`` R > N, R are drawn and weighed and N of them kept by their weights, as published: "it involves R >> N
    evaluation steps of the observation density" (Torma & Szepesvari). The first stage costs N evaluations more.

    Where p(y | m_k) underestimates the truth by much, the few that get through are weighed up without bound. So a small
    share of the first-stage draws is made by the weights w_k alone: a *defensive mixture* (Hesterberg 1995), which
    bounds the weight by ``p(y | x1') / defence``. 0 is the filter as published.

    Assumes A and D of the sources. Cost: N + R likelihoods, N means and R draws of the dynamics.

    Attributes:
        n_particles: N.
        draws: R, at least N; None for N.
        defence: the share of the first-stage draws that does not look ahead.
        resampling: "systematic", "stratified", "residual" or "multinomial".
    """

    n_particles: int = 400
    draws: int | None = None
    defence: float = 0.1
    resampling: str = "systematic"

    def __post_init__(self) -> None:
        steps.check_settings(self.n_particles, self.resampling)
        steps.check_share("defence", self.defence)
        if self.draws is not None and not (isinstance(self.draws, int) and self.draws >= self.n_particles):
            raise steps.FilterError(f"draws must be a whole number of at least n_particles, got {self.draws!r}")

    def initial(self, rng: np.random.Generator, model: Model) -> ParticleSet:
        return steps.sample_prior(rng, model, self.n_particles)

    def step(self, rng: np.random.Generator, model: Model, particles: ParticleSet, observation: Any) -> StepRecord:
        streams = Streams(rng)
        if is_missing(observation):
            return steps.predict_only(streams, model, particles, observation)
        n, draws = len(particles), self.draws or self.n_particles

        expected = model.dynamics.predict(particles.states)
        log_preview = self._preview(particles, model.log_likelihood(expected, observation))
        everyone = Stage("resample", particles, np.arange(n), np.arange(n))
        previewed = steps.weigh(everyone, {"preview": log_preview}).stage
        chosen = steps.draw_ancestors(streams.of("resample"), previewed.particles.weights, self.resampling, draws)
        resampled = Stage("resample", particles.take(chosen), chosen, chosen)

        predicted = steps.predict(streams, model.dynamics, resampled)
        likelihood = model.log_likelihood(predicted.particles.innovation, observation)
        weighed = steps.weigh(predicted, {"likelihood": likelihood, "preview": -log_preview[chosen]})
        stages = (previewed, resampled, predicted, weighed.stage)
        if draws > self.n_particles:
            stages = (*stages, steps.select(streams, weighed.stage, self.resampling, self.n_particles))
        return StepRecord(observation, particles, stages, weighed.log_evidence, n + draws, n + draws, weighed.condition)

    def _preview(self, particles: ParticleSet, log_likelihood: FloatArray) -> FloatArray:
        """``(N,)``: the log of the first-stage weight over w_k. Where none sees anything, nobody looks ahead."""
        steps.check_log_factor("likelihood", log_likelihood, len(particles))
        total = np.logaddexp.reduce(particles.log_weights + log_likelihood)
        if np.isneginf(total):
            return np.zeros(len(particles))
        with np.errstate(divide="ignore"):
            log_ahead, log_defence = np.log([1.0 - self.defence, self.defence])
        return np.logaddexp(log_ahead + log_likelihood - total, log_defence)
