"""Exact answers worked out independently of the library: textbook recursions and dense joint Gaussians."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.stats import multivariate_normal

from pfviz.dynamics import Autoregression
from pfviz.exact import Gaussian
from pfviz.observations import GaussianObservation
from pfviz.particles import ParticleSet
from pfviz.proposals import GaussianMixture
from pfviz.record import StepRecord
from pfviz.worlds import ToyModel

Array = np.ndarray


@dataclass(frozen=True)
class LinearGaussian:
    """x_t - m = sum_j A_j (x_{t-j} - m) + e, y = x + n; the prior is that of (x_0, x_{-1}, ...)."""

    coefficients: Array
    mean: Array
    noise: Array
    observation: Array
    prior_mean: Array
    prior_covariance: Array

    @classmethod
    def of_line(cls, model: dict) -> LinearGaussian:
        """From the first line that ``pfviz toy --json`` prints."""
        names = (
            "coefficients",
            "mean",
            "noise_covariance",
            "observation_covariance",
            "prior_mean",
            "prior_covariance",
        )
        return cls(*(np.array(model[name]) for name in names))

    @property
    def order(self) -> int:
        return self.coefficients.shape[0]

    @property
    def dimension(self) -> int:
        return self.coefficients.shape[1]


@dataclass(frozen=True)
class Answer:
    """The posterior of x_t given y_1..y_t, and log p(y_t | y_1..y_t-1)."""

    mean: Array
    covariance: Array
    log_evidence: float


def textbook_kalman(model: LinearGaussian, observations: Array) -> Iterator[Answer]:
    """The recursion on the stacked state, with the constant as part of the state."""
    p, k = model.order, model.dimension
    n = p * k
    transition = np.zeros((n + 1, n + 1))
    for j in range(p):
        transition[:k, j * k : (j + 1) * k] = model.coefficients[j]
    transition[:k, n] = (np.eye(k) - model.coefficients.sum(axis=0)) @ model.mean
    transition[k:n, : n - k] = np.eye(n - k)
    transition[n, n] = 1.0
    noise = np.zeros((n + 1, n + 1))
    noise[:k, :k] = model.noise
    see = np.eye(k, n + 1)
    mean = np.append(model.prior_mean, 1.0)
    covariance = np.zeros((n + 1, n + 1))
    covariance[:n, :n] = model.prior_covariance
    for y in observations:
        mean, covariance = transition @ mean, transition @ covariance @ transition.T + noise
        total = see @ covariance @ see.T + model.observation
        residual, inverse = y - see @ mean, np.linalg.inv(total)
        log_evidence = -0.5 * (residual @ inverse @ residual + np.log(np.linalg.det(2 * np.pi * total)))
        gain = covariance @ see.T @ inverse
        mean = mean + gain @ residual
        covariance = covariance - gain @ total @ gain.T
        yield Answer(mean[:k], covariance[:k, :k], float(log_evidence))


def dense_joint(model: LinearGaussian, observations: Array) -> Iterator[Answer]:
    """The same from the joint Gaussian of all states and observations, conditioned anew at every time."""
    p, k, steps = model.order, model.dimension, len(observations)
    # Every x_t, t = 1 - p..T, as a linear map of z = (x_0, x_-1, ..., e_1, ..., e_T, 1).
    size = p * k + steps * k + 1
    maps = {-j: np.eye(k, size, j * k) for j in range(p)}
    constant = np.zeros((k, size))
    constant[:, -1] = model.mean
    for t in range(1, steps + 1):
        maps[t] = constant + np.eye(k, size, p * k + (t - 1) * k)
        for j in range(1, p + 1):
            maps[t] = maps[t] + model.coefficients[j - 1] @ (maps[t - j] - constant)
    mean = np.concatenate([model.prior_mean, np.zeros(steps * k), [1.0]])
    covariance = np.zeros((size, size))
    covariance[: p * k, : p * k] = model.prior_covariance
    for t in range(steps):
        block = slice(p * k + t * k, p * k + (t + 1) * k)
        covariance[block, block] = model.noise
    total = 0.0
    for t in range(1, steps + 1):
        seen = np.concatenate([maps[s] for s in range(1, t + 1)])
        y = np.concatenate(observations[:t])
        y_covariance = seen @ covariance @ seen.T + np.kron(np.eye(t), model.observation)
        cross = maps[t] @ covariance @ seen.T
        residual = y - seen @ mean
        log_density = multivariate_normal(np.zeros(len(y)), y_covariance).logpdf(residual)
        yield Answer(
            maps[t] @ mean + cross @ np.linalg.solve(y_covariance, residual),
            maps[t] @ covariance @ maps[t].T - cross @ np.linalg.solve(y_covariance, cross.T),
            float(log_density - total),
        )
        total = float(log_density)


def random_covariance(rng: np.random.Generator, size: int, scale: float = 1.0) -> Array:
    """Correlated, but not so much that a particle filter has no chance."""
    factor = np.eye(size) + 0.5 * rng.standard_normal((size, size)) / np.sqrt(size)
    return scale * factor @ factor.T


def random_dynamics(rng: np.random.Generator, order: int, dimension: int) -> Autoregression:
    """A stable autoregression with a mean and correlated noise."""
    coefficients = 0.6 * rng.standard_normal((order, dimension, dimension)) / (order * dimension) ** 0.5
    covariance = random_covariance(rng, dimension, 0.3)
    return Autoregression(coefficients, covariance, rng.standard_normal(dimension))


@dataclass(frozen=True)
class OffCentreDetector:
    """A proposal of several bumps that sit beside the observation, over some components only."""

    components: tuple[int, ...]
    width: float = 1.2

    def __call__(self, observation: Array) -> GaussianMixture:
        seen = np.asarray(observation)[list(self.components)]
        d = len(seen)
        shifts = np.array([-0.8, 0.5, 2.5])[:, None] * np.ones(d)
        covariance = self.width**2 * (0.7 * np.eye(d) + 0.3)
        return GaussianMixture(seen + shifts, covariance, np.array([0.4, 0.5, 0.1]), self.components)

    def with_width(self, factor: float) -> OffCentreDetector:
        return OffCentreDetector(self.components, self.width * factor)


def random_model(
    rng: np.random.Generator, order: int, dimension: int, components: tuple[int, ...] | None = None
) -> ToyModel:
    """A linear-Gaussian model with full covariances and an off-centre proposal of several bumps."""
    dynamics = random_dynamics(rng, order, dimension)
    prior = Gaussian(
        np.tile(dynamics.mean, order) + 0.3 * rng.standard_normal(order * dimension),
        random_covariance(rng, order * dimension, 0.3),
    )
    observed = GaussianObservation(random_covariance(rng, dimension, 0.5))
    detector = OffCentreDetector(tuple(range(dimension)) if components is None else components)
    return ToyModel(dynamics, observed, detector, prior)


def as_linear_gaussian(model: ToyModel) -> LinearGaussian:
    assert isinstance(model.observed, GaussianObservation)
    dynamics = model.dynamics
    return LinearGaussian(
        dynamics.coefficients,
        np.asarray(dynamics.mean),
        dynamics.noise_covariance,
        model.observed.covariance,
        model.prior.mean,
        model.prior.covariance,
    )


def observations_of(model: ToyModel, rng: np.random.Generator, steps: int) -> list[Array]:
    """A sequence that the model itself could have produced."""
    states = model.sample_prior(rng, 1)
    observations = []
    for _ in range(steps):
        innovation = model.dynamics.sample(rng, states)
        states = np.concatenate([innovation[:, None], states[:, :-1]], axis=1)
        observations.append(model.observed.sample(rng, innovation[0]))
    return observations


@dataclass(frozen=True)
class OneStep:
    """The exact posterior of one step from weighted histories: a mixture of Gaussians.

    Attributes:
        evidence: p(y | the weighted histories).
        history: ``(M,)``, the posterior probability of each history.
        means: ``(M, k)``, the posterior mean of the innovation, given the history.
        covariance: ``(k, k)``, its covariance, which is the same for every history.
    """

    evidence: float
    history: Array
    means: Array
    covariance: Array

    @classmethod
    def of(cls, model: ToyModel, particles: ParticleSet, observation: Array) -> OneStep:
        linear = as_linear_gaussian(model)
        q, r = linear.noise, linear.observation
        deviations = particles.states - linear.mean
        means = linear.mean + np.einsum("jab,njb->na", linear.coefficients, deviations)
        terms = np.array([multivariate_normal(m, q + r).pdf(observation) for m in means]) * particles.weights
        gain = q @ np.linalg.inv(q + r)
        evidence = float(terms.sum())
        return cls(evidence, terms / evidence, means + (observation - means) @ gain.T, q - gain @ q)

    def expectations(self) -> dict[str, float]:
        """Of the functions of ``measured``, times the evidence."""
        mean = self.history @ self.means
        second = self.covariance + (self.history[:, None] * self.means).T @ self.means
        some = slice(len(self.history) // 4)
        joint = self.history[some] @ self.means[some].sum(axis=1)
        values = {"one": 1.0, "some histories": self.history[some].sum(), "joint": joint}
        values |= {"mean": mean.sum(), "second moment": second.sum()}
        return {name: self.evidence * float(value) for name, value in values.items()}


def measured(record: StepRecord) -> dict[str, float]:
    """The filter's unnormalised estimates of the functions of ``OneStep.expectations``."""
    posterior = record.posterior
    weights, x = posterior.weights, posterior.innovation.sum(axis=1)
    some = (record.histories >= 0) & (record.histories < len(record.previous) // 4)
    values = {"one": 1.0, "some histories": weights[some].sum(), "joint": (weights * x)[some].sum()}
    values |= {"mean": weights @ x, "second moment": weights @ x**2}
    assert record.log_evidence is not None
    return {name: float(np.exp(record.log_evidence) * value) for name, value in values.items()}


def z_scores(samples: Array, expected: Array | float) -> Array:
    """How many standard errors the mean of ``samples (R, ...)`` lies from what is expected."""
    samples = np.asarray(samples)
    standard_error = samples.std(axis=0, ddof=1) / np.sqrt(len(samples))
    return (samples.mean(axis=0) - expected) / np.maximum(standard_error, 1e-300)


def integrate(f: Callable[[Array], Array], low: float, high: float, count: int = 4001) -> float:
    """The integral of a function of one variable, by the trapezoid rule."""
    grid = np.linspace(low, high, count)
    return float(np.trapezoid(f(grid), grid))
