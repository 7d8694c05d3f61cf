"""Weighted particle sets, in log space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def readonly(array: ArrayLike) -> FloatArray:
    """A contiguous float64 copy or view of ``array`` that cannot be written to."""
    result = np.ascontiguousarray(array, dtype=np.float64)
    if result.flags.writeable:
        result = result.view()
        result.flags.writeable = False
    return result


def log_sum_exp(log_values: FloatArray) -> float:
    """``log(sum(exp(log_values)))`` without overflow; minus infinity where every value is."""
    peak = float(np.max(log_values))
    if not np.isfinite(peak):
        return peak
    return peak + float(np.log(np.sum(np.exp(log_values - peak))))


def effective_sample_size(log_weights: FloatArray) -> float:
    """Kish's effective sample size ``1 / sum(w_i^2)`` of normalised log-weights, between 1 and N."""
    weights = np.exp(log_weights)
    return float(1.0 / np.sum(weights * weights))


@dataclass(frozen=True, slots=True)
class ParticleSet:
    """N weighted hypotheses about the state of an order-p autoregression in R^k.

    The state splits into the *innovation* ``x1 = states[:, 0]``, which evolves stochastically, and the *history*
    ``x2 = states[:, 1:]``, which is shifted (Assumption A of Torma & Szepesvari). A set whose particles have been
    proposed but not yet joined to a history has order 1 and may hold the proposed components only.

    Attributes:
        states: ``(N, p, k)``, newest first.
        log_weights: ``(N,)``, normalised: their exponentials sum to one. Minus infinity is a weight of zero.

    Raises:
        ValueError: if the shapes disagree, a state is not finite, or the weights are not normalised.
    """

    states: FloatArray
    log_weights: FloatArray

    def __post_init__(self) -> None:
        states, log_weights = readonly(self.states), readonly(self.log_weights)
        if states.ndim != 3 or states.shape[0] == 0:
            raise ValueError(f"states must have shape (N, p, k) with N >= 1, got {states.shape}")
        if log_weights.shape != states.shape[:1]:
            raise ValueError(f"log_weights must have shape {states.shape[:1]}, got {log_weights.shape}")
        if not np.isfinite(states).all():
            raise ValueError("states must be finite, got NaN or infinity")
        total = float(np.sum(np.exp(log_weights)))
        if not abs(total - 1.0) < 1e-6:
            raise ValueError(f"log_weights must be normalised, but the weights sum to {total}")
        object.__setattr__(self, "states", states)
        object.__setattr__(self, "log_weights", log_weights)

    @classmethod
    def uniform(cls, states: ArrayLike) -> ParticleSet:
        """A set of equally weighted particles with ``states`` of shape ``(N, p, k)``."""
        states = readonly(states)
        return cls(states, np.full(len(states), -np.log(max(len(states), 1))))

    def __len__(self) -> int:
        return len(self.states)

    @property
    def order(self) -> int:
        return self.states.shape[1]

    @property
    def dimension(self) -> int:
        return self.states.shape[2]

    @property
    def innovation(self) -> FloatArray:
        """``(N, k)``: the newest block of each state, x1."""
        return self.states[:, 0]

    @property
    def history(self) -> FloatArray:
        """``(N, p - 1, k)``: the older blocks of each state, x2."""
        return self.states[:, 1:]

    @property
    def weights(self) -> FloatArray:
        """``(N,)``, summing to one."""
        return np.exp(self.log_weights)

    @property
    def effective_sample_size(self) -> float:
        return effective_sample_size(self.log_weights)

    @property
    def mean(self) -> FloatArray:
        """``(k,)``: the weighted mean of the innovation."""
        return self.weights @ self.innovation

    @property
    def covariance(self) -> FloatArray:
        """``(k, k)``: the weighted covariance of the innovation."""
        weights = self.weights
        centred = self.innovation - weights @ self.innovation
        return (weights[:, None] * centred).T @ centred

    def take(self, indices: IntArray) -> ParticleSet:
        """Equally weighted copies of the particles at ``indices``, as after resampling."""
        return ParticleSet.uniform(np.take(self.states, indices, axis=0))

    def reweighted(self, log_weights: FloatArray) -> ParticleSet:
        """The same particles under other normalised log-weights."""
        return ParticleSet(self.states, log_weights)
