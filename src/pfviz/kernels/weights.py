"""Weights: normalising their logarithms, and systematic resampling, each in one or two passes."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pfviz.kernels.arrays import checked
from pfviz.kernels.backend import compiled

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class NormalisedWeights(NamedTuple):
    """Weights that sum to one.

    Attributes:
        log_weights: ``(N,)``.
        weights: ``(N,)``, their exponentials.
        log_sum: the logarithm of the sum before.
        effective_sample_size: ``1 / sum(weights**2)``, from 1 to N (Kong, Liu & Wong 1994).
    """

    log_weights: FloatArray
    weights: FloatArray
    log_sum: float
    effective_sample_size: float


def normalise_log_weights(log_weights: ArrayLike) -> NormalisedWeights:
    """Normalise weights given by their logarithms, ``(N,)``; minus infinity is a weight of zero.

    Raises:
        ValueError: if a log-weight is NaN or plus infinity, or all are minus infinity.
    """
    raw, peak = _checked_log_weights(log_weights)
    kernels = compiled()
    if kernels is None:
        return _normalise_numpy(raw, peak)
    normalised, weights = np.empty_like(raw), np.empty_like(raw)
    log_sum, effective = kernels.normalise_log_weights(raw, peak, normalised, weights)
    return NormalisedWeights(normalised, weights, log_sum, effective)


def normalise_log_weights_numpy(log_weights: ArrayLike) -> NormalisedWeights:
    """As ``normalise_log_weights``, in plain NumPy."""
    return _normalise_numpy(*_checked_log_weights(log_weights))


def systematic_ancestors(weights: ArrayLike, offset: float, count: int | None = None) -> IntArray:
    """Systematic resampling: the particles whose shares of [0, M) hold the points ``0 + offset``, ``1 +
    offset``, ....

    A weight of zero is never picked. The weights need not sum to one.

    Args:
        weights: ``(N,)``, not negative, not all zero.
        offset: in [0, 1), the one random number.
        count: M; by default N.

    Returns:
        ``(M,)``, increasing.

    Raises:
        ValueError: if a weight is negative, NaN or infinite, all are zero, or the offset or the count is out
            of range.
    """
    array, m = _checked_resampling(weights, offset, count)
    kernels = compiled()
    if kernels is None:
        return _systematic_numpy(array, offset, m)
    ancestors = np.empty(m, dtype=np.int64)
    if not kernels.systematic_ancestors(array, float(offset), ancestors):
        raise _bad_weights(array)
    return ancestors


def systematic_ancestors_numpy(weights: ArrayLike, offset: float, count: int | None = None) -> IntArray:
    """As ``systematic_ancestors``, in plain NumPy."""
    array, m = _checked_resampling(weights, offset, count)
    return _systematic_numpy(array, offset, m)


def _checked_log_weights(log_weights: ArrayLike) -> tuple[FloatArray, float]:
    raw = checked("log_weights", log_weights, (None,))
    if len(raw) == 0:
        raise ValueError("log_weights must have at least one entry")
    return raw, checked_peak(raw)


def checked_peak(log_weights: FloatArray) -> float:
    """The largest log-weight.

    Raises:
        ValueError: if a log-weight is NaN or plus infinity, or all are minus infinity.
    """
    peak = float(log_weights.max())
    if math.isnan(peak) or peak == math.inf:
        raise ValueError(f"log_weights must be numbers or minus infinity, got {peak}")
    if peak == -math.inf:
        raise ValueError("log_weights are all minus infinity: every weight is zero")
    return peak


def _normalise_numpy(raw: FloatArray, peak: float) -> NormalisedWeights:
    weights = np.exp(raw - peak)
    total = float(weights.sum())
    weights /= total
    log_sum = peak + math.log(total)
    return NormalisedWeights(raw - log_sum, weights, log_sum, 1.0 / float(weights @ weights))


def _checked_resampling(weights: ArrayLike, offset: float, count: int | None) -> tuple[FloatArray, int]:
    array = checked("weights", weights, (None,))
    if not 0.0 <= offset < 1.0:
        raise ValueError(f"offset must lie in [0, 1), got {offset}")
    m = len(array) if count is None else int(count)
    if m < 1:
        raise ValueError(f"the weights and the count must be at least one, got {len(array)} and {count}")
    return array, m


def _bad_weights(weights: FloatArray) -> ValueError:
    return ValueError(
        f"weights must be finite, not negative, and not all zero or almost, got a sum of {weights.sum()} and "
        f"a smallest of {weights.min(initial=math.inf)}"
    )


def _systematic_numpy(weights: FloatArray, offset: float, count: int) -> IntArray:
    cumulative = np.cumsum(weights)
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        scale = count / cumulative[-1] if len(weights) else math.nan
    if not (0.0 < scale < math.inf and weights.min() >= 0.0):
        raise _bad_weights(weights)
    points_below = np.ceil(cumulative * scale - offset).astype(np.int64)
    np.minimum(points_below, count, out=points_below)
    points_below[np.flatnonzero(weights)[-1] :] = count
    return np.repeat(np.arange(len(weights)), np.diff(points_below, prepend=0))
