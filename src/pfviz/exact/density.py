"""The density that particles stand for, to be drawn beside the exact one."""

from __future__ import annotations

import numpy as np

from pfviz.particles import FloatArray, ParticleSet


def smoothed_density(particles: ParticleSet, grid: FloatArray) -> FloatArray:
    """``(len(grid),)``: a kernel estimate of the density of one-dimensional particles, by Silverman's rule.

    The kernel is Gaussian; of its width 1.06 s n^(-1/5) (Silverman 1986, section 3.4.2) n is the effective sample size.
    It is at least the spacing of the grid.

    Args:
        particles: in R^1; of longer histories the latest state counts.
        grid: values at equal distances, at least two, ascending.
    """
    values, weights = particles.states[:, 0, 0], particles.weights
    deviation = float(np.sqrt(particles.covariance[0, 0]))
    width = max(1.06 * deviation * particles.effective_sample_size**-0.2, float(grid[1] - grid[0]))
    kernel = np.exp(-0.5 * ((grid[:, None] - values) / width) ** 2) / (width * np.sqrt(2.0 * np.pi))
    return kernel @ weights
