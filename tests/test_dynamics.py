"""Autoregressions against dense Gaussian algebra."""

from itertools import combinations

import numpy as np
import pytest
from oracles import random_dynamics, z_scores
from scipy.stats import multivariate_normal

from pfviz.dynamics import Autoregression
from pfviz.model import Dynamics

SHAPES = [(1, 1), (2, 1), (1, 2), (3, 2), (2, 3), (4, 3)]
SUBSETS = [(k, u) for k in (1, 2, 3, 4) for d in range(1, k + 1) for u in combinations(range(k), d)]


def naive_mean(dynamics: Autoregression, state: np.ndarray) -> np.ndarray:
    mean = np.asarray(dynamics.mean).copy()
    for coefficient, block in zip(dynamics.coefficients, state, strict=True):
        mean += coefficient @ (block - dynamics.mean)
    return mean


@pytest.mark.parametrize(("order", "dimension"), SHAPES)
def test_predict_is_the_sum_of_the_blocks_about_the_mean(order, dimension):
    rng = np.random.default_rng([order, dimension])
    dynamics = random_dynamics(rng, order, dimension)
    assert isinstance(dynamics, Dynamics)
    states = rng.normal(1.0, 2.0, (7, order, dimension))
    expected = np.array([naive_mean(dynamics, state) for state in states])
    np.testing.assert_allclose(dynamics.predict(states), expected, atol=1e-12)


def test_a_state_at_the_mean_is_expected_to_stay():
    dynamics = random_dynamics(np.random.default_rng(0), 3, 2)
    at_rest = np.tile(dynamics.mean, (1, 3, 1))
    np.testing.assert_allclose(dynamics.predict(at_rest)[0], dynamics.mean, atol=1e-12)


@pytest.mark.parametrize(("order", "dimension"), SHAPES)
def test_samples_have_the_mean_and_covariance_of_the_transition(order, dimension):
    rng = np.random.default_rng([order, dimension, 1])
    dynamics = random_dynamics(rng, order, dimension)
    state = rng.standard_normal((order, dimension))
    drawn = dynamics.sample(rng, np.broadcast_to(state, (40_000, order, dimension)))
    deviations = drawn - naive_mean(dynamics, state)
    assert np.abs(z_scores(deviations, 0.0)).max() < 5
    products = deviations[:, :, None] * deviations[:, None, :]
    assert np.abs(z_scores(products, dynamics.noise_covariance)).max() < 5


def conditional(mean: np.ndarray, covariance: np.ndarray, u: np.ndarray, chosen: tuple[int, ...]):
    """Mean and covariance of the other components by the precision matrix: another road than the library's."""
    rest = [i for i in range(len(mean)) if i not in chosen]
    precision = np.linalg.inv(covariance)
    inner = np.linalg.inv(precision[np.ix_(rest, rest)])
    return mean[rest] - inner @ precision[np.ix_(rest, chosen)] @ (u - mean[list(chosen)]), inner


@pytest.mark.parametrize(("dimension", "components"), SUBSETS)
def test_completion_is_the_gaussian_conditional(dimension, components):
    rng = np.random.default_rng([dimension, *components])
    dynamics = random_dynamics(rng, 2, dimension)
    state = rng.standard_normal((2, dimension))
    u = rng.standard_normal(len(components))
    n = 20_000
    states, proposed = np.broadcast_to(state, (n, 2, dimension)), np.broadcast_to(u, (n, len(components)))
    completed = dynamics.complete(rng, proposed, states, components)
    assert (completed[:, components] == u).all()
    rest = [i for i in range(dimension) if i not in components]
    if rest:
        mean, covariance = conditional(naive_mean(dynamics, state), dynamics.noise_covariance, u, components)
        deviations = completed[:, rest] - mean
        assert np.abs(z_scores(deviations, 0.0)).max() < 5
        assert np.abs(z_scores(deviations[:, :, None] * deviations[:, None, :], covariance)).max() < 5


@pytest.mark.parametrize(("dimension", "components"), SUBSETS)
def test_log_transition_is_the_marginal_density(dimension, components):
    rng = np.random.default_rng([dimension, *components, 2])
    dynamics = random_dynamics(rng, 3, dimension)
    states = rng.standard_normal((5, 3, dimension))
    proposed = rng.standard_normal((5, len(components)))
    chosen = list(components)
    covariance = dynamics.noise_covariance[np.ix_(chosen, chosen)]
    expected = [
        multivariate_normal(naive_mean(dynamics, state)[chosen], covariance).logpdf(u)
        for state, u in zip(states, proposed, strict=True)
    ]
    np.testing.assert_allclose(dynamics.log_transition(proposed, states, components), expected, rtol=1e-9)


def test_far_innovations_keep_a_finite_log_density():
    dynamics = Autoregression.scalar([0.5], noise=1.0)
    far = dynamics.log_transition(np.array([[50.0], [1e6]]), np.zeros((2, 1, 1)), (0,))
    np.testing.assert_allclose(far, -0.5 * np.array([50.0, 1e6]) ** 2 - 0.5 * np.log(2 * np.pi))


@pytest.mark.parametrize(("order", "dimension"), SHAPES)
def test_stationary_covariance_is_kept_by_the_transition(order, dimension):
    dynamics = random_dynamics(np.random.default_rng([order, dimension, 3]), order, dimension)
    stationary = dynamics.stationary_covariance()
    moved = dynamics.companion @ stationary @ dynamics.companion.T
    moved[:dimension, :dimension] += dynamics.noise_covariance
    np.testing.assert_allclose(moved, stationary, rtol=1e-8, atol=1e-10)


def test_an_unstable_process_has_no_stationary_covariance():
    with pytest.raises(ValueError, match="not stable"):
        Autoregression.scalar([1.0], noise=1.0).stationary_covariance()


def test_noise_is_scaled_by_its_standard_deviation():
    dynamics = Autoregression.scalar([0.5], noise=2.0, mean=1.0).with_noise(3.0)
    assert dynamics.noise_covariance.item() == pytest.approx(36.0)
    assert dynamics.mean is not None and dynamics.mean.item() == 1.0


def test_a_covariance_that_arithmetic_left_hardly_asymmetric_is_accepted():
    covariance = np.diag([1.0, 2.0, 3.0])
    covariance[0, 1], covariance[1, 0] = 0.5, 0.5 * (1 + 1e-13)
    covariance[2, 0] = 1e-18
    Autoregression(np.eye(3)[None] * 0.5, covariance)


@pytest.mark.parametrize(
    ("coefficients", "covariance", "mean", "message"),
    [
        (np.eye(2), np.eye(2), None, "coefficients must have shape"),
        (np.zeros((0, 1, 1)), np.eye(1), None, "coefficients must have shape"),
        (np.full((1, 1, 1), np.nan), np.eye(1), None, "coefficients must be finite"),
        (np.ones((1, 2, 2)), np.eye(3), None, "noise_covariance must have shape"),
        (np.ones((1, 2, 2)), np.ones((2, 2)), None, "noise_covariance must be positive definite"),
        (np.ones((1, 2, 2)), np.diag([1.0, -1.0]), None, "noise_covariance must be positive definite"),
        (np.ones((1, 2, 2)), np.array([[1.0, 0.5], [0.0, 1.0]]), None, "noise_covariance must be symmetric"),
        (np.ones((1, 1, 1)), np.full((1, 1), np.inf), None, "noise_covariance must be symmetric and finite"),
        (np.ones((1, 1, 1)), np.eye(1), np.zeros(2), "mean must be 1 finite"),
        (np.ones((1, 1, 1)), np.eye(1), np.array([np.nan]), "mean must be 1 finite"),
    ],
)
def test_what_is_not_an_autoregression_is_refused(coefficients, covariance, mean, message):
    with pytest.raises(ValueError, match=message):
        Autoregression(coefficients, covariance, mean)
