"""Particle sets: weights in log space, moments, and what is refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pfviz.particles import ParticleSet, effective_sample_size, log_sum_exp, readonly

log_values = arrays(
    float,
    st.integers(1, 30),
    elements=st.one_of(st.just(-np.inf), st.floats(-1e5, 1e5), st.floats(-3.0, 3.0)),
)


def normalised(values: np.ndarray) -> np.ndarray:
    return values - log_sum_exp(values)


@given(log_values, st.floats(-1e6, 1e6))
def test_log_sum_exp_moves_with_its_arguments(values, shift):
    moved = log_sum_exp(values + shift)
    assert moved == pytest.approx(log_sum_exp(values) + shift, rel=1e-9, abs=1e-6)


def test_log_sum_exp_where_exponentials_overflow_or_vanish():
    assert log_sum_exp(np.array([1000.0, 1000.0])) == pytest.approx(1000.0 + np.log(2.0))
    assert log_sum_exp(np.array([-2000.0, -np.inf])) == -2000.0
    assert log_sum_exp(np.array([-np.inf, -np.inf])) == -np.inf


@given(log_values.filter(lambda v: np.isfinite(v).any()))
def test_effective_sample_size_lies_between_one_and_all(values):
    size = effective_sample_size(normalised(values))
    assert 1.0 - 1e-9 <= size <= np.isfinite(values).sum() * (1 + 1e-9)


@pytest.mark.parametrize("n", [1, 2, 7])
def test_effective_sample_size_of_equal_and_of_lonely_weights(n):
    assert effective_sample_size(np.full(n, -np.log(n))) == pytest.approx(n)
    lonely = np.full(n, -np.inf)
    lonely[-1] = 0.0
    assert effective_sample_size(lonely) == pytest.approx(1.0)


@given(log_values.filter(lambda v: np.isfinite(v).any()), st.integers(1, 3), st.integers(0, 2**31))
def test_moments_are_those_of_the_weighted_innovations(values, dimension, seed):
    states = np.random.default_rng(seed).normal(3.0, 2.0, (len(values), 2, dimension))
    particles = ParticleSet(states, normalised(values))
    mean = np.average(states[:, 0], axis=0, weights=particles.weights)
    covariance = np.cov(states[:, 0].T, aweights=particles.weights, ddof=0).reshape(dimension, dimension)
    np.testing.assert_allclose(particles.mean, mean, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(particles.covariance, covariance, rtol=1e-9, atol=1e-9)
    assert (particles.innovation == states[:, 0]).all() and (particles.history == states[:, 1:]).all()


def test_taking_gives_equal_weights():
    particles = ParticleSet(np.arange(6.0).reshape(3, 2, 1), np.log([0.5, 0.25, 0.25]))
    taken = particles.take(np.array([2, 2, 0, 1]))
    assert taken.states[:, 0, 0].tolist() == [4.0, 4.0, 0.0, 2.0]
    np.testing.assert_allclose(taken.weights, 0.25)


def test_arrays_cannot_be_written_to():
    states = np.zeros((2, 1, 1))
    particles = ParticleSet.uniform(states)
    with pytest.raises(ValueError, match="read-only"):
        particles.states[0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        particles.log_weights[0] = 1.0


def test_readonly_copies_only_what_it_must():
    array = np.zeros(3)
    assert np.shares_memory(readonly(array), array)
    assert array.flags.writeable
    assert readonly([1, 2]).dtype == np.float64


@pytest.mark.parametrize(
    ("states", "log_weights", "message"),
    [
        (np.zeros((2, 1)), np.log([0.5, 0.5]), "shape"),
        (np.zeros((0, 1, 1)), np.zeros(0), "N >= 1"),
        (np.zeros((2, 1, 1)), np.zeros(1), "log_weights must have shape"),
        (np.full((2, 1, 1), np.nan), np.log([0.5, 0.5]), "finite"),
        (np.zeros((2, 1, 1)), np.log([0.5, 0.6]), "normalised"),
        (np.zeros((2, 1, 1)), np.array([np.nan, 0.0]), "normalised"),
        (np.zeros((2, 1, 1)), np.full(2, -np.inf), "normalised"),
    ],
)
def test_what_is_not_a_particle_set_is_refused(states, log_weights, message):
    with pytest.raises(ValueError, match=message):
        ParticleSet(states, log_weights)
