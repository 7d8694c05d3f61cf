"""What a filter needs to know of the world: the protocols that models of one's own satisfy."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np

from pfviz.particles import FloatArray

Components = tuple[int, ...]


@runtime_checkable
class Dynamics(Protocol):
    """A partitioned dynamical model (Assumption A): a stochastic innovation over a shifted history.

    The transition density must be Gaussian with a covariance that is the same for every state; its mean may be any
    function of the state.
    """

    @property
    def order(self) -> int: ...

    @property
    def dimension(self) -> int: ...

    @property
    def noise_covariance(self) -> FloatArray:
        """``(k, k)``: the covariance of p(x1' | x)."""
        ...

    def predict(self, states: FloatArray) -> FloatArray:
        """``(N, k)``: the mean of p(x1' | x) for each of ``states (N, p, k)``."""
        ...

    def sample(self, rng: np.random.Generator, states: FloatArray) -> FloatArray:
        """``(N, k)``: one draw of p(x1' | x) for each of ``states (N, p, k)``."""
        ...

    def complete(
        self, rng: np.random.Generator, proposed: FloatArray, states: FloatArray, components: Components
    ) -> FloatArray:
        """``(N, k)``: whole innovations, their other components v drawn from p(v | u, x).

        ``proposed (N, d)`` holds u, the values of ``components``; ``states (N, p, k)`` the state each one follows.
        """
        ...

    def log_transition(self, proposed: FloatArray, states: FloatArray, components: Components) -> FloatArray:
        """``(N,)``: log p(u_i | x_i) for ``proposed (N, d)``, the values of ``components``, one by one."""
        ...


@runtime_checkable
class Proposal(Protocol):
    """A density pi(u | y) from which innovations are drawn (Assumptions B and E)."""

    @property
    def components(self) -> Components:
        """Which components of the innovation are proposed, in increasing order."""
        ...

    def sample(self, rng: np.random.Generator, count: int) -> FloatArray:
        """``(count, d)`` draws."""
        ...

    def log_density(self, proposed: FloatArray) -> FloatArray:
        """``(N,)``: the log-density at ``proposed (N, d)``, normalised over R^d."""
        ...


@runtime_checkable
class Model(Protocol):
    """Dynamics, likelihood, proposal and prior, bundled.

    An observation can be anything that the model's own methods understand: an array in a toy, the features of a frame
    on video. An array that holds NaN, or None, is a missing observation: filters then predict only.
    """

    @property
    def dynamics(self) -> Dynamics: ...

    def log_likelihood(self, innovation: FloatArray, observation: Any) -> FloatArray:
        """``(N,)``: log p(y | x1) for ``innovation (N, k)``; a function of the innovation alone (Assumption D)."""
        ...

    def proposal(self, observation: Any) -> Proposal:
        """pi(. | y), a function of the observation alone."""
        ...

    def sample_prior(self, rng: np.random.Generator, count: int) -> FloatArray:
        """``(count, p, k)``: draws of the state at time 0."""
        ...


@runtime_checkable
class ObservationFunction(Protocol):
    """An observation that is a function of the innovation plus Gaussian noise.

    A model may offer one as its ``observation_function``; the unscented filter looks through it.
    """

    @property
    def covariance(self) -> FloatArray:
        """``(m, m)``: of the noise."""
        ...

    def expected(self, innovation: FloatArray) -> FloatArray:
        """``(N, m)``: the mean of p(y | x1) for ``innovation (N, k)``."""
        ...


def is_missing(observation: Any) -> bool:
    """Whether there is nothing to weigh with: None, or an array that holds NaN."""
    if observation is None:
        return True
    return isinstance(observation, (float, np.ndarray)) and bool(np.isnan(observation).any())


def shift(states: FloatArray, innovation: FloatArray) -> FloatArray:
    """The states ``(N, p, k)`` that follow when ``innovation (N, k)`` is put in front of ``states``: f2."""
    return np.concatenate([innovation[:, None], states[:, :-1]], axis=1)
