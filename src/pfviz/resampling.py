"""Resampling schemes: which particles survive, and how often.

A scheme draws ``n`` ancestors so that particle i is expected ``n * w_i`` times (it is *unbiased*). The
schemes differ in the spread of those counts (Douc, Cappé & Moulines 2005):

- ``multinomial``: independent draws, the largest spread;
- ``residual``: ``floor(n * w_i)`` copies for certain, the rest drawn (Liu & Chen 1998);
- ``stratified``: one draw in each of n equal slices of the cumulative weights (Kitagawa 1996);
- ``systematic``: the same, all slices sharing one random number (Kitagawa 1996; Carpenter et al. 1999).

Weights need not sum to one. A particle of weight zero is never drawn. ``stratified`` and ``systematic`` cost
O(N + n) and return the ancestors in increasing order.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class Resampler(Protocol):
    """Draws ``n`` ancestors, by default as many as there are weights."""

    def __call__(self, rng: np.random.Generator, weights: ArrayLike, n: int | None = None) -> IntArray: ...


def _checked(weights: ArrayLike, n: int | None) -> tuple[FloatArray, int]:
    """Weights scaled so that the largest is one, and the number of draws."""
    array = np.asarray(weights, dtype=np.float64)
    if array.ndim != 1 or array.size == 0:
        raise ValueError(f"weights must have shape (N,) with N >= 1, got {array.shape}")
    largest, smallest = float(array.max()), float(array.min())
    if not (smallest >= 0.0 and largest < np.inf):
        raise ValueError(f"weights must be finite and not negative, got values from {smallest} to {largest}")
    if largest == 0.0:
        raise ValueError("weights must not all be zero")
    if n is None:
        return array / largest, array.size
    if not isinstance(n, (int, np.integer)) or n < 1:
        raise ValueError(f"n must be a whole number of at least 1, got {n!r}")
    return array / largest, int(n)


def _one_per_slice(weights: FloatArray, offsets: FloatArray) -> IntArray:
    """Ancestors of the points ``(m + offsets[m]) / n`` on the cumulative weights, without a search.

    Below the end c of a particle's share lie all points of the slices before c, and that of c's own slice if
    its offset is less than how far c reaches into it.
    """
    n = len(offsets)
    cumulative = np.cumsum(weights)
    scaled = cumulative * (n / cumulative[-1])
    slices = scaled.astype(np.int64)
    points_below = slices + (np.append(offsets, 1.0)[slices] < scaled - slices)
    points_below[np.flatnonzero(weights)[-1] :] = n
    return np.repeat(np.arange(len(weights)), np.diff(points_below, prepend=0))


def _independent(rng: np.random.Generator, weights: FloatArray, n: int) -> IntArray:
    cumulative = np.cumsum(weights)
    return np.searchsorted(cumulative, rng.random(n) * cumulative[-1], side="right")


def multinomial(rng: np.random.Generator, weights: ArrayLike, n: int | None = None) -> IntArray:
    """Independent draws.

    Args:
        rng: source of the random numbers.
        weights: ``(N,)``, not negative, not all zero.
        n: how many ancestors to draw; N by default.

    Returns:
        ``(n,)`` indices into ``weights``, in random order.

    Raises:
        ValueError: if a weight is negative, NaN or infinite, if all are zero, or if ``n`` is less than one.
    """
    return _independent(rng, *_checked(weights, n))


def stratified(rng: np.random.Generator, weights: ArrayLike, n: int | None = None) -> IntArray:
    """One draw in each of n equal slices of the cumulative weights.

    Arguments, result and errors as ``multinomial``.
    """
    checked, n = _checked(weights, n)
    return _one_per_slice(checked, rng.random(n))


def systematic(rng: np.random.Generator, weights: ArrayLike, n: int | None = None) -> IntArray:
    """Evenly spaced points on the cumulative weights, shifted by one draw.

    Particle i is drawn ``floor(n * w_i)`` or ``ceil(n * w_i)`` times. Arguments, result and errors as
    ``multinomial``.
    """
    checked, n = _checked(weights, n)
    return _one_per_slice(checked, np.full(n, rng.random()))


def residual(rng: np.random.Generator, weights: ArrayLike, n: int | None = None) -> IntArray:
    """``floor(n * w_i)`` copies of each for certain, the rest drawn independently from what is left.

    Arguments, result and errors as ``multinomial``.
    """
    checked, n = _checked(weights, n)
    expected = checked * (n / checked.sum())
    copies = expected.astype(np.int64)
    certain = np.repeat(np.arange(len(checked)), copies)
    rest = n - len(certain)
    if rest == 0:
        return certain
    return np.concatenate([certain, _independent(rng, expected - copies, rest)])


RESAMPLERS: dict[str, Resampler] = {
    "multinomial": multinomial,
    "residual": residual,
    "stratified": stratified,
    "systematic": systematic,
}
