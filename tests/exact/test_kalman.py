"""The Kalman filter against a textbook recursion and the dense joint Gaussian."""

import numpy as np
import pytest
from oracles import as_linear_gaussian, dense_joint, observations_of, random_model, textbook_kalman
from scipy.stats import multivariate_normal

from pfviz.exact import Gaussian, kalman_filter

SHAPES = [(order, dimension) for order in (1, 2, 3, 4) for dimension in (1, 2, 3)]


@pytest.mark.parametrize("oracle", [textbook_kalman, dense_joint])
@pytest.mark.parametrize(("order", "dimension"), SHAPES)
def test_every_step_equals_the_oracle(oracle, order, dimension):
    rng = np.random.default_rng([order, dimension])
    model = random_model(rng, order, dimension)
    observations = np.array(observations_of(model, rng, 8))
    covariance = model.observation_covariance
    assert covariance is not None
    steps = kalman_filter(model.dynamics, covariance, model.prior, observations)
    for step, answer in zip(steps, oracle(as_linear_gaussian(model), observations), strict=True):
        posterior = step.posterior.leading(dimension)
        np.testing.assert_allclose(posterior.mean, answer.mean, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(posterior.covariance, answer.covariance, rtol=1e-9, atol=1e-9)
        assert step.log_evidence == pytest.approx(answer.log_evidence, abs=1e-9)


def test_a_missing_observation_leaves_the_predictive():
    rng = np.random.default_rng(5)
    model = random_model(rng, 2, 2)
    observations = np.array(observations_of(model, rng, 3))
    observations[1] = np.nan
    covariance = model.observation_covariance
    assert covariance is not None
    steps = kalman_filter(model.dynamics, covariance, model.prior, observations)
    assert steps[1].log_evidence == 0.0
    np.testing.assert_array_equal(steps[1].posterior.mean, steps[1].predictive.mean)
    # As if the second observation had been so noisy that it says nothing.
    noisy = [covariance, 1e12 * np.eye(2), covariance]
    state = model.prior
    for observation, r in zip(np.nan_to_num(observations), noisy, strict=True):
        state = kalman_filter(model.dynamics, r, state, observation[None])[0].posterior
    np.testing.assert_allclose(steps[2].posterior.mean, state.mean, atol=1e-6)


def test_covariances_stay_symmetric_and_positive_in_a_long_run():
    rng = np.random.default_rng(6)
    model = random_model(rng, 3, 2)
    observations = np.array(observations_of(model, rng, 500))
    assert model.observation_covariance is not None
    last = kalman_filter(model.dynamics, 1e-8 * model.observation_covariance, model.prior, observations)[-1]
    covariance = last.posterior.covariance
    np.testing.assert_array_equal(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance).min() > 0


def test_density_of_a_gaussian():
    gaussian = Gaussian(np.array([1.0, 2.0]), np.array([[2.0, 0.5], [0.5, 1.0]]))
    points = np.random.default_rng(0).standard_normal((5, 2))
    expected = multivariate_normal(gaussian.mean, gaussian.covariance).logpdf(points)
    np.testing.assert_allclose(gaussian.log_density(points), expected)
    assert gaussian.leading(1).covariance.tolist() == [[2.0]]


@pytest.mark.parametrize(
    ("mean", "covariance", "message"),
    [
        (np.zeros((1, 1)), np.eye(1), "mean must have shape"),
        (np.zeros(2), np.eye(3), "covariance must have shape"),
        (np.array([np.nan]), np.eye(1), "finite"),
        (np.zeros(2), np.array([[1.0, 0.2], [0.3, 1.0]]), "symmetric"),
        (np.zeros(2), np.diag([1.0, -1e-3]), "negative"),
    ],
)
def test_what_is_not_a_gaussian_is_refused(mean, covariance, message):
    with pytest.raises(ValueError, match=message):
        Gaussian(mean, covariance)


@pytest.mark.parametrize("covariance", [np.array([[1.0, 0.9], [0.9, 1.0]]), np.ones((2, 2)), np.zeros((2, 2))])
def test_samples_of_a_gaussian_that_may_be_flat(covariance):
    gaussian = Gaussian(np.array([1.0, -1.0]), covariance)
    drawn = gaussian.sample(np.random.default_rng(1), 20_000)
    np.testing.assert_allclose(drawn.mean(axis=0), gaussian.mean, atol=0.05)
    np.testing.assert_allclose(np.cov(drawn.T), covariance, atol=0.05)
