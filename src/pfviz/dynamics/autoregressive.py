"""Autoregressive dynamics of any order and dimension, with Gaussian noise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from pfviz.model import Components
from pfviz.particles import FloatArray, readonly


def cholesky_factor(covariance: FloatArray, name: str = "covariance") -> FloatArray:
    """The lower Cholesky factor of ``covariance``.

    Raises:
        ValueError: if the matrix is not square, symmetric and positive definite.
    """
    if covariance.ndim != 2 or covariance.shape[0] != covariance.shape[1]:
        raise ValueError(f"{name} must be a square matrix, got shape {covariance.shape}")
    if not np.isfinite(covariance).all() or not is_symmetric(covariance):
        raise ValueError(f"{name} must be symmetric and finite, got {covariance.tolist()}")
    try:
        return np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
    except np.linalg.LinAlgError:
        raise ValueError(f"{name} must be positive definite, got {covariance.tolist()}") from None


def is_symmetric(matrix: FloatArray) -> bool:
    """Whether a matrix equals its transpose, up to what rounding leaves relative to its diagonal."""
    scale = np.sqrt(np.abs(np.diag(matrix)))
    return bool(np.all(np.abs(matrix - matrix.T) <= 1e-9 * np.outer(scale, scale)))


def log_gaussian(deviations: FloatArray, factor: FloatArray) -> FloatArray:
    """``(N,)``: log N(deviation; 0, L L^T) for ``deviations (N, d)`` and the Cholesky factor ``L (d, d)``."""
    whitened = np.linalg.inv(factor) @ deviations.T
    constant = 0.5 * len(factor) * np.log(2.0 * np.pi) + np.log(np.diag(factor)).sum()
    return -0.5 * np.einsum("dn,dn->n", whitened, whitened) - constant


@dataclass(frozen=True)
class Autoregression:
    """``x_t - m = sum_j A_j (x_{t-j} - m) + e_t`` with Gaussian e_t of full covariance (equation 4 of the sources).

    With a mean, this is the constrained autoregression of Odobez' lecture. The sampled part of an innovation is
    completed from the Gaussian conditional p(v | u, x), so correlated noise is used, not only independent components.

    Attributes:
        coefficients: ``(p, k, k)``, A_1 to A_p.
        noise_covariance: ``(k, k)``, of e_t.
        mean: ``(k,)``, the m above; zero by default.

    Raises:
        ValueError: if shapes disagree or the covariance is not symmetric positive definite.
    """

    coefficients: FloatArray
    noise_covariance: FloatArray
    mean: FloatArray | None = None

    def __post_init__(self) -> None:
        coefficients, covariance = readonly(self.coefficients), readonly(self.noise_covariance)
        if coefficients.ndim != 3 or coefficients.shape[1] != coefficients.shape[2] or not len(coefficients):
            raise ValueError(f"coefficients must have shape (p, k, k), got {coefficients.shape}")
        if not np.isfinite(coefficients).all():
            raise ValueError("coefficients must be finite, got NaN or infinity")
        k = coefficients.shape[1]
        if covariance.shape != (k, k):
            raise ValueError(f"noise_covariance must have shape {(k, k)}, got {covariance.shape}")
        mean = readonly(np.zeros(k) if self.mean is None else self.mean)
        if mean.shape != (k,) or not np.isfinite(mean).all():
            raise ValueError(f"mean must be {k} finite numbers, got {mean.tolist()}")
        object.__setattr__(self, "coefficients", coefficients)
        object.__setattr__(self, "noise_covariance", covariance)
        object.__setattr__(self, "mean", mean)
        object.__setattr__(self, "_factor", cholesky_factor(covariance, "noise_covariance"))

    @classmethod
    def scalar(cls, coefficients: ArrayLike, noise: float, mean: float = 0.0) -> Autoregression:
        """A one-dimensional autoregression from p numbers and the standard deviation of its noise."""
        values = np.atleast_1d(np.asarray(coefficients, dtype=float))
        return cls(values[:, None, None], np.array([[noise**2]]), np.array([mean]))

    @property
    def order(self) -> int:
        return self.coefficients.shape[0]

    @property
    def dimension(self) -> int:
        return self.coefficients.shape[1]

    @property
    def noise_factor(self) -> FloatArray:
        """``(k, k)``: the lower Cholesky factor of the noise covariance."""
        return self._factor  # type: ignore[attr-defined]

    @cached_property
    def offset(self) -> FloatArray:
        """``(k,)``: the constant (I - sum_j A_j) m."""
        mean = np.asarray(self.mean)
        return mean - self.coefficients.sum(axis=0) @ mean

    @cached_property
    def companion(self) -> FloatArray:
        """``(p k, p k)``: the transition matrix of the stacked state ``(x_t, x_{t-1}, ...)``."""
        p, k = self.order, self.dimension
        matrix = np.eye(p * k, k=-k)
        matrix[:k] = np.concatenate(self.coefficients, axis=1)
        return matrix

    def with_noise(self, factor: float) -> Autoregression:
        """The same dynamics with the standard deviation of the noise multiplied by ``factor``."""
        return replace(self, noise_covariance=self.noise_covariance * factor**2)

    def predict(self, states: FloatArray) -> FloatArray:
        """``(N, k)``: the mean of p(x1' | x) for each of ``states (N, p, k)``."""
        stacked = states.reshape(len(states), -1)
        return stacked @ self.companion[: self.dimension].T + self.offset

    def sample(self, rng: np.random.Generator, states: FloatArray) -> FloatArray:
        """``(N, k)``: one draw of p(x1' | x) for each of ``states (N, p, k)``."""
        noise = rng.standard_normal((len(states), self.dimension))
        return self.predict(states) + noise @ self.noise_factor.T

    def complete(
        self, rng: np.random.Generator, proposed: FloatArray, states: FloatArray, components: Components
    ) -> FloatArray:
        """``(N, k)``: whole innovations, with v ~ p(v | u, x), the Gaussian conditional (Table 4, step 3)."""
        rest = [i for i in range(self.dimension) if i not in components]
        innovation = np.empty((len(proposed), self.dimension))
        innovation[:, components] = proposed
        if rest:
            gain, factor = self._conditional(tuple(components))
            mean = self.predict(states)
            noise = rng.standard_normal((len(proposed), len(rest)))
            innovation[:, rest] = mean[:, rest] + (proposed - mean[:, components]) @ gain.T + noise @ factor.T
        return innovation

    def _conditional(self, components: Components) -> tuple[FloatArray, FloatArray]:
        """Of p(v | u): the gain on u, the ``components``, and the Cholesky factor of the covariance of the rest, v."""
        if components not in self._conditionals:
            u, covariance = list(components), self.noise_covariance
            rest = [i for i in range(self.dimension) if i not in u]
            gain = np.asarray(np.linalg.solve(covariance[np.ix_(u, u)], covariance[np.ix_(u, rest)]).T, dtype=float)
            conditional = covariance[np.ix_(rest, rest)] - gain @ covariance[np.ix_(u, rest)]
            self._conditionals[components] = gain, np.asarray(np.linalg.cholesky(conditional), dtype=float)
        return self._conditionals[components]

    @cached_property
    def _conditionals(self) -> dict[Components, tuple[FloatArray, FloatArray]]:
        return {}

    def log_transition(self, proposed: FloatArray, states: FloatArray, components: Components) -> FloatArray:
        """``(N,)``: log p(u_i | x_i), one by one, for the ``components`` given."""
        chosen = list(components)
        factor = cholesky_factor(self.noise_covariance[np.ix_(chosen, chosen)])
        return log_gaussian(proposed - self.predict(states)[:, chosen], factor)

    def stationary_covariance(self) -> FloatArray:
        """``(p k, p k)``: the covariance of the stacked state in the long run.

        Raises:
            ValueError: if the process is not stable.
        """
        if np.abs(np.linalg.eigvals(self.companion)).max() >= 1.0:
            raise ValueError("the autoregression is not stable, so it has no stationary covariance")
        from scipy.linalg import solve_discrete_lyapunov

        noise = np.zeros_like(self.companion)
        noise[: self.dimension, : self.dimension] = self.noise_covariance
        return solve_discrete_lyapunov(self.companion, noise)
