"""What innovations are drawn from, each with the density that it is drawn from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pfviz.dynamics.autoregressive import cholesky_factor, log_gaussian
from pfviz.model import Components
from pfviz.particles import FloatArray, readonly


@dataclass(frozen=True)
class GaussianMixture:
    """A mixture of Gaussians with one covariance, such as a detector with several answers gives.

    Attributes:
        means: ``(m, d)``, the centres of the bumps.
        covariance: ``(d, d)``, of every bump.
        weights: ``(m,)``, normalised here; equal by default.
        components: the components of the innovation that are proposed; the first d by default.

    Raises:
        ValueError: if shapes disagree, a mean is not finite, a weight is negative, the components do not increase, or
            the covariance is not positive definite.
    """

    means: FloatArray
    covariance: FloatArray
    weights: FloatArray | None = None
    components: Components = ()

    def __post_init__(self) -> None:
        means, covariance = readonly(self.means), readonly(self.covariance)
        if means.ndim != 2 or not len(means):
            raise ValueError(f"means must have shape (m, d) with m >= 1, got {means.shape}")
        if not np.isfinite(means).all():
            raise ValueError("means must be finite, got NaN or infinity")
        m, d = means.shape
        weights = np.ones(m) if self.weights is None else np.asarray(self.weights, dtype=float)
        if weights.shape != (m,) or not (weights >= 0).all() or not 0 < weights.sum() < np.inf:
            raise ValueError(f"weights must be {m} non-negative numbers, not all zero, got {weights.tolist()}")
        components = self.components or tuple(range(d))
        if len(components) != d or covariance.shape != (d, d):
            raise ValueError(f"means are {d}-dimensional, covariance {covariance.shape}, components {components}")
        if sorted(set(components)) != list(components):
            raise ValueError(f"components must be increasing, got {components}")
        object.__setattr__(self, "means", means)
        object.__setattr__(self, "covariance", covariance)
        object.__setattr__(self, "weights", readonly(weights / weights.sum()))
        object.__setattr__(self, "components", components)
        object.__setattr__(self, "_factor", cholesky_factor(covariance))

    def sample(self, rng: np.random.Generator, count: int) -> FloatArray:
        """``(count, d)`` draws."""
        cumulative = np.cumsum(np.asarray(self.weights))  # what rng.choice does, without its checks
        bumps = np.searchsorted(cumulative / cumulative[-1], rng.random(count), side="right")
        noise = rng.standard_normal((count, self.means.shape[1]))
        return self.means[bumps] + noise @ self._factor.T  # type: ignore[attr-defined]

    def log_density(self, proposed: FloatArray) -> FloatArray:
        """``(N,)``: the log-density at ``proposed (N, d)``."""
        deviations = proposed - self.means[:, None]
        factor: FloatArray = self._factor  # type: ignore[attr-defined]
        with np.errstate(divide="ignore"):
            log_weights = np.log(np.asarray(self.weights))
        bumps = log_gaussian(deviations.reshape(-1, deviations.shape[2]), factor).reshape(deviations.shape[:2])
        return np.logaddexp.reduce(bumps + log_weights[:, None], axis=0)
