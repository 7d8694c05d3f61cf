"""The curve that stands for the particles is a density."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pfviz.exact import smoothed_density
from pfviz.particles import ParticleSet

GRID = np.linspace(-40.0, 40.0, 4001)


def particles_at(values, weights):
    return ParticleSet(np.asarray(values, dtype=float).reshape(-1, 1, 1), np.log(np.asarray(weights) / np.sum(weights)))


@given(
    st.lists(st.tuples(st.floats(-5, 5), st.floats(1e-6, 1.0)), min_size=1, max_size=60),
)
def test_it_is_positive_and_integrates_to_one_about_the_mean_of_the_particles(pairs):
    particles = particles_at(*zip(*pairs, strict=True))
    density = smoothed_density(particles, GRID)
    assert (density >= 0).all()
    assert np.trapezoid(density, GRID) == pytest.approx(1.0, abs=1e-3)
    assert np.trapezoid(density * GRID, GRID) == pytest.approx(float(particles.mean[0]), abs=5e-3)


def test_it_tends_to_the_density_that_the_particles_were_drawn_from():
    values = np.random.default_rng(3).standard_normal(20000)
    density = smoothed_density(particles_at(values, np.ones(20000)), np.linspace(-4, 4, 161))
    expected = np.exp(-0.5 * np.linspace(-4, 4, 161) ** 2) / np.sqrt(2 * np.pi)
    assert np.abs(density - expected).max() < 0.02


def test_the_heavier_particle_has_the_higher_bump():
    density = smoothed_density(particles_at([-10.0, 10.0], [0.2, 0.8]), GRID)
    assert np.trapezoid(density[GRID > 0], GRID[GRID > 0]) == pytest.approx(0.8, abs=0.1)
