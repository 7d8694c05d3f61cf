"""Intervals that hold what they promise, and claims that need them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from pfviz.experiments.statistics import (
    FEWEST,
    Estimate,
    mean_of,
    order_of,
    paired_difference,
    rank_correlation,
    sign_of,
    wilson,
)


@pytest.mark.parametrize(("successes", "count"), [(0, 10), (1, 10), (7, 20), (100, 100), (3, 1000)])
def test_wilson_agrees_with_scipy(successes, count):
    ours = wilson(successes, count)
    theirs = stats.binomtest(successes, count).proportion_ci(method="wilson")
    assert ours.value == successes / count
    assert (ours.low, ours.high) == pytest.approx((theirs.low, theirs.high), abs=1e-6)


def test_nothing_tried_says_nothing():
    assert (wilson(0, 0).low, wilson(0, 0).high) == (0.0, 1.0)
    with pytest.raises(ValueError, match="between 0 and count=3, got 4"):
        wilson(4, 3)


def test_an_interval_of_a_mean_holds_it_in_95_of_100_cases():
    rng = np.random.default_rng(0)
    trials = 2000
    held = sum(e.low < 3.0 < e.high for e in (mean_of(rng.normal(3.0, 2.0, 4)) for _ in range(trials)))
    assert abs(held - 0.95 * trials) / np.sqrt(trials * 0.95 * 0.05) < 4


def test_what_was_not_measured_is_left_out_of_a_mean():
    assert mean_of([1.0, None, float("nan"), 3.0]).value == 2.0
    assert mean_of([1.0, None]).high == float("inf")
    assert mean_of([None]).count == 0


def test_pairing_takes_out_what_runs_share():
    rng = np.random.default_rng(1)
    shared = rng.normal(0.0, 100.0, 50)
    first = {k: float(s + 1.0 + e) for k, (s, e) in enumerate(zip(shared, rng.normal(0.0, 0.5, 50), strict=True))}
    second = {k: float(s) for k, s in enumerate(shared)} | {99: 1e9}
    gap = paired_difference(first, second)
    assert gap.count == 50
    assert sign_of(gap) == "greater"
    assert sign_of(paired_difference(second, first)) == "less"
    assert abs(gap.value - 1.0) < 5 * 0.5 / np.sqrt(50)


def test_an_interval_about_zero_and_too_few_runs_decide_nothing():
    assert sign_of(Estimate(0.3, -0.1, 0.7, 100)) == "undecided"
    assert sign_of(Estimate(0.3, 0.1, 0.5, FEWEST)) == "greater"
    assert sign_of(Estimate(0.3, 0.1, 0.5, FEWEST - 1)) == "undecided"


def test_overlapping_intervals_decide_nothing():
    assert order_of(wilson(2, 100), wilson(30, 100)) == "less"
    assert order_of(wilson(30, 100), wilson(2, 100)) == "greater"
    assert order_of(wilson(28, 100), wilson(30, 100)) == "undecided"
    assert order_of(wilson(30, 100), wilson(28, 100)) == "undecided"


def test_rank_correlation_agrees_with_scipy_ties_included():
    rng = np.random.default_rng(2)
    first = rng.integers(0, 6, 40).astype(float)
    second = first + rng.integers(0, 8, 40)
    ours = rank_correlation(first, second)
    assert ours.value == pytest.approx(stats.spearmanr(first, second).statistic)
    assert -1.0 < ours.low < ours.value < ours.high < 1.0
    assert rank_correlation([1.0, 2.0], [1.0, 1.0]).high == 1.0


def test_the_interval_of_a_rank_correlation_holds_zero_in_95_of_100_cases_without_one():
    rng = np.random.default_rng(3)
    trials = 1000
    held = sum(e.low < 0.0 < e.high for e in (rank_correlation(*rng.random((2, 12))) for _ in range(trials)))
    assert held / trials > 0.95 - 4 * np.sqrt(0.95 * 0.05 / trials)
    assert held < trials
