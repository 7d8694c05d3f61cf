"""A grid filter: the exact posterior of a one-dimensional world of order 1 or 2, whatever its likelihood.

The densities of a filter are smooth: every prediction has been blurred by Gaussian noise. For smooth densities that
vanish at both ends the plain sum over evenly spaced points is an integral with an error that falls faster than any
power of the spacing: with half a standard deviation it is at the limit of double precision. So the grid is coarse in
space and exact in value. Three things keep it cheap: it follows the density from step to step; cells of no weight are
left out; the noise reaches only so far.

How large the error is, the filter says itself: the same recursion runs on every second point beside it, and the
difference between the two bounds the error of the finer one with plenty to spare.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from pfviz.dynamics import Autoregression
from pfviz.exact.kalman import Gaussian
from pfviz.model import is_missing
from pfviz.particles import FloatArray, IntArray, log_sum_exp, readonly

LogLikelihood = Callable[[FloatArray], FloatArray]

_REACH = 8.5  # standard deviations; the tail beyond is 1e-17
_NEGLIGIBLE = 1e-17  # the weight of cells that are left out, relative to the heaviest
_POINTS_PER_DEVIATION = 2.0
_REFINEMENTS = 6
_TOLERANCE = 1e-9
_PAIRS_PER_CHUNK = 1 << 20


@dataclass(frozen=True, slots=True)
class GridMarginal:
    """A density of one variable, known at the points of a lattice.

    Attributes:
        points: ``(G,)``, evenly spaced.
        probabilities: ``(G,)``, their weights; they sum to one.
    """

    points: FloatArray
    probabilities: FloatArray

    @property
    def spacing(self) -> float:
        return float(self.points[1] - self.points[0]) if len(self.points) > 1 else 1.0

    @property
    def mean(self) -> FloatArray:
        """``(1,)``."""
        return np.array([self.probabilities @ self.points])

    @property
    def covariance(self) -> FloatArray:
        """``(1, 1)``."""
        return np.array([[self.probabilities @ (self.points - self.mean) ** 2]])

    def leading(self, dimension: int = 1) -> GridMarginal:
        """Itself: it is the marginal of the innovation."""
        if dimension != 1:
            raise ValueError(f"a grid has one dimension, got {dimension}")
        return self

    def log_density(self, points: FloatArray) -> FloatArray:
        """``(N,)``: the log-density at ``points (N, 1)``: the smooth function through the lattice (Whittaker 1915).

        Below 1e-13 of the peak it is minus infinity.
        """
        distances = (np.ravel(points)[:, None] - self.points) / self.spacing
        density = np.sinc(distances) @ self.probabilities
        negligible = density < 1e-13 * self.probabilities.max()
        return np.where(negligible, -np.inf, np.log(np.where(negligible, 1.0, density) / self.spacing))

    def cumulative(self, points: FloatArray) -> FloatArray:
        """``(N,)``: the probability of less than each of ``points (N, 1)``, to about four digits."""
        low, high = self.points[0] - self.spacing, self.points[-1] + self.spacing
        known = np.linspace(low, high, 16 * len(self.points) + 1)
        density = np.maximum(np.sinc((known[:, None] - self.points) / self.spacing) @ self.probabilities, 0.0)
        total = np.append(0.0, np.cumsum(density[1:] + density[:-1]))
        return np.interp(np.ravel(points), known, total / total[-1])


@dataclass(frozen=True, slots=True)
class _Cells:
    """Weighted points of a lattice: the states that have any probability.

    Attributes:
        indices: ``(n, p)``, integers; a coordinate is index times spacing.
        spacings: ``(p,)``, newest first.
        probabilities: ``(n,)``; they sum to one.
    """

    indices: IntArray
    spacings: tuple[float, ...]
    probabilities: FloatArray

    @property
    def states(self) -> FloatArray:
        """``(n, p, 1)``."""
        return np.multiply(self.indices, self.spacings, dtype=np.float64)[:, :, None]

    def marginal(self) -> GridMarginal:
        first = self.indices[:, 0]
        probabilities = np.bincount(first - first.min(), self.probabilities)
        points = (first.min() + np.arange(len(probabilities))) * self.spacings[0]
        return GridMarginal(readonly(points), readonly(probabilities))


@dataclass(frozen=True, slots=True)
class GridDensity:
    """The density of the state, on a lattice and on every second point of it.

    Attributes:
        fine: the cells of the lattice.
        coarse: those of the lattice of twice the spacing, filtered on their own.
    """

    fine: _Cells
    coarse: _Cells

    @property
    def nbytes(self) -> int:
        """How much memory the cells take."""
        return sum(cells.indices.nbytes + cells.probabilities.nbytes for cells in (self.fine, self.coarse))

    def leading(self, dimension: int = 1) -> GridMarginal:
        """The marginal of the innovation."""
        if dimension != 1:
            raise ValueError(f"a grid has one dimension, got {dimension}")
        return self.fine.marginal()

    @property
    def mean(self) -> FloatArray:
        """``(1,)``: of the innovation."""
        return self.leading().mean

    @property
    def covariance(self) -> FloatArray:
        """``(1, 1)``: of the innovation."""
        return self.leading().covariance

    @property
    def error(self) -> float:
        """Total variation between the innovation on the lattice and on every second point."""
        fine, coarse = self.fine.marginal(), self.coarse.marginal()
        at_fine = np.rint(coarse.points / fine.spacing).astype(int) - round(float(fine.points[0]) / fine.spacing)
        inside = (at_fine >= 0) & (at_fine < len(fine.points))
        other = np.zeros(len(coarse.points))
        other[inside] = fine.probabilities[at_fine[inside]] * coarse.spacing / fine.spacing
        return 0.5 * float(np.abs(coarse.probabilities - other).sum() + abs(1.0 - other.sum()))


@dataclass(frozen=True, slots=True)
class GridStep:
    """One step of the grid filter.

    Attributes:
        predictive: p(x_t | y_1:t-1).
        posterior: p(x_t | y_1:t).
        log_evidence: log p(y_t | y_1:t-1).
        error: a bound, in practice, on the discretisation error of the posterior in total variation: 1 where the
            observation is so far out that the grid gives it no probability; the posterior is then the predictive.
    """

    predictive: GridDensity
    posterior: GridDensity
    log_evidence: float
    error: float


def grid_supports(dynamics: Any) -> bool:
    """Whether there is a grid filter for these dynamics: a one-dimensional autoregression of order 1 or 2."""
    return isinstance(dynamics, Autoregression) and dynamics.dimension == 1 and dynamics.order <= 2


def grid_prior(dynamics: Autoregression, prior: Gaussian) -> GridDensity:
    """The Gaussian ``prior`` of the stacked state, on a grid.

    Raises:
        ValueError: if the dynamics are not of order 1 or 2 in one dimension, or the prior is flat in some direction.
    """
    if not grid_supports(dynamics):
        raise ValueError(f"a grid needs order 1 or 2 in one dimension, got {dynamics.order} in {dynamics.dimension}")
    try:
        precision = np.linalg.inv(prior.covariance)
        finest = float(1.0 / np.sqrt(np.max(np.diag(precision))))
    except np.linalg.LinAlgError:
        finest = 0.0
    if not finest > 1e-6 * float(np.sqrt(prior.covariance.max())):
        raise ValueError("a grid needs a prior of some width in every direction")
    spacing = min(finest, _deviation(dynamics)) / _POINTS_PER_DEVIATION
    return GridDensity(_gaussian_cells(prior, spacing), _gaussian_cells(prior, 2.0 * spacing))


def grid_step(
    dynamics: Autoregression, log_likelihood: LogLikelihood, state: GridDensity, observation: Any = 0.0
) -> GridStep:
    """Predict, then multiply by the likelihood.

    Args:
        dynamics: one-dimensional, of order 1 or 2.
        log_likelihood: ``(N, 1)`` innovations to ``(N,)``.
        state: the posterior before.
        observation: only looked at to see whether it is missing; then the step predicts only.
    """
    base = _deviation(dynamics) / _POINTS_PER_DEVIATION
    if is_missing(observation):
        predicted = GridDensity(*(_predict(dynamics, c, s) for c, s in _levels(state, base)))
        return GridStep(predicted, predicted, 0.0, predicted.error)
    for refinement in range(_REFINEMENTS + 1):
        spacing = base / 2**refinement
        fine = _predict(dynamics, state.fine, spacing)
        posterior, log_evidence, agrees = _update(fine, log_likelihood)
        if posterior is None or agrees:
            break
    predicted = GridDensity(fine, _predict(dynamics, state.coarse, 2.0 * spacing))
    coarse, _, _ = _update(predicted.coarse, log_likelihood)
    if posterior is None or coarse is None:
        return GridStep(predicted, predicted, log_evidence, 1.0)
    both = GridDensity(posterior, coarse)
    return GridStep(predicted, both, log_evidence, both.error)


def _deviation(dynamics: Autoregression) -> float:
    return float(np.sqrt(dynamics.noise_covariance.item()))


def _levels(state: GridDensity, spacing: float) -> tuple[tuple[_Cells, float], tuple[_Cells, float]]:
    return (state.fine, spacing), (state.coarse, 2.0 * spacing)


def _gaussian_cells(gaussian: Gaussian, spacing: float) -> _Cells:
    deviations = np.sqrt(np.diag(gaussian.covariance))
    axes = [
        np.arange(np.floor((m - _REACH * s) / spacing), np.ceil((m + _REACH * s) / spacing) + 1)
        for m, s in zip(gaussian.mean, deviations, strict=True)
    ]
    indices = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=1).astype(np.int64)
    log_density = gaussian.log_density(np.multiply(indices, spacing, dtype=np.float64))
    return _kept(indices, (spacing,) * len(axes), np.exp(log_density - log_density.max()))


def _kept(indices: IntArray, spacings: tuple[float, ...], weights: FloatArray) -> _Cells:
    """The cells without those of negligible weight, normalised."""
    keep = weights > _NEGLIGIBLE * weights.max()
    return _Cells(indices[keep], spacings, weights[keep] / weights[keep].sum())


def _predict(dynamics: Autoregression, cells: _Cells, spacing: float) -> _Cells:
    """The cells of ``(x_{t+1}, x_t)`` (or of x_{t+1} alone, in order 1), x_{t+1} on a lattice of ``spacing``."""
    means = dynamics.predict(cells.states)[:, 0]
    deviation = _deviation(dynamics)
    low = int(np.floor((means.min() - _REACH * deviation) / spacing))
    width = int(np.ceil(means.max() / spacing + _REACH * deviation / spacing)) - low + 2
    if dynamics.order == 1:
        groups, kept = np.zeros(len(means), dtype=np.int64), np.zeros(1, dtype=np.int64)
    else:
        kept, groups = np.unique(cells.indices[:, 0], return_inverse=True)
    weights = np.zeros(len(kept) * width)
    band = np.arange(2 * int(np.ceil(_REACH * deviation / spacing)) + 1)
    chunk = max(1, _PAIRS_PER_CHUNK // len(band))
    for start in range(0, len(means), chunk):
        part = slice(start, start + chunk)
        first = np.floor((means[part] - _REACH * deviation) / spacing).astype(np.int64)
        targets = first[:, None] + band
        z = (targets * spacing - means[part, None]) / deviation
        values = cells.probabilities[part, None] * np.exp(-0.5 * z * z)
        flat = groups[part, None] * width + targets - low
        weights += np.bincount(flat.ravel(), values.ravel(), minlength=len(weights))
    indices = np.stack(np.divmod(np.arange(len(weights)), width), axis=1)
    newest = indices[:, 1] + low
    if dynamics.order == 1:
        return _kept(newest[:, None], (spacing,), weights)
    return _kept(np.stack([newest, kept[indices[:, 0]]], axis=1), (spacing, cells.spacings[0]), weights)


def _update(cells: _Cells, log_likelihood: LogLikelihood) -> tuple[_Cells | None, float, bool]:
    """The posterior cells and the log-evidence, and whether half as many points would have given the same.

    The cells are None where none has any probability.
    """
    marginal = cells.marginal()
    log_values = log_likelihood(marginal.points[:, None])
    with np.errstate(divide="ignore"):
        log_joint = np.log(marginal.probabilities) + log_values
    log_evidence = log_sum_exp(log_joint)
    if not np.isfinite(log_evidence):
        return None, log_evidence, True
    first = round(float(marginal.points[0]) / marginal.spacing)
    every_second = log_sum_exp(log_joint[first % 2 :: 2]) + np.log(2.0)
    agrees = abs(every_second - log_evidence) < _TOLERANCE
    peak = log_values[np.isfinite(log_joint)].max()
    weights = cells.probabilities * np.exp(log_values[cells.indices[:, 0] - first] - peak)
    return _kept(cells.indices, cells.spacings, weights), log_evidence, bool(agrees)
