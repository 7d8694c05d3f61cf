"""Observation models: the likelihood is that of what is drawn."""

import numpy as np
import pytest
from oracles import random_covariance, z_scores
from scipy.stats import multivariate_normal

from pfviz.observations import GaussianObservation, LookAlikes


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_gaussian_likelihood(dimension):
    rng = np.random.default_rng(dimension)
    covariance = random_covariance(rng, dimension)
    innovation, observation = rng.standard_normal((5, dimension)), rng.standard_normal(dimension)
    expected = [multivariate_normal(x, covariance).logpdf(observation) for x in innovation]
    model = GaussianObservation(covariance)
    np.testing.assert_allclose(model.log_likelihood(innovation, observation), expected)


def test_gaussian_samples_have_its_moments():
    rng = np.random.default_rng(0)
    covariance, truth = random_covariance(rng, 2), np.array([1.0, -2.0])
    model = GaussianObservation(covariance)
    deviations = np.array([model.sample(rng, truth) for _ in range(10_000)]) - truth
    assert np.abs(z_scores(deviations, 0.0)).max() < 5
    assert np.abs(z_scores(deviations[:, :, None] * deviations[:, None], covariance)).max() < 5


def test_look_alikes_hide_which_detection_is_the_target():
    rng = np.random.default_rng(1)
    model = LookAlikes(np.array([[5.0, 5.0], [-5.0, 5.0]]), 0.01 * np.eye(2))
    truth = np.array([1.0, 1.0])
    seen = np.array([model.sample(rng, truth) for _ in range(3000)])
    assert seen.shape == (3000, 3, 2)
    first_is_target = np.linalg.norm(seen[:, 0] - truth, axis=1) < 1.0
    assert abs(z_scores(first_is_target.astype(float), 1 / 3)) < 5


def test_look_alike_likelihood_is_a_mixture_over_the_detections():
    rng = np.random.default_rng(2)
    covariance = random_covariance(rng, 2)
    model = LookAlikes(rng.standard_normal((2, 2)), covariance)
    detections, innovation = rng.standard_normal((3, 2)), rng.standard_normal((4, 2))
    expected = [np.mean([multivariate_normal(x, covariance).pdf(y) for y in detections]) for x in innovation]
    np.testing.assert_allclose(np.exp(model.log_likelihood(innovation, detections)), expected)


@pytest.mark.parametrize("model", [GaussianObservation(np.eye(2)), LookAlikes(np.zeros((1, 2)), np.eye(2))])
def test_noise_is_scaled_by_its_standard_deviation(model):
    np.testing.assert_allclose(model.with_noise(3.0).covariance, 9.0 * np.eye(2))


def test_a_covariance_must_be_positive_definite():
    with pytest.raises(ValueError, match="observation covariance must be positive definite"):
        GaussianObservation(np.zeros((1, 1)))
    with pytest.raises(ValueError, match="observation covariance must be positive definite"):
        LookAlikes(np.zeros((1, 2)), np.ones((2, 2)))
