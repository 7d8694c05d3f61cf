"""A local search of the likelihood that needs no gradient."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pfviz.filters import steps
from pfviz.model import Model
from pfviz.particles import FloatArray


@dataclass(frozen=True, slots=True)
class Searched:
    """Where a search ended: ``points (N, k)``, their ``log_likelihood (N,)``, and how many it evaluated."""

    points: FloatArray
    log_likelihood: FloatArray
    evaluations: int


@dataclass(frozen=True, slots=True)
class LocalSearch:
    """Compass search (Hooke & Jeeves 1961; Torczon 1997): try a step either way along each axis, take the best, halve.

    The steps of a round are ``radius / 2``, ``radius / 4``, ..., so a point never leaves the ball of ``radius`` about
    its start: the operator S_lambda of LS-N-IPS. Lengths are standard deviations of the system noise, axes the columns
    of its Cholesky factor. Cost: 1 + 2 k ``rounds`` likelihoods a point.

    Attributes:
        radius: lambda.
        rounds: how often the step is halved.
    """

    radius: float = 1.0
    rounds: int = 3

    def __post_init__(self) -> None:
        if not (isinstance(self.radius, (int, float)) and 0.0 < self.radius < np.inf):
            raise steps.FilterError(f"radius must be positive, got {self.radius!r}")
        if not isinstance(self.rounds, int) or isinstance(self.rounds, bool) or self.rounds < 1:
            raise steps.FilterError(f"rounds must be a whole number of at least 1, got {self.rounds!r}")

    def __call__(self, model: Model, observation: Any, innovation: FloatArray) -> Searched:
        """Search from each ``innovation (N, k)``; a point moves only where the likelihood is larger."""
        axes = np.linalg.cholesky(model.dynamics.noise_covariance).T
        directions = np.concatenate([axes, -axes])
        points, best = np.array(innovation), model.log_likelihood(innovation, observation)
        n, k = points.shape
        step = self.radius
        for _ in range(self.rounds):
            step /= 2.0
            tried = points[:, None] + step * directions
            values = model.log_likelihood(tried.reshape(-1, k), observation).reshape(n, -1)
            choice = values.argmax(axis=1)
            value = values[np.arange(n), choice]
            better = value > best
            points[better] = tried[np.arange(n), choice][better]
            best = np.where(better, value, best)
        return Searched(points, best, n * (1 + 2 * k * self.rounds))
