"""The unscented particle filter: every particle has a small Kalman filter of its own that proposes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from pfviz.dynamics.autoregressive import cholesky_factor
from pfviz.filters import steps
from pfviz.model import Model, ObservationFunction, is_missing, shift
from pfviz.particles import FloatArray, ParticleSet
from pfviz.randomness import Streams
from pfviz.record import Stage, StepRecord

_WIDTH_RANGE = 1e-6, 1.0
_NOWHERE = -1e3  # stands for the logarithm of a likelihood of zero, where it is fitted


@dataclass(frozen=True, slots=True)
class Unscented:
    """The unscented particle filter (van der Merwe, Doucet, de Freitas & Wan 2000).

    Resample; for each particle let an unscented Kalman filter (Julier & Uhlmann 1997) turn ``p(x1' | x_i)`` and y into
    a Gaussian ``q_i(x1')`` about where the innovation should be; draw from it; weigh by
    ``p(y | x1') p(x1' | x_i) / q_i(x1')``. The density of what is drawn is known, so this is unbiased however bad the
    Gaussian is. Where y sees the innovation linearly and with Gaussian noise, q_i is ``p(x1' | x_i, y)``, the best
    proposal that there is, and the weight is ``p(y | x_i)`` whatever was drawn.

    Two things differ from the published filter. Its Kalman filters carry their covariances from step to step; here each
    starts from the particle alone, which is what the weight asks for. And with the share ``defence`` a particle is
    drawn from ``p(x1' | x_i)`` instead (a defensive mixture, Hesterberg 1995), which bounds the weight by
    ``p(y | x1') / defence``, where a Gaussian that is too narrow would let it grow without bound.

    How y comes in: a model with an ``observation_function`` (``model.ObservationFunction``) is seen through 2 k + 1
    sigma points, without a single evaluation of the likelihood. For any other, the log-likelihood is fitted by a
    parabola through the sigma points (exact where it is one); this costs 1 + 2 k + k (k - 1) / 2 likelihoods a
    particle, and only its downward curvature is believed.

    Assumes A and D of the sources, and Gaussian system noise; it never looks at the detector. Cost: N likelihoods (and
    those of the fit, where it is needed), N transition densities.

    Attributes:
        n_particles: N.
        defence: the share of particles drawn from the dynamics.
        resampling: "systematic", "stratified", "residual" or "multinomial".
        ess_threshold: resample only when the ESS falls below this share of N; 1 resamples always.
    """

    n_particles: int = 400
    defence: float = 0.1
    resampling: str = "systematic"
    ess_threshold: float = 1.0

    def __post_init__(self) -> None:
        steps.check_settings(self.n_particles, self.resampling, self.ess_threshold)
        steps.check_share("defence", self.defence)

    def initial(self, rng: np.random.Generator, model: Model) -> ParticleSet:
        return steps.sample_prior(rng, model, self.n_particles)

    def step(self, rng: np.random.Generator, model: Model, particles: ParticleSet, observation: Any) -> StepRecord:
        streams = Streams(rng)
        if is_missing(observation):
            return steps.predict_only(streams, model, particles, observation)
        n, k = len(particles), model.dynamics.dimension

        resampled = steps.resample(streams, particles, self.resampling, self.ess_threshold)
        states = resampled.particles.states
        guides, evaluations = _guides(model, states, observation)
        z, log_ratio = guides.draw(streams, self.defence)
        factor = cholesky_factor(model.dynamics.noise_covariance)
        innovation = model.dynamics.predict(states) + z @ factor.T
        guided = ParticleSet(shift(states, innovation), resampled.particles.log_weights)
        predicted = Stage("predict", guided, np.arange(n), resampled.histories)

        transition = model.dynamics.log_transition(innovation, states, tuple(range(k)))
        weighed = steps.weigh(
            predicted,
            {
                "likelihood": model.log_likelihood(innovation, observation),
                "transition": transition,
                "proposal": log_ratio - transition,
            },
        )
        stages = (resampled, predicted, weighed.stage)
        return StepRecord(observation, particles, stages, weighed.log_evidence, n + evaluations, n, weighed.condition)


@dataclass(frozen=True, slots=True)
class _Guides:
    """N Gaussians in coordinates where ``p(x1' | x_i)`` is standard normal.

    Attributes:
        means: ``(N, k)``.
        axes: ``(N, k, k)``, orthonormal columns.
        variances: ``(N, k)``, along the axes.
    """

    means: FloatArray
    axes: FloatArray
    variances: FloatArray

    def draw(self, streams: Streams, defence: float) -> tuple[FloatArray, FloatArray]:
        """Draws ``(N, k)``, one a particle, and the log of p(x1' | x_i) over the density that they were drawn from."""
        noise = streams.of("predict").standard_normal(self.means.shape)
        plain = streams.of("choose").random(len(noise)) < defence
        guided = self.means + np.einsum("nab,nb->na", self.axes, np.sqrt(self.variances) * noise)
        z = np.where(plain[:, None], noise, guided)
        deviations = np.einsum("nab,na->nb", self.axes, z - self.means)
        log_guide = -0.5 * np.sum(deviations**2 / self.variances + np.log(self.variances), axis=1)
        log_ratio = log_guide + 0.5 * np.sum(z**2, axis=1)
        with np.errstate(divide="ignore"):
            log_guided, log_plain = np.log([1.0 - defence, defence])
        return z, -np.logaddexp(log_guided + log_ratio, log_plain)


def _guides(model: Model, states: FloatArray, observation: Any) -> tuple[_Guides, int]:
    """The Gaussians, and how many likelihoods they cost."""
    means = model.dynamics.predict(states)
    factor = cholesky_factor(model.dynamics.noise_covariance)
    function = getattr(model, "observation_function", None)
    if function is not None:
        return _from_observation_function(means, factor, function, np.ravel(observation)), 0
    return _from_log_likelihood(means, factor, lambda x: model.log_likelihood(x, observation))


def _at(points: FloatArray, means: FloatArray, factor: FloatArray) -> FloatArray:
    """``(N m, k)``: the innovations at ``points (m, k)`` of the standard coordinates about each of ``means (N, k)``."""
    return (means[:, None] + points @ factor.T).reshape(-1, means.shape[1])


def _from_observation_function(
    means: FloatArray,
    factor: FloatArray,
    function: ObservationFunction,
    observation: FloatArray,
) -> _Guides:
    """The update of the unscented Kalman filter, with 2 k + 1 sigma points."""
    n, k = means.shape
    kappa = max(3.0 - k, 0.0)
    points = np.sqrt(k + kappa) * np.concatenate([np.zeros((1, k)), np.eye(k), -np.eye(k)])
    weights = np.append(kappa, np.full(2 * k, 0.5)) / (k + kappa)
    seen = function.expected(_at(points, means, factor)).reshape(n, len(points), -1)
    forecast = np.einsum("j,njm->nm", weights, seen)
    deviations = seen - forecast[:, None]
    covariance = np.einsum("j,nja,njb->nab", weights, deviations, deviations) + function.covariance
    cross = np.einsum("j,jk,njm->nkm", weights, points, deviations)
    gain = np.linalg.solve(covariance, cross.transpose(0, 2, 1)).transpose(0, 2, 1)
    shifts = np.einsum("nkm,nm->nk", gain, observation - forecast)
    variances, axes = np.linalg.eigh(np.eye(k) - gain @ cross.transpose(0, 2, 1))
    return _Guides(shifts, axes, np.clip(variances, *_WIDTH_RANGE))


def _from_log_likelihood(
    means: FloatArray, factor: FloatArray, log_likelihood: Callable[[FloatArray], FloatArray]
) -> tuple[_Guides, int]:
    """A parabola through the log-likelihood at 0, at one deviation either way along each axis, and at pairs of them."""
    n, k = means.shape
    first, second = np.triu_indices(k, 1)
    units = np.eye(k)
    points = np.concatenate([np.zeros((1, k)), units, -units, units[first] + units[second]])
    raw = log_likelihood(_at(points, means, factor))
    steps.check_log_factor("likelihood", raw, raw.size)
    values = raw.reshape(n, len(points))
    peaks = np.maximum(values.max(axis=1, keepdims=True), -1e300)
    values = np.where(np.isneginf(values), _NOWHERE, values - peaks)
    centre, ahead, behind, both = np.split(values, [1, 1 + k, 1 + 2 * k], axis=1)
    gradient = 0.5 * (ahead - behind)
    curvature = np.zeros((n, k, k))
    curvature[:, range(k), range(k)] = 2.0 * centre - ahead - behind
    curvature[:, first, second] = ahead[:, first] + ahead[:, second] - both - centre
    curvature[:, second, first] = curvature[:, first, second]
    sharpness, axes = np.linalg.eigh(curvature)
    slopes = np.einsum("nab,na->nb", axes, gradient)
    # Where the parabola opens upward it says nothing of a peak: no further than it was looked at.
    steps_along = np.where(sharpness > 0.0, slopes / (1.0 + np.maximum(sharpness, 0.0)), np.clip(slopes, -1.0, 1.0))
    shifts = np.einsum("nab,nb->na", axes, steps_along)
    variances = np.clip(1.0 / (1.0 + np.maximum(sharpness, 0.0)), *_WIDTH_RANGE)
    return _Guides(shifts, axes, variances), values.size
