"""Toy worlds: small, seeded, each made to show one thing.

A world is data: dynamics, an observation model, a detector and a prior. Write one of your own in a few lines.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pfviz.dynamics import Autoregression
from pfviz.exact import Gaussian, KalmanStep, kalman_step
from pfviz.model import ObservationFunction
from pfviz.names import find
from pfviz.observations import GaussianObservation, LookAlikes, ObservationModel
from pfviz.particles import FloatArray, readonly
from pfviz.proposals import GaussianMixture


@dataclass(frozen=True, slots=True)
class Detector:
    """What turns an observation into a proposal: bumps of ``width`` about ``gain * detection + offset``.

    Attributes:
        width: the standard deviation of a bump, in the units of the world.
        offsets: ``(m, k)``, where the bumps are; there is one for every detection and offset.
        weights: ``(m,)``, how strongly the detector answers at each offset.
        gain: how far it trusts a detection; below 1 it draws it toward the origin, where a noisy one came from.
    """

    width: float
    offsets: FloatArray
    weights: FloatArray
    gain: float = 1.0

    def __call__(self, observation: FloatArray) -> GaussianMixture:
        detections = self.gain * np.atleast_2d(observation)
        k = detections.shape[1]
        means = (detections[:, None] + self.offsets).reshape(-1, k)
        return GaussianMixture(means, np.eye(k) * self.width**2, np.tile(self.weights, len(detections)))

    def with_width(self, factor: float) -> Detector:
        return replace(self, width=self.width * factor)


@dataclass(frozen=True, slots=True)
class ToyModel:
    """A toy world as a filter sees it; satisfies the ``Model`` protocol.

    Attributes:
        dynamics: autoregression of order p in R^k.
        observed: the observation model p(y | x1).
        detector: what the proposal pi(u | y) is made by.
        prior: of the stacked state ``(x_0, x_{-1}, ...)`` at time 0, dimension p k.
    """

    dynamics: Autoregression
    observed: ObservationModel
    detector: Detector
    prior: Gaussian

    def log_likelihood(self, innovation: FloatArray, observation: FloatArray) -> FloatArray:
        return self.observed.log_likelihood(innovation, observation)

    def proposal(self, observation: FloatArray) -> GaussianMixture:
        return self.detector(observation)

    def sample_prior(self, rng: np.random.Generator, count: int) -> FloatArray:
        return self.prior.sample(rng, count).reshape(count, self.dynamics.order, self.dynamics.dimension)

    def with_noise(self, system: float = 1.0, observation: float = 1.0, proposal: float = 1.0) -> ToyModel:
        """The same model believing in other noise: each argument multiplies a standard deviation."""
        return replace(
            self,
            dynamics=self.dynamics.with_noise(system),
            observed=self.observed.with_noise(observation),
            detector=self.detector.with_width(proposal),
        )

    @property
    def observation_function(self) -> ObservationFunction | None:
        """What the unscented filter looks through, where y is a function of the innovation plus Gaussian noise."""
        return self.observed if isinstance(self.observed, ObservationFunction) else None

    @property
    def observation_covariance(self) -> FloatArray | None:
        """``(k, k)`` where the innovation is seen through Gaussian noise, so that Kalman is exact; else None."""
        return self.observed.covariance if isinstance(self.observed, GaussianObservation) else None

    def exact_step(self, state: Gaussian, observation: FloatArray) -> KalmanStep | None:
        """The exact posterior after one more observation, or None where there is no exact answer."""
        covariance = self.observation_covariance
        return None if covariance is None else kalman_step(self.dynamics, covariance, state, observation)


@dataclass(frozen=True, slots=True)
class Recording:
    """What happened in a world: the truth and what was seen of it, from t = 1 on.

    Attributes:
        truth: ``(T, k)``.
        observations: T arrays, as the world's observation model gives them.
    """

    truth: FloatArray
    observations: tuple[FloatArray, ...]

    def __len__(self) -> int:
        return len(self.truth)


@dataclass(frozen=True, slots=True)
class World:
    """A named, seeded toy world.

    Attributes:
        name: as on the command line.
        title: as on the screen.
        look_for: one sentence on what it shows.
        model: dynamics, observation, detector and prior; also what the data is drawn from.
        extent: the half-width of the picture, in the units of the world.
        n_particles: how many particles show it best.
    """

    name: str
    title: str
    look_for: str
    model: ToyModel
    extent: float
    n_particles: int

    def record(self, seed: int, steps: int) -> Recording:
        """Draw the truth from the prior and the dynamics, and observe it, for ``steps`` steps."""
        if steps < 1:
            raise ValueError(f"steps must be at least 1, got {steps}")
        rng = np.random.default_rng([seed, _WORLD_STREAM])
        states = self.model.sample_prior(rng, 1)
        truth, observations = [], []
        for _ in range(steps):
            innovation = self.model.dynamics.sample(rng, states)
            states = np.concatenate([innovation[:, None], states[:, :-1]], axis=1)
            truth.append(innovation[0])
            observations.append(readonly(self.model.observed.sample(rng, innovation[0])))
        return Recording(readonly(truth), tuple(observations))


_WORLD_STREAM = 2**31
"""Keeps a world's own random numbers apart from those of the filters, which are keyed by (seed, time)."""


def _stationary(dynamics: Autoregression) -> Gaussian:
    mean = np.tile(np.asarray(dynamics.mean), dynamics.order)
    return Gaussian(mean, dynamics.stationary_covariance())


def _figure_1() -> World:
    dynamics = Autoregression.scalar([1.285, -0.2955], noise=0.1)
    prior, observation_variance = _stationary(dynamics), 4.0
    variance = float(prior.covariance[0, 0])
    detector = Detector(
        0.3,
        np.array([[-0.85], [0.0], [0.85]]),
        np.array([0.32, 0.36, 0.32]),
        variance / (variance + observation_variance),
    )
    return World(
        "figure-1",
        "Figure 1: arbitrary associations",
        "The system noise is small and the detector has three bumps: joined by index, most pairs are impossible.",
        ToyModel(dynamics, GaussianObservation(np.array([[observation_variance]])), detector, prior),
        extent=2.6,
        n_particles=24,
    )


def _linear_gaussian() -> World:
    dynamics = Autoregression.scalar([1.5, -0.56], noise=0.3)
    detector = Detector(0.6, np.zeros((1, 1)), np.ones(1))
    return World(
        "linear-gaussian",
        "Linear and Gaussian: the exact answer is known",
        "Kalman is exact here: every filter must agree with the black curve, the better ones with fewer particles.",
        ToyModel(dynamics, GaussianObservation(np.array([[0.25]])), detector, _stationary(dynamics)),
        extent=5.0,
        n_particles=100,
    )


def _plane() -> World:
    turn, damping, start = 0.3, 0.98, np.array([2.0, 0.0])
    dynamics = Autoregression(
        np.stack([2 * damping * np.cos(turn) * np.eye(2), -(damping**2) * np.eye(2)]),
        np.array([[0.0064, 0.0016], [0.0016, 0.0064]]),
    )
    before = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]) @ start
    spread = readonly(np.kron([[1.0, 0.9], [0.9, 1.0]], 0.04 * np.eye(2)))
    observed = LookAlikes(np.array([[-1.2, 1.0]]), np.eye(2) * 0.0225)
    detector = Detector(0.18, np.zeros((1, 2)), np.ones(1))
    return World(
        "plane",
        "Plane: a target and its look-alike",
        "Half of what the detector proposes lies on the look-alike; only its history tells which one is the target.",
        ToyModel(dynamics, observed, detector, Gaussian(np.concatenate([start, before]), spread)),
        extent=3.4,
        n_particles=100,
    )


WORLDS: dict[str, World] = {w.name: w for w in (_figure_1(), _linear_gaussian(), _plane())}


def get_world(name: str) -> World:
    """The world called ``name``.

    Raises:
        UnknownName: if there is none; the message suggests the nearest.
    """
    return find(WORLDS, name, "world")
