"""The grid filter: against Kalman where Kalman is exact, against a dense sum where it is not."""

import numpy as np
import pytest
from oracles import integrate, observations_of, random_model

from pfviz.dynamics import Autoregression
from pfviz.exact import Gaussian, grid_prior, grid_step, grid_supports, kalman_filter
from pfviz.observations import GaussianObservation, SquaredObservation
from pfviz.worlds import get_world


def filtered(model, observations, log_likelihood=None):
    """The grid steps for a model's likelihood, or for another."""
    see = log_likelihood or model.log_likelihood
    state, steps = grid_prior(model.dynamics, model.prior), []
    for observation in observations:
        steps.append(grid_step(model.dynamics, lambda x, y=observation: see(x, y), state, observation))
        state = steps[-1].posterior
    return steps


@pytest.mark.parametrize("narrowing", [1.0, 1e-2, 1e-4])
@pytest.mark.parametrize("order", [1, 2])
def test_the_grid_equals_kalman(order, narrowing):
    """Also where the observation noise is a hundredth of the system noise, and the grid has to become finer."""
    rng = np.random.default_rng(order)
    model = random_model(rng, order, 1)
    observed = GaussianObservation(narrowing * model.observed.covariance)
    observations = observations_of(model, rng, 6)
    kalman = kalman_filter(model.dynamics, observed.covariance, model.prior, np.array(observations))
    grid = filtered(model, observations, observed.log_likelihood)
    for exact, step in zip(kalman, grid, strict=True):
        marginal = exact.posterior.leading(1)
        assert step.posterior.mean.item() == pytest.approx(marginal.mean.item(), abs=1e-7)
        assert step.posterior.covariance.item() == pytest.approx(marginal.covariance.item(), rel=1e-6)
        assert step.log_evidence == pytest.approx(exact.log_evidence, abs=1e-7)


@pytest.mark.parametrize("order", [1, 2])
def test_density_and_cumulative_probability_between_the_points(order):
    rng = np.random.default_rng(order)
    model = random_model(rng, order, 1)
    observations = observations_of(model, rng, 3)
    exact = kalman_filter(model.dynamics, model.observed.covariance, model.prior, np.array(observations))[-1]
    gaussian, grid = exact.posterior.leading(1), filtered(model, observations)[-1].posterior.leading(1)
    x = gaussian.mean + np.sqrt(gaussian.covariance[0]) * np.linspace(-4, 4, 101)[:, None]
    np.testing.assert_allclose(np.exp(grid.log_density(x)), np.exp(gaussian.log_density(x)), atol=1e-7)
    cumulative = [integrate(lambda t: np.exp(gaussian.log_density(t[:, None])), x[0, 0] - 5, u) for u in x[:, 0]]
    np.testing.assert_allclose(grid.cumulative(x), cumulative, atol=2e-4)
    assert grid.log_density(np.array([[1e6]])).item() == -np.inf


def test_two_modes_against_a_dense_sum():
    """The square of the state is seen: a brute-force recursion on 4001 points."""
    model = get_world("two-modes").model
    observations = get_world("two-modes").record(3, 5).observations
    x = np.linspace(-8, 8, 4001)
    density = np.exp(model.prior.log_density(x[:, None]))
    transition = np.exp(
        -0.5 * (x[:, None] - model.dynamics.predict(x[:, None, None])[:, 0]) ** 2 / model.dynamics.noise_covariance
    )
    for observation, step in zip(observations, filtered(model, observations), strict=True):
        density = transition @ density
        density /= np.trapezoid(density, x)
        joint = density * np.exp(model.log_likelihood(x[:, None], observation))
        evidence = np.trapezoid(joint, x)
        density = joint / evidence
        assert step.log_evidence == pytest.approx(np.log(evidence), abs=1e-7)
        assert step.posterior.mean.item() == pytest.approx(0.0, abs=1e-9)
        variance = np.trapezoid(density * x**2, x)
        assert step.posterior.covariance.item() == pytest.approx(variance, rel=1e-6)
        np.testing.assert_allclose(
            np.exp(step.posterior.leading().log_density(x[:, None])), density, atol=1e-6 * density.max()
        )


@pytest.mark.parametrize("order", [1, 2])
def test_the_reported_error_bounds_the_true_one(order, monkeypatch):
    """On a grid that is made too coarse, so that there is an error to report."""
    monkeypatch.setattr("pfviz.exact.grid._POINTS_PER_DEVIATION", 1.0)
    monkeypatch.setattr("pfviz.exact.grid._REFINEMENTS", 0)
    rng = np.random.default_rng([order, 9])
    model = random_model(rng, order, 1)
    observations = observations_of(model, rng, 8)
    kalman = kalman_filter(model.dynamics, model.observed.covariance, model.prior, np.array(observations))
    largest = 0.0
    for exact, step in zip(kalman, filtered(model, observations), strict=True):
        marginal = step.posterior.leading()
        density = np.exp(exact.posterior.leading(1).log_density(marginal.points[:, None])) * marginal.spacing
        true_error = 0.5 * np.abs(density - marginal.probabilities).sum()
        assert true_error <= step.error
        largest = max(largest, true_error)
    assert largest > 1e-8


def test_a_missing_observation_predicts_only():
    rng = np.random.default_rng(3)
    model = random_model(rng, 2, 1)
    observations = observations_of(model, rng, 4)
    observations[2] = np.array([np.nan])
    kalman = kalman_filter(model.dynamics, model.observed.covariance, model.prior, np.array(observations))
    grid = filtered(model, observations)
    assert grid[2].log_evidence == 0.0
    for exact, step in zip(kalman, grid, strict=True):
        assert step.posterior.mean.item() == pytest.approx(exact.posterior.mean[0], abs=1e-8)


def test_an_impossible_observation_is_reported():
    model = get_world("two-modes").model
    state = grid_prior(model.dynamics, model.prior)
    step = grid_step(model.dynamics, lambda x: np.full(len(x), -np.inf), state)
    assert step.error == 1.0 and step.log_evidence == -np.inf
    assert step.posterior is step.predictive


def test_an_unstable_process_is_followed():
    dynamics = Autoregression.scalar([1.0], noise=0.5)
    observed = GaussianObservation(np.eye(1))
    prior = Gaussian(np.zeros(1), np.eye(1))
    state, kalman = grid_prior(dynamics, prior), prior
    for t in range(40):
        y = np.array([0.5 * t])
        step = grid_step(dynamics, lambda x, y=y: observed.log_likelihood(x, y), state)
        state = step.posterior
        kalman = kalman_filter(dynamics, observed.covariance, kalman, y[None])[0].posterior
        assert state.mean.item() == pytest.approx(kalman.mean.item(), abs=1e-7)


def test_what_has_no_grid():
    assert not grid_supports(get_world("plane").model.dynamics)
    assert not grid_supports(Autoregression.scalar([0.1, 0.1, 0.1], noise=1.0))
    with pytest.raises(ValueError, match="order 1 or 2 in one dimension"):
        grid_prior(get_world("plane").model.dynamics, get_world("plane").model.prior)
    with pytest.raises(ValueError, match="a prior of some width"):
        grid_prior(Autoregression.scalar([0.5], noise=1.0), Gaussian(np.zeros(1), np.zeros((1, 1))))
    with pytest.raises(ValueError, match="one dimension, got 2"):
        grid_prior(Autoregression.scalar([0.5], noise=1.0), Gaussian(np.zeros(1), np.eye(1))).leading(2)


def test_a_squared_observation_hides_the_sign():
    observed = SquaredObservation(np.array([[0.5]]))
    values = observed.log_likelihood(np.array([[-1.5], [1.5], [0.0]]), np.array([2.0]))
    assert values[0] == values[1] > values[2]
    assert values[0] == pytest.approx(-(0.25**2) - 0.5 * np.log(np.pi))
