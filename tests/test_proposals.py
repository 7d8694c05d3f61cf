"""Proposals: the density is that of the samples."""

import numpy as np
import pytest
from oracles import integrate, random_covariance, z_scores
from scipy.stats import multivariate_normal

from pfviz.model import Proposal
from pfviz.proposals import GaussianMixture


def mixture(dimension: int) -> GaussianMixture:
    rng = np.random.default_rng(dimension)
    means = 2.0 * rng.standard_normal((3, dimension))
    return GaussianMixture(means, random_covariance(rng, dimension), np.array([0.2, 0.5, 0.3]))


def test_a_mixture_is_a_proposal():
    assert isinstance(mixture(2), Proposal)
    assert mixture(2).components == (0, 1)


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_density_is_the_weighted_sum_of_the_bumps(dimension):
    proposal = mixture(dimension)
    points = 3.0 * np.random.default_rng(1).standard_normal((20, dimension))
    bumps = [multivariate_normal(mean, proposal.covariance).pdf(points) for mean in proposal.means]
    np.testing.assert_allclose(np.exp(proposal.log_density(points)), np.array(bumps).T @ [0.2, 0.5, 0.3])


def test_density_integrates_to_one():
    proposal = mixture(1)
    assert integrate(lambda x: np.exp(proposal.log_density(x[:, None])), -30, 30) == pytest.approx(1.0)


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_samples_follow_the_density(dimension):
    """The mean of r(x) / pi(x) over draws of pi is the integral of r, for any r; here a narrower Gaussian."""
    proposal = mixture(dimension)
    drawn = proposal.sample(np.random.default_rng(2), 40_000)
    for mean in proposal.means:
        narrow = multivariate_normal(mean, 0.5 * proposal.covariance)
        ratios = narrow.pdf(drawn) / np.exp(proposal.log_density(drawn))
        assert abs(z_scores(ratios, 1.0)) < 5


def test_a_bump_without_weight_is_not_used():
    proposal = GaussianMixture(np.array([[0.0], [100.0]]), np.eye(1), np.array([2.0, 0.0]))
    assert np.abs(proposal.sample(np.random.default_rng(0), 1000)).max() < 10
    assert proposal.log_density(np.array([[100.0]]))[0] == pytest.approx(-5000 - 0.5 * np.log(2 * np.pi))


def test_far_points_keep_a_finite_log_density():
    proposal = GaussianMixture(np.zeros((2, 1)), np.eye(1))
    assert np.isfinite(proposal.log_density(np.array([[50.0], [1e8]]))).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.zeros(2), np.eye(1)), "means must have shape"),
        ((np.zeros((0, 1)), np.eye(1)), "means must have shape"),
        ((np.full((1, 1), np.nan), np.eye(1)), "means must be finite"),
        ((np.zeros((2, 1)), np.eye(1), np.ones(3)), "weights must be 2"),
        ((np.zeros((2, 1)), np.eye(1), np.zeros(2)), "weights must be 2"),
        ((np.zeros((2, 1)), np.eye(1), np.array([1.0, -1.0])), "weights must be 2"),
        ((np.zeros((2, 1)), np.eye(2)), "1-dimensional"),
        ((np.zeros((2, 1)), np.eye(1), None, (0, 1)), "1-dimensional"),
        ((np.zeros((2, 2)), np.eye(2), None, (1, 0)), "increasing"),
        ((np.zeros((2, 2)), np.eye(2), None, (1, 1)), "increasing"),
        ((np.zeros((2, 2)), np.ones((2, 2))), "positive definite"),
    ],
)
def test_what_is_not_a_mixture_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        GaussianMixture(*arguments)


def test_bumps_are_drawn_as_numpy_draws_them():
    proposal = GaussianMixture(np.array([[0.0], [100.0], [300.0]]), np.array([[1e-6]]), np.array([0.2, 0.7, 0.1]))
    drawn = proposal.sample(np.random.default_rng(4), 500)[:, 0]
    bumps = np.random.default_rng(4).choice(3, size=500, p=[0.2, 0.7, 0.1])
    np.testing.assert_array_equal(np.round(drawn), proposal.means[bumps, 0])
