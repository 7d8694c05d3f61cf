"""Intervals, and what may be claimed from them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from pfviz.particles import FloatArray

Z_95 = 1.959964
"""Standard deviations either side of the mean of a Gaussian that hold 95 % of it."""

FEWEST = 5
"""Fewer runs than this decide nothing: their scatter is hardly known."""

Order = Literal["less", "greater", "undecided"]


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value with an interval of about 95 %.

    Attributes:
        value: NaN when nothing was measured.
        low: the lower end.
        high: the upper end.
        count: how many measurements there were.
    """

    value: float
    low: float
    high: float
    count: int

    def __str__(self) -> str:
        return f"{self.value:.3g} [{self.low:.3g}, {self.high:.3g}]"


def wilson(successes: int, count: int, z: float = Z_95) -> Estimate:
    """The share of successes with its Wilson score interval (Wilson 1927), which works for 0 and 1 too.

    Raises:
        ValueError: if there are more successes than trials, or fewer than none.
    """
    if not 0 <= successes <= count:
        raise ValueError(f"successes must be between 0 and count={count}, got {successes}")
    if count == 0:
        return Estimate(float("nan"), 0.0, 1.0, 0)
    share = successes / count
    centre = (share + z * z / (2 * count)) / (1 + z * z / count)
    half = z / (1 + z * z / count) * np.sqrt(share * (1 - share) / count + z * z / (4 * count * count))
    return Estimate(
        share, float(min(max(0.0, centre - half), share)), float(max(min(1.0, centre + half), share)), count
    )


def mean_of(values: Iterable[float | None], confidence: float = 0.95) -> Estimate:
    """The mean with Student's interval; None and NaN are left out. The interval of a single value is open."""
    from scipy.special import stdtrit

    present = np.array([value for value in values if value is not None and np.isfinite(value)], dtype=float)
    count = len(present)
    if count == 0:
        return Estimate(float("nan"), float("-inf"), float("inf"), 0)
    mean = float(present.mean())
    if count == 1:
        return Estimate(mean, float("-inf"), float("inf"), 1)
    half = float(stdtrit(count - 1, 0.5 + 0.5 * confidence) * present.std(ddof=1) / np.sqrt(count))
    return Estimate(mean, mean - half, mean + half, count)


def paired_difference(
    first: Mapping[Any, float | None], second: Mapping[Any, float | None], confidence: float = 0.95
) -> Estimate:
    """The mean of ``first[k] - second[k]`` over the runs k in which both were measured."""
    pairs = [(value, second.get(key)) for key, value in first.items()]
    return mean_of([a - b for a, b in pairs if a is not None and b is not None], confidence)


def rank_correlation(first: Sequence[float], second: Sequence[float], z: float = Z_95) -> Estimate:
    """Spearman's rank correlation of pairs, with Fisher's interval (Bonett & Wright 2000); open for fewer than four."""
    ranks = [_ranks(np.asarray(values, dtype=float)) for values in (first, second)]
    count = len(ranks[0])
    if count < 2 or min(values.std() for values in ranks) == 0.0:
        return Estimate(float("nan"), -1.0, 1.0, count)
    value = float(np.corrcoef(ranks[0], ranks[1])[0, 1])
    if count < 4:
        return Estimate(value, -1.0, 1.0, count)
    middle, half = np.arctanh(np.clip(value, -0.9999, 0.9999)), z * np.sqrt((1.0 + value**2 / 2.0) / (count - 3))
    return Estimate(value, float(np.tanh(middle - half)), float(np.tanh(middle + half)), count)


def _ranks(values: FloatArray) -> FloatArray:
    """Ranks from 1; equal values have the mean of theirs."""
    _, place, counts = np.unique(values, return_inverse=True, return_counts=True)
    return (np.cumsum(counts) - 0.5 * (counts - 1))[place]


def sign_of(difference: Estimate) -> Order:
    """What a difference says of the first against the second.

    Only an interval on one side of zero decides, and only if it comes from at least five runs.
    """
    if difference.count < FEWEST:
        return "undecided"
    if difference.high < 0.0:
        return "less"
    return "greater" if difference.low > 0.0 else "undecided"


def order_of(first: Estimate, second: Estimate) -> Order:
    """Whether the first of two independent estimates is less or greater; intervals that overlap decide nothing."""
    if first.high < second.low:
        return "less"
    return "greater" if first.low > second.high else "undecided"
