"""Exact posteriors to hold the particle filters against, and how far a particle set is from them."""

from pfviz.exact.density import smoothed_density
from pfviz.exact.distance import ExactPosterior, total_variation, total_variation_of_draws
from pfviz.exact.grid import GridDensity, GridMarginal, GridStep, grid_prior, grid_step, grid_supports
from pfviz.exact.kalman import Gaussian, KalmanStep, kalman_filter, kalman_predict, kalman_step

__all__ = [
    "ExactPosterior",
    "Gaussian",
    "GridDensity",
    "GridMarginal",
    "GridStep",
    "KalmanStep",
    "grid_prior",
    "grid_step",
    "grid_supports",
    "kalman_filter",
    "kalman_predict",
    "kalman_step",
    "smoothed_density",
    "total_variation",
    "total_variation_of_draws",
]
