"""Filters at the edges: far innovations, zero likelihoods, one particle, a million, lonely weights, duplicates."""

import tracemalloc
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from oracles import observations_of, random_model
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from pfviz.filters import FILTERS, FilterError, make_filter
from pfviz.particles import ParticleSet
from pfviz.randomness import step_rng
from pfviz.record import StepRecord
from pfviz.running import run
from pfviz.worlds import ToyModel

every_filter = pytest.mark.parametrize("name", FILTERS)
HISTORY_SAMPLING = ["hs-sir", "rb-hs-sir", "rb-ss-hs-sir", "innovation-sir", "icondensation", "ls-hs-sir"]


def model_of(order: int = 2, dimension: int = 1, components: tuple[int, ...] | None = None) -> ToyModel:
    return random_model(np.random.default_rng(5), order, dimension, components)


@dataclass(frozen=True)
class WithLikelihood:
    """A model with another likelihood."""

    model: ToyModel
    likelihood: Any

    @property
    def dynamics(self) -> Any:
        return self.model.dynamics

    def sample_prior(self, rng: np.random.Generator, count: int) -> np.ndarray:
        return self.model.sample_prior(rng, count)

    def proposal(self, observation: Any) -> Any:
        return self.model.proposal(observation)

    def log_likelihood(self, innovation: np.ndarray, observation: Any) -> np.ndarray:
        return self.likelihood(innovation)


def assert_sound(record: StepRecord, n: int) -> None:
    for stage in record.stages:
        assert np.isfinite(stage.particles.states).all()
        assert stage.particles.weights.sum() == pytest.approx(1.0)
    assert len(record.posterior) == n
    assert 1.0 - 1e-9 <= record.effective_sample_size <= n * (1 + 1e-9)
    assert record.log_evidence is not None and not np.isnan(record.log_evidence)


@every_filter
def test_observations_fifty_deviations_away(name):
    model = model_of()
    particles = make_filter(name, 50).initial(step_rng(0, 0), model)
    spread = np.sqrt(model.dynamics.noise_covariance.item() + model.observed.covariance.item())
    for sign in (-1, 1):
        far = np.array([particles.mean[0] + sign * 50 * spread])
        record = make_filter(name, 50).step(step_rng(0, 1), model, particles, far)
        assert_sound(record, 50)
        assert record.condition is None and record.log_evidence is not None
        # ICondensation starts anew at the observation, so that it does not notice how unlikely that is.
        assert -1e5 < record.log_evidence < (0 if name == "icondensation" else -100)


@pytest.mark.parametrize("name", ["hs-sir", "rb-hs-sir", "icondensation"])
def test_the_mixture_of_a_far_innovation_is_right(name):
    """Against a sum in double precision over all histories, where their densities are all zero in single precision."""
    model = model_of()
    particles = make_filter(name, 40).initial(step_rng(0, 0), model)
    far = np.array([particles.mean[0] + 50 * np.sqrt(model.dynamics.noise_covariance.item())])
    record = make_filter(name, 40).step(step_rng(0, 1), model, particles, far)
    proposed, weighed = record.stage("propose"), record.stage("weight")
    assert proposed is not None and weighed is not None
    u, mixture = proposed.particles.innovation, weighed.log_factors["mixture"]
    means = model.dynamics.predict(particles.states)
    terms = [
        particles.log_weights + [multivariate_normal(m, model.dynamics.noise_covariance).logpdf(x) for m in means]
        for x in u
    ]
    used = mixture != 0
    assert used.any()
    np.testing.assert_allclose(mixture[used], logsumexp(terms, axis=1)[used], atol=1e-3)


@every_filter
def test_zero_likelihoods_are_reported_and_survived(name):
    model = model_of()
    nothing = WithLikelihood(model, lambda x: np.full(len(x), -np.inf))
    filter_ = make_filter(name, 30)
    observations = observations_of(model, np.random.default_rng(0), 3)
    particles = filter_.initial(step_rng(0, 0), model)
    record = filter_.step(step_rng(0, 1), nothing, particles, observations[0])
    assert record.condition == "degenerate"
    assert record.log_evidence == -np.inf
    assert np.isfinite(record.posterior.states).all()
    assert record.effective_sample_size > 5
    after = filter_.step(step_rng(0, 2), model, record.posterior, observations[1])
    assert after.condition is None
    assert_sound(after, 30)


@every_filter
def test_one_particle_with_a_likelihood_is_enough(name):
    """A likelihood that is zero but on one side: whatever lies there takes all the weight."""
    model = model_of()
    half = WithLikelihood(model, lambda x: np.where(x[:, 0] > model.dynamics.mean[0], 0.0, -np.inf))
    filter_ = make_filter(name, 30)
    particles = filter_.initial(step_rng(0, 0), model)
    record = filter_.step(step_rng(0, 1), half, particles, np.asarray(model.dynamics.mean))
    assert record.condition is None
    weighty = record.posterior.weights > 0
    assert (record.posterior.innovation[weighty, 0] > model.dynamics.mean[0]).all()


@pytest.mark.parametrize("shape", [(1, 1, None), (3, 2, None), (2, 3, (1,))])
@every_filter
def test_one_particle(name, shape):
    model = model_of(*shape)
    observations = observations_of(model, np.random.default_rng(1), 4)
    for record in run(make_filter(name, 1), model, observations):
        assert_sound(record, 1)
        assert record.effective_sample_size == pytest.approx(1.0)


@every_filter
def test_lonely_weights_and_duplicates(name):
    model = model_of()
    states = np.tile(model.sample_prior(np.random.default_rng(0), 1), (20, 1, 1))
    lonely = np.full(20, -np.inf)
    lonely[7] = 0.0
    for particles in (ParticleSet.uniform(states), ParticleSet(states, lonely)):
        record = make_filter(name, 20).step(step_rng(0, 1), model, particles, np.array([0.3]))
        assert_sound(record, 20)


@pytest.mark.parametrize("name", [n for n in FILTERS if n != "icondensation"])
def test_a_particle_without_weight_has_no_descendants(name):
    model = model_of()
    rng = np.random.default_rng(2)
    log_weights = np.full(20, -np.inf)
    log_weights[[3, 11]] = np.log([0.25, 0.75])
    particles = ParticleSet(model.sample_prior(rng, 20), log_weights)
    record = make_filter(name, 20).step(step_rng(0, 1), model, particles, np.array([0.3]))
    living = record.posterior.weights > 0
    assert set(record.histories[living]) <= {3, 11}


@every_filter
def test_a_million_particles_take_memory_in_proportion(name):
    """Peak memory of a step by N, measured where N^2 would show; a million for the filters that are linear in time."""
    n = 3_000 if name in HISTORY_SAMPLING else 1_000_000
    model = model_of(1, 1)
    filter_ = make_filter(name, n)
    particles = filter_.initial(step_rng(0, 0), model)
    filter_.step(step_rng(0, 1), model, particles, np.zeros(1))
    tracemalloc.start()
    record = filter_.step(step_rng(0, 1), model, particles, np.zeros(1))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert_sound(record, n)
    assert peak < 80 * 8 * n + 2**22


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (np.nan, "likelihood of a particle is NaN or infinite"),
        (np.inf, "likelihood of a particle is NaN or infinite"),
    ],
)
@pytest.mark.parametrize("name", ["condensation", "basic-sir", "rb-hs-sir", "hs-sir", "auxiliary", "unscented"])
def test_a_likelihood_that_is_not_a_number_is_named(name, value, message):
    model = WithLikelihood(model_of(), lambda x: np.where(np.arange(len(x)) == 3, value, -1.0))
    particles = make_filter(name, 10).initial(step_rng(0, 0), model.model)
    with pytest.raises(FilterError, match=message):
        make_filter(name, 10).step(step_rng(0, 1), model, particles, np.zeros(1))


def test_a_likelihood_of_the_wrong_shape_is_named():
    model = WithLikelihood(model_of(), lambda x: np.zeros((len(x), 1)))
    particles = make_filter("condensation", 10).initial(step_rng(0, 0), model.model)
    with pytest.raises(FilterError, match=r"the log likelihood must have shape \(10,\), got \(10, 1\)"):
        make_filter("condensation", 10).step(step_rng(0, 1), model, particles, np.zeros(1))


extreme = st.one_of(st.floats(-3, 3), st.floats(-1e6, 1e6), st.sampled_from([0.0, 1e9, -1e9]))


@given(
    name=st.sampled_from(list(FILTERS)),
    n=st.integers(1, 12),
    shape=st.sampled_from([(1, 1, None), (2, 2, None), (2, 2, (0,)), (3, 1, None)]),
    values=st.lists(extreme, min_size=4, max_size=4),
    log_weights=st.lists(st.one_of(st.just(-np.inf), st.floats(-800, 0), st.floats(-2, 0)), min_size=12, max_size=12),
    observation=extreme,
    seed=st.integers(0, 2**31),
)
def test_a_step_is_sound_from_any_particles_and_observation(name, n, shape, values, log_weights, observation, seed):
    model = model_of(*shape)
    rng = np.random.default_rng(seed)
    states = rng.choice(values, size=(n, shape[0], shape[1])) + 1e-3 * rng.standard_normal((n, *shape[:2]))
    weights = np.array(log_weights[:n])
    weights[0] = 0.0
    particles = ParticleSet(states, weights - logsumexp(weights))
    record = make_filter(name, n).step(step_rng(seed, 1), model, particles, np.full(shape[1], float(observation)))
    assert_sound(record, n)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
@every_filter
def test_the_unit_does_not_matter(name, scale):
    """The same world in other units: the same particles in those units, the same weights."""
    model = model_of()
    scaled = replace(
        model,
        dynamics=replace(
            model.dynamics,
            noise_covariance=scale**2 * model.dynamics.noise_covariance,
            mean=scale * np.asarray(model.dynamics.mean),
        ),
        observed=replace(model.observed, covariance=scale**2 * model.observed.covariance),
        prior=replace(model.prior, mean=scale * model.prior.mean, covariance=scale**2 * model.prior.covariance),
        detector=Scaled(model.detector, scale),
    )
    observations = observations_of(model, np.random.default_rng(1), 3)
    ours = list(run(make_filter(name, 30), model, observations))
    theirs = list(run(make_filter(name, 30), scaled, [scale * y for y in observations]))
    for a, b in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(b.estimate, scale * a.estimate, rtol=0.02, atol=0.02 * scale)
        assert b.effective_sample_size == pytest.approx(a.effective_sample_size, rel=0.02)


@dataclass(frozen=True)
class Scaled:
    """A detector in other units."""

    detector: Any
    scale: float

    def __call__(self, observation: np.ndarray) -> Any:
        proposal = self.detector(observation / self.scale)
        return replace(proposal, means=self.scale * proposal.means, covariance=self.scale**2 * proposal.covariance)

    def with_width(self, factor: float) -> Any:
        return Scaled(self.detector.with_width(factor), self.scale)
