"""The distance of a particle set from the exact posterior."""

import numpy as np
import pytest
from oracles import random_covariance, z_scores

from pfviz.exact import Gaussian, grid_prior, total_variation, total_variation_of_draws
from pfviz.exact.distance import axis_cells
from pfviz.particles import ParticleSet
from pfviz.worlds import get_world


def gaussian(dimension: int) -> Gaussian:
    rng = np.random.default_rng(dimension)
    return Gaussian(rng.standard_normal(dimension), random_covariance(rng, dimension))


def draws(exact: Gaussian, count: int, seed: int) -> ParticleSet:
    return ParticleSet.uniform(exact.sample(np.random.default_rng(seed), count)[:, None, :])


@pytest.mark.parametrize("dimension", [1, 2, 3])
@pytest.mark.parametrize("count", [1, 20, 400])
def test_exact_draws_are_as_far_as_they_should_be(dimension, count):
    exact = gaussian(dimension)
    distances = np.array([total_variation(draws(exact, count, seed), exact) for seed in range(300)])
    expected = total_variation_of_draws(count, dimension)
    if count == 1:
        np.testing.assert_allclose(distances, expected)
    else:
        assert abs(z_scores(distances, expected)) < 5


def test_the_mean_distance_of_draws_by_enumeration():
    """Two draws into two cells: one in each with probability one half, else both in one."""
    assert total_variation_of_draws(2, 1, cells=2) == pytest.approx(0.5 * 0.0 + 0.5 * 0.5)
    assert total_variation_of_draws(1, 1, cells=4) == pytest.approx(0.75)


@pytest.mark.parametrize("dimension", [1, 2])
def test_a_shift_and_a_wrong_width_are_seen(dimension):
    exact = gaussian(dimension)
    good = draws(exact, 5000, 0)
    near = total_variation(good, exact)
    shifted = ParticleSet.uniform(good.states + np.sqrt(np.diag(exact.covariance)))
    narrow = ParticleSet.uniform(exact.mean + 0.3 * (good.states - exact.mean))
    assert near < 0.06 < 0.2 < min(total_variation(shifted, exact), total_variation(narrow, exact))
    far = ParticleSet.uniform(good.states + 1e3)
    cells = axis_cells(dimension) ** dimension
    assert total_variation(far, exact) == pytest.approx(1.0 - 1.0 / cells)


def test_weights_count():
    exact = gaussian(1)
    wide = Gaussian(exact.mean, 4.0 * exact.covariance)
    particles = draws(wide, 20_000, 1)
    log_weights = exact.log_density(particles.innovation) - wide.log_density(particles.innovation)
    weighted = particles.reweighted(log_weights - np.logaddexp.reduce(log_weights))
    assert total_variation(weighted, exact) < 0.05 < 0.2 < total_variation(particles, exact)


def test_a_grid_will_do_as_the_exact_answer():
    model = get_world("two-modes").model
    grid = grid_prior(model.dynamics, model.prior)
    particles = draws(model.prior, 2000, 2)
    assert total_variation(particles, grid) == pytest.approx(total_variation(particles, model.prior), abs=2e-3)
