"""What is particular to each filter: its draws, its settings, its bias or what it does about it."""

from typing import Any

import numpy as np
import pytest
from oracles import (
    OneStep,
    as_linear_gaussian,
    measured,
    observations_of,
    random_model,
    textbook_kalman,
    z_scores,
)
from scipy import stats
from scipy.stats import multivariate_normal

from pfviz.filters import FILTERS, FilterError, LocalSearch, make_filter
from pfviz.filters.ls_hs_sir import FoundPlaces
from pfviz.particles import ParticleSet
from pfviz.randomness import step_rng
from pfviz.running import run
from pfviz.worlds import ToyModel, get_world

UNBIASED = [name for name, info in FILTERS.items() if info.unbiased]
N = 100


def weighted_histories(order: int, dimension: int, components: tuple[int, ...] | None = None, count: int = N):
    """A random model, ``count`` uneven histories about its mean, the first quarter apart, and an observation."""
    rng = np.random.default_rng([order, dimension, *(components or ())])
    model = random_model(rng, order, dimension, components)
    states = np.asarray(model.dynamics.mean) + rng.standard_normal((count, order, dimension))
    states[: count // 4] += 1.5
    weights = rng.random(count) * np.where(np.arange(count) < count // 4, 4.0, 1.0)
    return model, ParticleSet(states, np.log(weights / weights.sum())), np.asarray(model.dynamics.mean) + 0.5


def one_step_z(name: str, model: ToyModel, particles: ParticleSet, observation: Any, seeds: int, **settings: Any):
    """The z-score of each unnormalised estimate; see ``test_one_step``."""
    filter_ = make_filter(name, len(particles), **settings)
    estimates = [measured(filter_.step(step_rng(seed, 1), model, particles, observation)) for seed in range(seeds)]
    expected = OneStep.of(model, particles, observation).expectations()
    return {key: float(z_scores(np.array([e[key] for e in estimates]), value)) for key, value in expected.items()}


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("hs-sir", {"resampling": "multinomial"}),
        ("hs-sir", {"resampling": "residual"}),
        ("innovation-sir", {"ess_threshold": 0.0}),
        ("innovation-sir", {"ess_threshold": 1.0, "resampling": "stratified"}),
        ("icondensation", {"repaired": True}),
        ("icondensation", {"repaired": True, "importance": 1.0, "reinitialise": 0.0}),
        ("icondensation", {"repaired": True, "importance": 0.0, "reinitialise": 0.0, "ess_threshold": 0.0}),
        ("auxiliary", {"defence": 0.0}),
        ("auxiliary", {"defence": 1.0, "resampling": "residual"}),
        ("auxiliary", {"draws": 3 * N}),
        ("unscented", {"defence": 0.0}),
        ("unscented", {"defence": 0.5, "ess_threshold": 0.0}),
        ("ls-hs-sir", {"scouts": 0.0, "defence": 0.05}),
        ("ls-hs-sir", {"radius": 5.0, "rounds": 1, "bandwidth": 1.5}),
        ("condensation", {"ess_threshold": 0.0}),
        ("basic-sir", {"ess_threshold": 0.5, "resampling": "multinomial"}),
    ],
)
def test_unbiased_with_any_settings(name, settings):
    for shape in ((2, 1), (1, 2, (1,))):
        z = one_step_z(name, *weighted_histories(*shape), seeds=160, **settings)
        assert max(map(abs, z.values())) < 5, z


@pytest.mark.parametrize("name", UNBIASED)
def test_posterior_moments_agree_with_kalman(name):
    rng = np.random.default_rng(1)
    model = random_model(rng, 2, 2)
    observations = observations_of(model, rng, 3)
    *_, exact = textbook_kalman(as_linear_gaussian(model), np.array(observations))
    posteriors = [list(run(make_filter(name, 300), model, observations, seed))[-1].posterior for seed in range(40)]
    scale = np.sqrt(np.diag(exact.covariance))
    means = np.array([p.mean for p in posteriors])
    covariances = np.array([p.covariance for p in posteriors])
    # The estimates are ratios, whose bias is of the order of 1/N: allow a hundredth beside the standard error.
    for values, expected, unit in (
        (means, exact.mean, scale),
        (covariances, exact.covariance, np.outer(scale, scale)),
    ):
        error = np.abs(values.mean(axis=0) - expected)
        standard_error = values.std(axis=0, ddof=1) / np.sqrt(len(values))
        assert (error < 5 * standard_error + 0.01 * unit).all()


def spread(name: str, model: Any, observations: Any, n_particles: int, seeds: int = 60) -> float:
    """The standard deviation over seeds of the estimated log-evidence."""
    runs = (run(make_filter(name, n_particles), model, observations, seed) for seed in range(seeds))
    return float(np.std([sum(record.log_evidence for record in records) for records in runs]))


def test_rao_blackwellisation_and_history_sampling_reduce_the_variance():
    world = get_world("figure-1")
    observations = world.record(0, 6).observations
    plain, sampled, kept = (
        spread(name, world.model, observations, 40, seeds=100) for name in ("basic-sir", "hs-sir", "rb-hs-sir")
    )
    assert kept < 0.97 * sampled
    assert sampled < 0.7 * plain


def test_search_and_guidance_pay_where_the_likelihood_is_narrow():
    model = random_model(np.random.default_rng(7), 2, 2)
    narrow = model.with_noise(observation=0.15)
    observations = observations_of(narrow, np.random.default_rng(0), 4)
    spreads = {n: spread(n, narrow, observations, 60) for n in ("condensation", "rb-hs-sir", "ls-hs-sir", "unscented")}
    assert spreads["ls-hs-sir"] < 0.6 * min(spreads["condensation"], spreads["rb-hs-sir"])
    assert spreads["unscented"] < 0.5 * spreads["condensation"]


def test_hs_sir_draws_innovations_by_their_weights():
    """Chi-square of J over twenty groups of innovations."""
    model, particles, observation = weighted_histories(2, 1)
    record = make_filter("hs-sir", 20_000, resampling="multinomial").step(step_rng(0, 1), model, particles, observation)
    weighed, chosen = record.stage("weight"), record.stage("resample")
    assert weighed is not None and chosen is not None and chosen.ancestors is not None
    groups = np.arange(20_000) % 20
    counts = np.bincount(groups[chosen.ancestors], minlength=20)
    shares = np.bincount(groups, weighed.particles.weights)
    assert stats.chisquare(counts, 20_000 * shares).pvalue > 1e-6
    assert [stage.kind for stage in record.stages] == ["propose", "weight", "resample", "associate", "complete"]
    np.testing.assert_allclose(record.posterior.weights, 1 / 20_000)


def test_hs_sir_draws_histories_given_the_innovation():
    """Chi-square of I given J: each history's count against the sum of its probabilities over the drawn innovations."""
    model, particles, observation = weighted_histories(1, 1, count=8)
    record = make_filter("hs-sir", 4000).step(step_rng(0, 1), model, particles, observation)
    association = record.association
    assert association is not None
    joint = np.exp(association.log_joint(np.arange(4000)))
    expected = (joint / joint.sum(axis=1, keepdims=True)).sum(axis=0)
    assert stats.chisquare(np.bincount(record.histories, minlength=8), expected).pvalue > 1e-6
    chosen = record.stage("resample")
    assert chosen is not None
    np.testing.assert_array_equal(association.innovations, chosen.particles.innovation)


def test_hs_sir_draws_last_where_the_detector_covers_a_subspace():
    model, particles, observation = weighted_histories(1, 2, (1,))
    record = make_filter("hs-sir", N).step(step_rng(0, 1), model, particles, observation)
    kinds = ["propose", "associate", "complete", "weight", "resample"]
    assert [stage.kind for stage in record.stages] == kinds
    np.testing.assert_allclose(record.posterior.weights, 1 / N)


def test_innovation_sir_keeps_histories_and_draws_innovations():
    model, particles, observation = weighted_histories(2, 1, count=1000)
    record = make_filter("innovation-sir", 1000, ess_threshold=0.0).step(step_rng(0, 1), model, particles, observation)
    np.testing.assert_array_equal(record.histories, np.arange(1000))
    association = record.association
    proposed = record.stage("propose")
    assert association is not None and proposed is not None
    pool = proposed.particles.innovation
    row = [
        np.exp(model.log_likelihood(u[None], observation)[0] - model.proposal(observation).log_density(u[None])[0])
        * multivariate_normal(model.dynamics.predict(particles.states[[3]])[0], model.dynamics.noise_covariance).pdf(u)
        for u in pool
    ]
    np.testing.assert_allclose(association.pool_row(3), row / np.sum(row), rtol=1e-6)
    stage = record.stage("associate")
    assert stage is not None and stage.ancestors is not None
    groups = np.arange(1000) % 10
    expected = sum(np.bincount(groups, association.pool_row(i)) for i in range(1000))
    assert stats.chisquare(np.bincount(groups[stage.ancestors]), expected).pvalue > 1e-6
    with pytest.raises(ValueError, match="no innovations were drawn by histories"):
        make_filter("rb-hs-sir", 20).step(step_rng(0, 1), model, particles, observation).association.pool_row(0)  # type: ignore[union-attr]


def test_icondensation_is_visibly_biased():
    """With importance sampling alone the innovation of one step is right, what it is joined to is not."""
    setting = weighted_histories(2, 1)
    z = one_step_z("icondensation", *setting, seeds=300, importance=1.0, reinitialise=0.0)
    assert abs(z["one"]) < 5 and abs(z["mean"]) < 5 and abs(z["second moment"]) < 5
    assert abs(z["some histories"]) > 10
    assert abs(z["joint"]) > 10


def test_icondensation_in_order_one_has_no_history_to_be_wrong_about():
    setting = weighted_histories(1, 1)
    z = one_step_z("icondensation", *setting, seeds=300, importance=1.0, reinitialise=0.0)
    assert max(abs(z[key]) for key in ("one", "mean", "second moment")) < 5


def test_re_initialisation_biases_the_evidence():
    setting = weighted_histories(2, 1)
    probabilities = {"importance": 0.0, "reinitialise": 0.3}
    assert abs(one_step_z("icondensation", *setting, seeds=200, **probabilities)["one"]) > 10
    repaired = one_step_z("icondensation", *setting, seeds=200, repaired=True, **probabilities)
    assert max(map(abs, repaired.values())) < 5


def test_the_re_initialised_have_no_history_and_sit_on_the_proposal():
    model, particles, observation = weighted_histories(2, 2, (1,), count=4000)
    record = make_filter("icondensation", 4000).step(step_rng(0, 1), model, particles, observation)
    anew = record.histories < 0
    assert abs(anew.mean() - 0.1) < 5 * np.sqrt(0.09 / 4000)
    proposed = record.stage("propose")
    assert proposed is not None
    np.testing.assert_allclose(record.posterior.innovation[anew, 1], proposed.particles.innovation[anew, 0])
    velocity = record.posterior.states[anew, 0, 1] - record.posterior.states[anew, 1, 1]
    prior = model.prior
    expected = prior.mean[1] - prior.mean[3]
    assert abs(z_scores(velocity, expected)) < 5
    correlation = np.corrcoef(velocity, record.posterior.innovation[anew, 1])[0, 1]
    assert abs(correlation) < 0.3, "the velocity is the prior's, wherever the particle was put"
    repaired = make_filter("icondensation", 4000, repaired=True)
    assert (repaired.step(step_rng(0, 1), model, particles, observation).histories >= 0).all()


def test_ls_n_ips_overestimates_the_evidence_always():
    """On the same random numbers every particle climbs from where CONDENSATION left it."""
    model, particles, observation = weighted_histories(2, 1)
    for seed in range(20):
        plain, searched = (
            make_filter(name, N).step(step_rng(seed, 1), model, particles, observation)
            for name in ("condensation", "ls-n-ips")
        )
        before, after = plain.stage("predict"), searched.stage("search")
        assert before is not None and after is not None
        gain = searched.stages[-1].log_factors["likelihood"] - plain.stages[-1].log_factors["likelihood"]
        assert (gain >= 0).all() and gain.max() > 0
        moved = after.particles.innovation - before.particles.innovation
        assert np.abs(moved).max() <= model.dynamics.noise_factor.item()
        assert searched.log_evidence > plain.log_evidence
    z = one_step_z("ls-n-ips", model, particles, observation, seeds=100)
    assert z["one"] > 10


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_local_search_climbs_within_its_radius(dimension):
    model = random_model(np.random.default_rng(dimension), 1, dimension)
    start = np.random.default_rng(0).standard_normal((50, dimension))
    observation = np.zeros(dimension)
    found = LocalSearch(radius=1.5, rounds=5)(model, observation, start)
    assert (found.log_likelihood >= model.log_likelihood(start, observation)).all()
    np.testing.assert_allclose(model.log_likelihood(found.points, observation), found.log_likelihood)
    moved = np.linalg.solve(model.dynamics.noise_factor, (found.points - start).T)
    assert np.linalg.norm(moved, axis=0).max() < 1.5
    assert found.evaluations == 50 * (1 + 2 * dimension * 5)


def test_local_search_finds_a_peak_to_the_last_step():
    model = random_model(np.random.default_rng(1), 1, 1)
    sigma = model.dynamics.noise_factor.item()
    start = np.linspace(-0.9, 0.9, 37)[:, None] * sigma
    found = LocalSearch(radius=1.0, rounds=4)(model, np.zeros(1), start)
    assert np.abs(found.points).max() <= sigma / 16 + 1e-12


@pytest.mark.parametrize("route", ["observation function", "log-likelihood"])
@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_unscented_is_optimal_where_the_model_is_linear(dimension, route):
    """The weight of a particle is p(y | x_i) whatever was drawn for it, and what is drawn follows p(x1' | x_i, y)."""
    model, particles, observation = weighted_histories(2, dimension)

    class NoFunction:
        dynamics, log_likelihood = model.dynamics, model.log_likelihood
        proposal, sample_prior = model.proposal, model.sample_prior

    asked: Any = model if route == "observation function" else NoFunction()
    filter_ = make_filter("unscented", N, defence=0.0, ess_threshold=0.0)
    record = filter_.step(step_rng(0, 1), asked, particles, observation)
    means = model.dynamics.predict(particles.states)
    total = model.dynamics.noise_covariance + model.observed.covariance
    expected = [multivariate_normal(m, total).logpdf(observation) for m in means]
    np.testing.assert_allclose(sum(record.stages[-1].log_factors.values()), expected, atol=1e-6)
    fit = 0 if route == "observation function" else 1 + 2 * dimension + dimension * (dimension - 1) // 2
    assert record.likelihood_evaluations == N * (1 + fit)

    gain = model.dynamics.noise_covariance @ np.linalg.inv(total)
    covariance = model.dynamics.noise_covariance - gain @ model.dynamics.noise_covariance
    deviations = record.posterior.innovation - means - (observation - means) @ gain.T
    whitened = np.linalg.solve(np.linalg.cholesky(covariance), deviations.T).ravel()
    assert stats.kstest(whitened, "norm").pvalue > 1e-6


def test_innovations_are_drawn_about_what_the_scouts_found():
    model, particles, observation = weighted_histories(1, 2, (1,))
    record = make_filter("ls-hs-sir", N, scouts=0.2, bandwidth=0.3).step(step_rng(0, 1), model, particles, observation)
    proposed = record.stage("propose")
    assert proposed is not None and isinstance(proposed.proposal, FoundPlaces)
    found = proposed.proposal
    assert len(found.places) == 20 and found.components == (0, 1)
    np.testing.assert_allclose(found.covariance, 0.09 * model.dynamics.noise_covariance)
    assert (
        model.log_likelihood(found.places, observation).mean()
        > model.log_likelihood(found.predicted, observation).mean()
    )
    assert record.likelihood_evaluations == N + 20 * (1 + 2 * 2 * 3)


@pytest.mark.parametrize("dimension", [1, 2])
def test_the_density_of_found_places_is_that_of_its_draws(dimension):
    rng = np.random.default_rng(dimension)
    shares = np.log(rng.dirichlet(np.ones(4)))
    weights = np.log(rng.dirichlet(np.ones(6)))
    eye = np.eye(dimension)
    places = FoundPlaces(
        rng.standard_normal((4, dimension)), shares, 0.1 * eye, rng.standard_normal((6, dimension)), weights, eye, 0.3
    )
    drawn = places.sample(rng, 20_000)
    for mean in (*places.places, *places.predicted):
        test = multivariate_normal(mean, 0.1 * eye)
        assert abs(z_scores(test.pdf(drawn) / np.exp(places.log_density(drawn)), 1.0)) < 5


def test_auxiliary_counts_its_likelihoods():
    model, particles, observation = weighted_histories(2, 1)
    for draws, evaluations in ((None, 2 * N), (5 * N, 6 * N)):
        record = make_filter("auxiliary", N, draws=draws).step(step_rng(0, 1), model, particles, observation)
        assert record.likelihood_evaluations == evaluations
        assert len(record.posterior) == N


def test_auxiliary_first_stage_weights():
    model, particles, observation = weighted_histories(2, 1)
    record = make_filter("auxiliary", N, defence=0.2).step(step_rng(0, 1), model, particles, observation)
    ahead = model.log_likelihood(model.dynamics.predict(particles.states), observation)
    looked = particles.weights * np.exp(ahead)
    expected = 0.8 * looked / looked.sum() + 0.2 * particles.weights
    np.testing.assert_allclose(record.stages[0].particles.weights, expected)


@pytest.mark.parametrize(
    ("name", "settings", "message"),
    [
        ("icondensation", {"importance": 0.8, "reinitialise": 0.3}, "must sum to at most 1, got 0.8 and 0.3"),
        ("icondensation", {"importance": -0.1}, "importance must be between 0 and 1, got -0.1"),
        ("auxiliary", {"draws": 5}, "draws must be a whole number of at least n_particles, got 5"),
        ("auxiliary", {"defence": 2}, "defence must be between 0 and 1, got 2"),
        ("unscented", {"defence": "x"}, "defence must be between 0 and 1, got 'x'"),
        ("ls-n-ips", {"radius": 0}, "radius must be positive, got 0"),
        ("ls-n-ips", {"rounds": 0}, "rounds must be a whole number of at least 1, got 0"),
        ("ls-hs-sir", {"bandwidth": -1.0}, "bandwidth must be positive, got -1.0"),
        ("ls-hs-sir", {"defence": 0.0}, "defence must be positive"),
        ("ls-hs-sir", {"scouts": 1.5}, "scouts must be between 0 and 1, got 1.5"),
        ("hs-sir", {"resampling": "none"}, "resampling must be one of"),
        ("innovation-sir", {"ess_threshold": 7}, "ess_threshold must be between 0 and 1, got 7"),
    ],
)
def test_settings_out_of_range_are_named(name, settings, message):
    with pytest.raises(FilterError, match=message):
        make_filter(name, 10, **settings)
