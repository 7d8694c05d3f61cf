"""How far a particle set is from the exact posterior, as one number between 0 and 1."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from pfviz.exact.grid import GridMarginal
from pfviz.exact.kalman import Gaussian
from pfviz.particles import FloatArray, IntArray, ParticleSet

CELLS = 32


class ExactPosterior(Protocol):
    """What the Kalman and the grid filter answer with."""

    def leading(self, dimension: int) -> Gaussian | GridMarginal: ...


def total_variation(particles: ParticleSet, exact: ExactPosterior, cells: int = CELLS) -> float:
    """Total variation between the innovation of a particle set and the exact posterior, in cells of equal probability.

    Particles are points and the posterior is a density, so that, taken literally, the distance is always 1. Here space
    is cut into cells that have the same exact probability, and the distance is half the sum of the absolute differences
    between the weight in a cell and that probability: 0 if all cells have their share, nearly 1 if one has it all. In
    R^k the posterior is made a standard Gaussian first, and cut along each axis into about the k-th root of ``cells``.

    N exact draws do not reach 0 either, but ``total_variation_of_draws(N)`` on the average: draw that as a line.

    Args:
        particles: N of them, in R^k.
        exact: the posterior over the stacked state.
        cells: how many there are, about.
    """
    per_axis = axis_cells(particles.dimension, cells)
    ranks = _ranks(exact.leading(particles.dimension), particles.innovation)
    parts = np.clip((ranks * per_axis).astype(np.int64), 0, per_axis - 1)
    count = per_axis**particles.dimension
    shares = np.bincount(_number(parts, per_axis), particles.weights, minlength=count)
    return 0.5 * float(np.abs(shares - 1.0 / count).sum())


def total_variation_of_draws(n_particles: int, dimension: int = 1, cells: int = CELLS) -> float:
    """The mean of ``total_variation`` for N independent draws of the exact posterior, equally weighted (De Moivre)."""
    from scipy.special import gammaln

    n, count = n_particles, axis_cells(dimension, cells) ** dimension
    p, m = 1.0 / count, n // count + 1
    log_choose = gammaln(n + 1) - gammaln(m + 1) - gammaln(n - m + 1)
    log_deviation = np.log(2.0 * m) + log_choose + m * np.log(p) + (n - m + 1) * np.log1p(-p)
    return 0.5 * count * float(np.exp(log_deviation)) / n


def axis_cells(dimension: int, cells: int = CELLS) -> int:
    """Into how many cells each axis is cut; at least two."""
    return max(2, round(cells ** (1.0 / dimension)))


def _ranks(exact: Gaussian | GridMarginal, innovation: FloatArray) -> FloatArray:
    """``(N, k)``: numbers that are uniform and independent when the innovations are draws of ``exact``."""
    if isinstance(exact, GridMarginal):
        return exact.cumulative(innovation)[:, None]
    from scipy.special import ndtr

    factor = np.linalg.cholesky(exact.covariance)
    return np.asarray(ndtr(np.linalg.solve(factor, (innovation - exact.mean).T).T), dtype=np.float64)


def _number(parts: IntArray, per_axis: int) -> IntArray:
    """``(N,)``: the number of each cell, from its places along the axes ``(N, k)``."""
    return parts @ per_axis ** np.arange(parts.shape[1])
