"""Toy worlds: small, seeded, each made to show one thing.

A world is data: dynamics, an observation model, a detector and a prior. Write one of your own in a few lines.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import count, islice
from typing import Literal, Protocol

import numpy as np

from pfviz.dynamics import Autoregression
from pfviz.exact import Gaussian, GridDensity, GridStep, KalmanStep, grid_prior, grid_step, grid_supports, kalman_step
from pfviz.model import ObservationFunction, shift
from pfviz.names import find
from pfviz.observations import GaussianObservation, LookAlikes, ObservationModel, SquaredObservation
from pfviz.particles import FloatArray, readonly
from pfviz.proposals import GaussianMixture


class DetectorModel(Protocol):
    """What turns an observation into a proposal."""

    def __call__(self, observation: FloatArray) -> GaussianMixture: ...

    def with_width(self, factor: float) -> DetectorModel:
        """The same with its bumps ``factor`` times as wide."""
        ...


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
class RootDetector:
    """Proposes both square roots of an observation in one dimension, and zero where it has none.

    Attributes:
        width: the standard deviation of each bump.
    """

    width: float

    def __call__(self, observation: FloatArray) -> GaussianMixture:
        root = np.sqrt(np.maximum(observation, 0.0))
        return GaussianMixture(np.stack([-root, root]), np.eye(1) * self.width**2)

    def with_width(self, factor: float) -> RootDetector:
        return replace(self, width=self.width * factor)


@dataclass(frozen=True, slots=True)
class ToyModel:
    """A toy world as a filter sees it; satisfies the ``Model`` protocol.

    Attributes:
        dynamics: autoregression of order p in R^k.
        observed: the observation model p(y | x1).
        detector: what the proposal pi(u | y) is made by.
        prior: of the stacked state ``(x_0, x_{-1}, ...)`` at time 0, dimension p k.

    Raises:
        ValueError: if the prior or the observation does not fit the dynamics.
    """

    dynamics: Autoregression
    observed: ObservationModel
    detector: DetectorModel
    prior: Gaussian

    def __post_init__(self) -> None:
        p, k = self.dynamics.order, self.dynamics.dimension
        if len(self.prior.mean) != p * k:
            raise ValueError(
                f"the prior must have {p * k} dimensions for order {p} in {k} dimensions, got {len(self.prior.mean)}"
            )
        covariance = getattr(self.observed, "covariance", None)
        if covariance is not None and covariance.shape != (k, k):
            raise ValueError(f"the observation covariance must have shape {(k, k)}, got {covariance.shape}")

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

    @property
    def exact(self) -> Literal["kalman", "grid"] | None:
        """Which filter answers exactly, if one does: Kalman's, or a grid for one dimension and order 1 or 2."""
        if self.observation_covariance is not None:
            return "kalman"
        return "grid" if grid_supports(self.dynamics) else None

    def exact_step(self, state: Gaussian | GridDensity, observation: FloatArray) -> KalmanStep | GridStep | None:
        """The exact posterior after one more observation, or None where there is no exact answer.

        Args:
            state: the prior, or the posterior of the step before.
            observation: as the observation model gives it.
        """
        covariance = self.observation_covariance
        if covariance is not None and isinstance(state, Gaussian):
            return kalman_step(self.dynamics, covariance, state, observation)
        if not grid_supports(self.dynamics):
            return None
        density = grid_prior(self.dynamics, state) if isinstance(state, Gaussian) else state
        return grid_step(self.dynamics, lambda x: self.log_likelihood(x, observation), density, observation)


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
class Jumps:
    """The target is now and then put somewhere else, velocity and all: nothing that the dynamics could foresee.

    Attributes:
        every: how many steps apart.
        by: ``(k,)``, how far; towards the other side of the mean.
    """

    every: int
    by: FloatArray

    def displace(self, states: FloatArray, mean: FloatArray) -> FloatArray:
        """``states (1, p, k)`` moved across the ``mean (k,)``."""
        side = np.where(states[:, :1] > mean, -1.0, 1.0)
        return states + side * self.by


@dataclass(frozen=True, slots=True)
class Occlusion:
    """The target is now and then hidden: there is nothing to observe.

    Attributes:
        every: the target is hidden at the end of every so many steps.
        hidden: for how many of them.
    """

    every: int
    hidden: int

    def covers(self, t: int) -> bool:
        """Whether the target is hidden at time ``t``, from 1 on."""
        return (t - 1) % self.every >= self.every - self.hidden


@dataclass(frozen=True, slots=True)
class World:
    """A named, seeded toy world.

    Attributes:
        name: as on the command line.
        title: as on the screen.
        look_for: one sentence on what it shows.
        model: dynamics, observation, detector and prior, as the filters believe them.
        extent: the half-width of the picture, in the units of the world.
        n_particles: how many particles show it best.
        actual: what the data is drawn from, where it is not the model.
        jumps: of the target, if it makes any.
        occlusion: of the target, if it is ever hidden: the observation is NaN then.
    """

    name: str
    title: str
    look_for: str
    model: ToyModel
    extent: float
    n_particles: int
    actual: ToyModel | None = None
    jumps: Jumps | None = None
    occlusion: Occlusion | None = None

    def record(self, seed: int, steps: int, held: Mapping[int, FloatArray] | None = None) -> Recording:
        """Draw the truth from the prior and the dynamics, and observe it, for ``steps`` steps.

        Args:
            seed: equal seeds, equal recordings.
            steps: how many.
            held: see ``unfold``.

        Raises:
            ValueError: if there are no steps.
        """
        if steps < 1:
            raise ValueError(f"steps must be at least 1, got {steps}")
        truth, observations = zip(*islice(self.unfold(seed, held), steps), strict=True)
        return Recording(readonly(truth), observations)

    def unfold(
        self, seed: int, held: Mapping[int, FloatArray] | None = None
    ) -> Iterator[tuple[FloatArray, FloatArray]]:
        """The truth ``(k,)`` and the observation of t = 1, 2, ..., without end.

        Args:
            seed: equal seeds, equal courses.
            held: by time, where somebody has put the target: there it is, and its history is moved along with it, so
                that it keeps its velocity. The random numbers are those that it would have had.
        """
        rng = np.random.default_rng([seed, _WORLD_STREAM])
        model = self.actual or self.model
        states = model.sample_prior(rng, 1)
        for t in count(1):
            if self.jumps is not None and t % self.jumps.every == 0:
                states = self.jumps.displace(states, np.asarray(model.dynamics.mean))
            states = shift(states, model.dynamics.sample(rng, states))
            if held and t in held:
                states = states + (held[t] - states[:, 0])
            truth = readonly(states[0, 0])
            seen = readonly(model.observed.sample(rng, truth))
            hidden = self.occlusion is not None and self.occlusion.covers(t)
            yield truth, readonly(np.full_like(seen, np.nan)) if hidden else seen


_WORLD_STREAM = 2**31
"""Keeps a world's own random numbers apart from those of the filters, which are keyed by (seed, time)."""


def _stationary(dynamics: Autoregression) -> Gaussian:
    mean = np.tile(np.asarray(dynamics.mean), dynamics.order)
    return Gaussian(mean, dynamics.stationary_covariance())


def _figure_1() -> World:
    """Figures 1 and 2 of the sources. Mean ESS over 10 recordings: Basic-SIR 14% of N, RB-HS-SIR 45%."""
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
    """Second order, so that there is a history; the detector is wider than what it detects."""
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
    """A target that circles, and a look-alike that lies still, as in the experiment of the sources."""
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


def _recovery() -> World:
    """Who is lost, and for how long.

    Steps until the estimate is back, mean of 30 jumps, with 100 particles: CONDENSATION 5.1, auxiliary 4.3, RB-HS-SIR
    1.1, ICondensation 0.1. A jump is against the model, so that the exact posterior is slow as well: with more
    particles every unbiased filter comes closer to it, and RB-HS-SIR with few is quicker than it should be.
    """
    dynamics = Autoregression.scalar([1.8, -0.81], noise=0.06)
    detector = Detector(0.35, np.zeros((1, 1)), np.ones(1))
    return World(
        "recovery",
        "Recovery: the target jumps",
        "Every 25 steps the target is somewhere else: who finds it again, and how soon?",
        ToyModel(dynamics, GaussianObservation(np.array([[0.09]])), detector, _stationary(dynamics)),
        extent=4.0,
        n_particles=100,
        jumps=Jumps(25, np.array([3.0])),
    )


def _wrong_noise() -> World:
    """The sources say that CONDENSATION suffers where the noise is taken for too small or too large, others less.

    Error (rms, 20 recordings of 60 steps) with 30 particles: CONDENSATION 0.43, Basic-SIR 0.31, RB-HS-SIR 0.26, and
    0.25 for the exact posterior of the same wrong model; with the right noise all are at 0.18 to 0.20. So it is for
    noise that is taken for too small. For noise taken for three times too large it is not so: CONDENSATION 0.21,
    RB-HS-SIR 0.20. There the model itself is what fails: among look-alikes (``plane``) its posterior follows the wrong
    one, and all filters do.
    """
    believed = Autoregression.scalar([1.5, -0.56], noise=0.1)
    actual = believed.with_noise(3.0)
    detector = Detector(0.4, np.zeros((1, 1)), np.ones(1))
    observed = GaussianObservation(np.array([[0.04]]))
    return World(
        "wrong-noise",
        "Wrong noise: the model believes too little",
        "The target moves three times as wildly as the filters believe: who still follows it?",
        ToyModel(believed, observed, detector, _stationary(actual)),
        extent=5.0,
        n_particles=100,
        actual=ToyModel(actual, observed, detector, _stationary(actual)),
    )


def _two_modes() -> World:
    """The lecture's z = x^2 + noise. Resampling keeps the shares of the modes right on average and not in any one run.

    Both signs have more than 5% of the weight in 71% of 600 steps for CONDENSATION with 50 particles and in 86% for
    RB-HS-SIR, whose detector goes on proposing both; the unscented filter, whose weights hardly vary, keeps both.
    """
    dynamics = Autoregression.scalar([0.97], noise=0.25)
    return World(
        "two-modes",
        "Two modes: the sign cannot be seen",
        "The square of the state is seen, so that the exact posterior has two equal modes: how long do both live on?",
        ToyModel(dynamics, SquaredObservation(np.array([[0.25]])), RootDetector(0.3), _stationary(dynamics)),
        extent=3.6,
        n_particles=50,
    )


def _occlusion() -> World:
    """The cloud grows to 17 times its width while the target is hidden; all filters agree on that with Kalman.

    When it comes back, CONDENSATION with 30 particles has an ESS of 8% of N and an error (rms of three steps) of 0.10;
    RB-HS-SIR has 64% and 0.07, which is that of the exact posterior.
    """
    dynamics = Autoregression.scalar([1.8, -0.81], noise=0.1)
    detector = Detector(0.15, np.zeros((1, 1)), np.ones(1))
    return World(
        "occlusion",
        "Occlusion: the target is hidden",
        "In the last 12 of every 62 steps nothing is seen: the cloud spreads, then has to find what comes back.",
        ToyModel(dynamics, GaussianObservation(np.array([[0.0064]])), detector, _stationary(dynamics)),
        extent=5.0,
        n_particles=30,
        occlusion=Occlusion(62, 12),
    )


def _peaked() -> World:
    """ESS with 100 particles: CONDENSATION 5, RB-HS-SIR 4: neither dynamics nor detector point exactly enough.

    LS-HS-SIR, which searches the likelihood, has 12, LS-N-IPS 47 (and a bias), the unscented filter 88. Error (rms):
    CONDENSATION 0.025, the latter three 0.015, which is the noise of the observation.
    """
    dynamics = Autoregression.scalar([1.5, -0.56], noise=0.3)
    detector = Detector(0.6, np.zeros((1, 1)), np.ones(1))
    return World(
        "peaked",
        "Peaked likelihood: a needle to be found",
        "The observation is twenty times as sharp as what the dynamics or the detector propose: who wastes the least?",
        ToyModel(dynamics, GaussianObservation(np.array([[0.015**2]])), detector, _stationary(dynamics)),
        extent=5.0,
        n_particles=100,
    )


WORLDS: dict[str, World] = {
    world.name: world
    for world in (
        _figure_1(),
        _linear_gaussian(),
        _plane(),
        _recovery(),
        _wrong_noise(),
        _two_modes(),
        _occlusion(),
        _peaked(),
    )
}


def get_world(name: str) -> World:
    """The world called ``name``.

    Raises:
        UnknownName: if there is none; the message suggests the nearest.
    """
    return find(WORLDS, name, "world")
