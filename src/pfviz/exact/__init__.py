"""Exact posteriors to hold the particle filters against."""

from pfviz.exact.kalman import Gaussian, KalmanStep, kalman_filter, kalman_predict, kalman_step

__all__ = ["Gaussian", "KalmanStep", "kalman_filter", "kalman_predict", "kalman_step"]
