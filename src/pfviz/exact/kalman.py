"""The Kalman filter: the exact posterior of a linear-Gaussian world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pfviz.dynamics import Autoregression
from pfviz.dynamics.autoregressive import cholesky_factor, is_symmetric, log_gaussian
from pfviz.particles import FloatArray, readonly


@dataclass(frozen=True, slots=True)
class Gaussian:
    """A Gaussian over the stacked state ``(x_t, x_{t-1}, ...)`` or over a part of it.

    Attributes:
        mean: ``(d,)``.
        covariance: ``(d, d)``; may be flat in some directions, so that what is known exactly can be said.

    Raises:
        ValueError: if the shapes disagree, a number is not finite, or the covariance is not symmetric or has a
            negative eigenvalue.
    """

    mean: FloatArray
    covariance: FloatArray

    def __post_init__(self) -> None:
        mean, covariance = readonly(self.mean), readonly(self.covariance)
        if mean.ndim != 1 or not len(mean):
            raise ValueError(f"mean must have shape (d,), got {mean.shape}")
        if covariance.shape != 2 * mean.shape:
            raise ValueError(f"covariance must have shape {2 * mean.shape}, got {covariance.shape}")
        if not (np.isfinite(mean).all() and np.isfinite(covariance).all()):
            raise ValueError("mean and covariance must be finite, got NaN or infinity")
        if not is_symmetric(covariance):
            raise ValueError(f"covariance must be symmetric, got {covariance.tolist()}")
        eigenvalues = np.linalg.eigvalsh(covariance)
        if eigenvalues[0] < -1e-9 * max(eigenvalues[-1], 0.0) or eigenvalues[-1] < 0.0:
            raise ValueError(f"covariance has the negative eigenvalue {eigenvalues[0]:.3g}")
        object.__setattr__(self, "mean", mean)
        object.__setattr__(self, "covariance", covariance)

    @property
    def nbytes(self) -> int:
        """How much memory the moments take."""
        return self.mean.nbytes + self.covariance.nbytes

    def leading(self, dimension: int) -> Gaussian:
        """The marginal of the first ``dimension`` components: of the innovation, when that is its dimension."""
        return Gaussian(self.mean[:dimension], self.covariance[:dimension, :dimension])

    def log_density(self, points: FloatArray) -> FloatArray:
        """``(N,)``: the log-density at ``points (N, d)``."""
        return log_gaussian(points - self.mean, cholesky_factor(self.covariance))

    def sample(self, rng: np.random.Generator, count: int) -> FloatArray:
        """``(count, d)`` draws."""
        noise = rng.standard_normal((count, len(self.mean)))
        try:
            factor = np.linalg.cholesky(self.covariance)
        except np.linalg.LinAlgError:
            eigenvalues, vectors = np.linalg.eigh(self.covariance)
            factor = vectors * np.sqrt(np.maximum(eigenvalues, 0.0))
        return self.mean + noise @ factor.T


@dataclass(frozen=True, slots=True)
class KalmanStep:
    """One step: the predictive and the posterior over the stacked state, and log p(y_t | y_1:t-1)."""

    predictive: Gaussian
    posterior: Gaussian
    log_evidence: float


def kalman_predict(dynamics: Autoregression, state: Gaussian) -> Gaussian:
    """p(x_{t+1} | y_1:t) over the stacked state, from p(x_t | y_1:t)."""
    k, transition = dynamics.dimension, dynamics.companion
    mean = transition @ state.mean
    mean[:k] += dynamics.offset
    covariance = transition @ state.covariance @ transition.T
    covariance[:k, :k] += dynamics.noise_covariance
    return Gaussian(mean, 0.5 * (covariance + covariance.T))


def kalman_step(
    dynamics: Autoregression, observation_covariance: FloatArray, state: Gaussian, observation: FloatArray
) -> KalmanStep:
    """Predict, then update with ``y = x1 + noise``, the innovation seen through Gaussian noise.

    Args:
        dynamics: of order p in R^k.
        observation_covariance: ``(k, k)``.
        state: the posterior before, over the stacked state of dimension p k.
        observation: ``(k,)``; NaN for a missing one, which leaves the predictive as it is.
    """
    predictive = kalman_predict(dynamics, state)
    if np.isnan(observation).any():
        return KalmanStep(predictive, predictive, 0.0)
    k = dynamics.dimension
    seen = predictive.leading(k)
    total = seen.covariance + observation_covariance
    gain = np.linalg.solve(total, predictive.covariance[:k]).T
    residual = observation - seen.mean
    reduction = np.eye(len(state.mean))
    reduction[:, :k] -= gain
    covariance = reduction @ predictive.covariance @ reduction.T + gain @ observation_covariance @ gain.T
    posterior = Gaussian(predictive.mean + gain @ residual, 0.5 * (covariance + covariance.T))
    log_evidence = float(log_gaussian(residual[None], cholesky_factor(total))[0])
    return KalmanStep(predictive, posterior, log_evidence)


def kalman_filter(
    dynamics: Autoregression, observation_covariance: FloatArray, prior: Gaussian, observations: FloatArray
) -> list[KalmanStep]:
    """The steps for ``observations (T, k)``; ``prior`` is that of the stacked state at time 0."""
    steps: list[KalmanStep] = []
    for observation in observations:
        state = steps[-1].posterior if steps else prior
        steps.append(kalman_step(dynamics, observation_covariance, state, observation))
    return steps
