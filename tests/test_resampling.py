"""Resampling: unbiased, and unperturbed by weights that are zero, lonely, or do not sum to one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from pfviz.resampling import RESAMPLERS, Resampler

SCHEMES = list(RESAMPLERS.values())
every_scheme = pytest.mark.parametrize("resample", SCHEMES, ids=list(RESAMPLERS))

weight_lists = st.lists(
    st.one_of(st.just(0.0), st.floats(1e-300, 1e300), st.floats(0.01, 1.0)), min_size=1, max_size=40
).filter(any)


def mean_counts(resample: Resampler, weights: np.ndarray, n: int, repeats: int) -> tuple[np.ndarray, np.ndarray]:
    """The mean number of copies of each particle, and its standard error."""
    rng = np.random.default_rng(20)
    counts = np.array([np.bincount(resample(rng, weights, n), minlength=len(weights)) for _ in range(repeats)])
    return counts.mean(axis=0), counts.std(axis=0, ddof=1) / np.sqrt(repeats)


@every_scheme
@pytest.mark.parametrize("n", [3, 7, 20])
def test_counts_are_unbiased(resample, n):
    weights = np.array([0.45, 0.0, 0.02, 0.18, 0.2, 0.0, 0.05, 0.1])
    mean, standard_error = mean_counts(resample, weights, n, repeats=6000)
    # A count that never varied over 6,000 repeats has probability below 1e-3 of varying.
    certain = standard_error == 0
    np.testing.assert_allclose(mean[certain], n * weights[certain], rtol=1e-9, atol=5e-3)
    z = (mean[~certain] - n * weights[~certain]) / standard_error[~certain]
    assert np.abs(z).max() < 4.5


def test_residual_keeps_the_certain_copies():
    weights = np.array([0.525, 0.275, 0.2])
    for seed in range(50):
        counts = np.bincount(RESAMPLERS["residual"](np.random.default_rng(seed), weights, 6), minlength=3)
        assert (counts >= [3, 1, 1]).all()


@pytest.mark.parametrize("name", ["systematic", "stratified"])
def test_counts_stay_close_to_their_expectation(name):
    weights = np.random.default_rng(1).dirichlet(np.ones(50))
    spread = {"systematic": 1.0, "stratified": 2.0}[name]
    for seed in range(100):
        counts = np.bincount(RESAMPLERS[name](np.random.default_rng(seed), weights), minlength=50)
        assert np.abs(counts - 50 * weights).max() < spread


def test_multinomial_draws_follow_the_weights():
    weights = np.array([0.5, 0.25, 0.15, 0.1])
    drawn = RESAMPLERS["multinomial"](np.random.default_rng(2), weights, 20_000)
    assert stats.chisquare(np.bincount(drawn, minlength=4), 20_000 * weights).pvalue > 1e-4


def test_multinomial_draws_are_independent_of_their_position():
    drawn = RESAMPLERS["multinomial"](np.random.default_rng(3), np.ones(2), 20_000)
    pairs = np.bincount(2 * drawn[::2] + drawn[1::2], minlength=4)
    assert stats.chisquare(pairs).pvalue > 1e-4


def test_systematic_shares_one_offset_and_stratified_does_not():
    """With n equal weights and one slice each, systematic returns everyone once whatever its offset."""
    weights = np.ones(9)
    for seed in range(20):
        np.testing.assert_array_equal(RESAMPLERS["systematic"](np.random.default_rng(seed), weights), np.arange(9))
    halves = np.ones(2)
    together = [RESAMPLERS["systematic"](np.random.default_rng(s), halves, 1)[0] for s in range(200)]
    assert 70 < sum(together) < 130
    uneven = np.array([0.25, 0.5, 0.25])
    systematic = {tuple(RESAMPLERS["systematic"](np.random.default_rng(s), uneven, 2)) for s in range(200)}
    stratified = {tuple(RESAMPLERS["stratified"](np.random.default_rng(s), uneven, 2)) for s in range(200)}
    assert systematic == {(0, 1), (1, 2)}
    assert stratified == {(0, 1), (0, 2), (1, 1), (1, 2)}


@every_scheme
@given(weights=weight_lists, n=st.integers(1, 60), seed=st.integers(0, 2**32))
def test_zero_weights_are_never_drawn(resample, weights, n, seed):
    weights = np.array(weights)
    ancestors = resample(np.random.default_rng(seed), weights, n)
    assert ancestors.dtype == np.int64 and ancestors.shape == (n,)
    assert (weights[ancestors] > 0).all()


@every_scheme
def test_the_scale_of_the_weights_does_not_matter(resample):
    weights = np.random.default_rng(4).dirichlet(np.ones(30))
    drawn = [resample(np.random.default_rng(5), weights * scale, 30) for scale in (1.0, 2.0**-1060, 2.0**900)]
    np.testing.assert_array_equal(drawn[0], drawn[2])
    assert np.mean(drawn[0] == drawn[1]) > 0.9  # subnormal weights have few digits left


class ExtremeGenerator:
    """A generator whose uniforms are all as near to an end of [0, 1) as they can be."""

    def __init__(self, value: float) -> None:
        self.value = value

    def random(self, size: int | None = None):
        return self.value if size is None else np.full(size, self.value)


@every_scheme
@pytest.mark.parametrize("uniform", [0.0, np.nextafter(1.0, 0.0)])
def test_extreme_uniforms_stay_inside(resample, uniform):
    for seed in range(200):  # rounding leaves the scaled cumulative weights now below, now above their end
        rng = np.random.default_rng(seed)
        weights = rng.random(7) * [0, 1, 1, 0, 1, 0, 0]
        n = int(rng.integers(1, 12))
        ancestors = resample(ExtremeGenerator(uniform), weights, n)
        assert ancestors.shape == (n,) and (weights[ancestors] > 0).all()


@every_scheme
def test_one_particle_and_one_hot(resample):
    rng = np.random.default_rng(6)
    np.testing.assert_array_equal(resample(rng, [0.3], 4), np.zeros(4))
    np.testing.assert_array_equal(resample(rng, [0.0, 0.0, 1.0, 0.0]), np.full(4, 2))


@every_scheme
def test_integers_as_weights_and_the_default_number(resample):
    assert resample(np.random.default_rng(7), [1, 2, 3]).shape == (3,)


@every_scheme
@pytest.mark.parametrize(
    ("weights", "n", "message"),
    [
        ([0.5, -0.1, 0.6], None, "not negative"),
        ([0.5, np.nan], None, "finite"),
        ([0.5, np.inf], None, "finite"),
        ([0.0, 0.0], None, "not all be zero"),
        ([], None, r"shape \(N,\)"),
        ([[0.5, 0.5]], None, r"shape \(N,\)"),
        ([1.0], 0, "at least 1"),
        ([1.0], 2.5, "at least 1"),
    ],
)
def test_bad_input_is_named(resample, weights, n, message):
    with pytest.raises(ValueError, match=message):
        resample(np.random.default_rng(8), weights, n)
