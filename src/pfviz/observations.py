"""How a toy world is seen: likelihoods of the innovation, each with a way to draw from it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from pfviz.dynamics.autoregressive import cholesky_factor, log_gaussian
from pfviz.particles import FloatArray, readonly


class ObservationModel(Protocol):
    """p(y | x1): to draw from and to weigh with."""

    def sample(self, rng: np.random.Generator, innovation: FloatArray) -> FloatArray:
        """One observation of the true ``innovation (k,)``."""
        ...

    def log_likelihood(self, innovation: FloatArray, observation: FloatArray) -> FloatArray:
        """``(N,)``: log p(y | x1) for ``innovation (N, k)``."""
        ...

    def with_noise(self, factor: float) -> ObservationModel:
        """The same with the standard deviation of the noise multiplied by ``factor``."""
        ...


@dataclass(frozen=True)
class GaussianObservation:
    """``y = x1 + noise``: the innovation itself, seen through Gaussian noise of ``covariance (k, k)``."""

    covariance: FloatArray

    def __post_init__(self) -> None:
        covariance = readonly(self.covariance)
        object.__setattr__(self, "covariance", covariance)
        object.__setattr__(self, "_factor", cholesky_factor(covariance, "observation covariance"))

    def sample(self, rng: np.random.Generator, innovation: FloatArray) -> FloatArray:
        return innovation + self._factor @ rng.standard_normal(len(innovation))  # type: ignore[attr-defined]

    def expected(self, innovation: FloatArray) -> FloatArray:
        """The innovation itself."""
        return innovation

    def log_likelihood(self, innovation: FloatArray, observation: FloatArray) -> FloatArray:
        return log_gaussian(innovation - observation, self._factor)  # type: ignore[attr-defined]

    def with_noise(self, factor: float) -> GaussianObservation:
        return replace(self, covariance=self.covariance * factor**2)


@dataclass(frozen=True)
class SquaredObservation:
    """``y = x1^2 + noise``, in one dimension: what is seen does not tell the sign.

    Attributes:
        covariance: ``(1, 1)``, of the noise.
    """

    covariance: FloatArray

    def __post_init__(self) -> None:
        covariance = readonly(self.covariance)
        cholesky_factor(covariance, "observation covariance")
        if covariance.shape != (1, 1):
            raise ValueError(f"observation covariance must have shape (1, 1), got {covariance.shape}")
        object.__setattr__(self, "covariance", covariance)

    def sample(self, rng: np.random.Generator, innovation: FloatArray) -> FloatArray:
        return innovation**2 + np.sqrt(self.covariance[0]) * rng.standard_normal(1)

    def expected(self, innovation: FloatArray) -> FloatArray:
        """``(N, 1)``: the square of ``innovation (N, 1)``."""
        return innovation**2

    def log_likelihood(self, innovation: FloatArray, observation: FloatArray) -> FloatArray:
        return log_gaussian(innovation**2 - observation, np.sqrt(self.covariance))

    def with_noise(self, factor: float) -> SquaredObservation:
        return replace(self, covariance=self.covariance * factor**2)


@dataclass(frozen=True)
class LookAlikes:
    """The target among things that look like it: several detections, in no order, of which one is the target's.

    The target is seen through Gaussian noise; every look-alike stands still and is seen through the same noise. Which
    detection is whose cannot be told, so ``p(y | x1) = 1/m sum_j N(y_j; x1, R)`` up to what does not depend on x1.

    Attributes:
        places: ``(m - 1, k)``, where the look-alikes are.
        covariance: ``(k, k)``, the R above.
    """

    places: FloatArray
    covariance: FloatArray

    def __post_init__(self) -> None:
        covariance = readonly(self.covariance)
        object.__setattr__(self, "places", readonly(self.places))
        object.__setattr__(self, "covariance", covariance)
        object.__setattr__(self, "_factor", cholesky_factor(covariance, "observation covariance"))

    def sample(self, rng: np.random.Generator, innovation: FloatArray) -> FloatArray:
        """``(m, k)`` detections in random order."""
        seen = np.concatenate([innovation[None], self.places])
        order = rng.permutation(len(seen))
        noise = rng.standard_normal(seen.shape) @ self._factor.T  # type: ignore[attr-defined]
        return seen[order] + noise

    def log_likelihood(self, innovation: FloatArray, observation: FloatArray) -> FloatArray:
        terms = [log_gaussian(innovation - y, self._factor) for y in observation]  # type: ignore[attr-defined]
        return np.logaddexp.reduce(terms, axis=0) - np.log(len(observation))

    def with_noise(self, factor: float) -> LookAlikes:
        return replace(self, covariance=self.covariance * factor**2)
