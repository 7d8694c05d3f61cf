"""What every filter records: receipts that add up, ancestry that holds, replay byte for byte, shared random numbers."""

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from oracles import observations_of, random_model
from scipy import stats

from pfviz.dynamics import Autoregression
from pfviz.filters import FILTERS, make_filter
from pfviz.model import is_missing
from pfviz.particles import ParticleSet, log_sum_exp
from pfviz.randomness import step_rng
from pfviz.record import Stage, StepRecord
from pfviz.running import run
from pfviz.worlds import ToyModel, get_world

every_filter = pytest.mark.parametrize("name", FILTERS)
MODELS = {"line": (2, 1, None), "plane": (1, 2, None), "subspace": (2, 3, (0, 2))}


def model_of(case: str) -> ToyModel:
    return random_model(np.random.default_rng(3), *MODELS[case])


def records(name: str, case: str, steps: int = 3, n_particles: int = 20, seed: int = 0) -> list[StepRecord]:
    model = model_of(case)
    observations = observations_of(model, np.random.default_rng(4), steps)
    return list(run(make_filter(name, n_particles), model, observations, seed))


def before(record: StepRecord, index: int) -> ParticleSet:
    return record.stages[index - 1].particles if index else record.previous


def same(a: Any, b: Any) -> bool:
    """Whether two records are equal to the last bit, fields and arrays and all."""
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and a.tobytes() == b.tobytes()
    if isinstance(a, (ParticleSet, Stage, StepRecord)):
        return all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, dict):
        return list(a) == list(b) and all(same(a[key], b[key]) for key in a)
    return type(a) is type(b) and (isinstance(a, (str, int, float)) is False or a == b)


@pytest.mark.parametrize("case", MODELS)
@every_filter
def test_a_weight_is_the_previous_one_times_the_factors(name, case):
    for record in records(name, case):
        weighed = [i for i, stage in enumerate(record.stages) if stage.log_factors]
        assert weighed and record.stages[weighed[-1]].kind == "weight"
        for i in weighed:
            stage = record.stages[i]
            assert stage.ancestors is not None
            total = before(record, i).log_weights[stage.ancestors] + sum(stage.log_factors.values())
            expected = total - log_sum_exp(total)
            np.testing.assert_allclose(stage.particles.weights, np.exp(expected), rtol=1e-9, atol=1e-300)


@pytest.mark.parametrize("case", MODELS)
@every_filter
def test_evidence_is_the_log_of_the_summed_weights(name, case):
    for record in records(name, case):
        index = max(i for i, stage in enumerate(record.stages) if stage.kind == "weight")
        stage = record.stages[index]
        total = before(record, index).log_weights + sum(stage.log_factors.values())
        assert record.log_evidence == pytest.approx(log_sum_exp(total), abs=1e-9)


@pytest.mark.parametrize("case", MODELS)
@every_filter
def test_posterior_particles_continue_the_histories_they_name(name, case):
    for record in records(name, case):
        known = record.histories >= 0
        assert len(record.histories) == len(record.posterior)
        np.testing.assert_array_equal(
            record.posterior.history[known], record.previous.states[record.histories[known], :-1]
        )


@pytest.mark.parametrize("case", MODELS)
@every_filter
def test_ancestors_lead_from_stage_to_stage(name, case):
    for record in records(name, case):
        for i, stage in enumerate(record.stages):
            if stage.ancestors is None:
                assert stage.kind == "propose"
                continue
            assert len(stage.ancestors) == len(stage.particles)
            assert stage.ancestors.min() >= 0 and stage.ancestors.max() < len(before(record, i))
            if stage.kind in ("weight", "resample"):
                parents = before(record, i).states[stage.ancestors]
                np.testing.assert_array_equal(stage.particles.states, parents)


@every_filter
def test_equal_seeds_give_equal_bytes(name):
    first, second, other = records(name, "plane"), records(name, "plane"), records(name, "plane", seed=1)
    assert all(map(same, first, second))
    assert not same(first[0].posterior, other[0].posterior)


@every_filter
def test_any_step_replays_alone(name):
    model = model_of("line")
    observations = observations_of(model, np.random.default_rng(4), 4)
    whole = list(run(make_filter(name, 20), model, observations, seed=9))
    again = make_filter(name, 20).step(step_rng(9, 4), model, whole[2].posterior, observations[3])
    assert same(again, whole[3])


@pytest.mark.parametrize("case", MODELS)
def test_filters_in_lock_step_share_their_proposal_draws(case):
    names = ["basic-sir", "rb-hs-sir", "rb-ss-hs-sir"]
    for together in zip(*(records(name, case) for name in names), strict=True):
        stages = [record.stage("propose") for record in together]
        draws = {stage.particles.states.tobytes() for stage in stages if stage is not None}
        assert len(draws) == 1


def test_filters_start_from_the_same_prior_draws():
    model = model_of("plane")
    states = {make_filter(n, 20).initial(step_rng(1, 0), model).states.tobytes() for n in FILTERS}
    assert len(states) == 1


@every_filter
def test_likelihoods_are_counted(name):
    evaluated = []

    class Counting:
        """The model, with an eye on its likelihood."""

        def __init__(self, model: ToyModel) -> None:
            self.model = model

        def __getattr__(self, attribute: str) -> Any:
            return getattr(self.model, attribute)

        def log_likelihood(self, innovation: np.ndarray, observation: Any) -> np.ndarray:
            evaluated.append(len(innovation))
            return self.model.log_likelihood(innovation, observation)

    model = Counting(model_of("plane"))
    observations = observations_of(model.model, np.random.default_rng(4), 2)
    recorded = list(run(make_filter(name, 20), model, observations))  # type: ignore[arg-type]
    assert sum(evaluated) == sum(record.likelihood_evaluations for record in recorded)


@every_filter
def test_a_missing_observation_only_predicts(name):
    model = model_of("line")
    particles = make_filter(name, 2000).initial(step_rng(0, 0), model)
    record = make_filter(name, 2000).step(step_rng(0, 1), model, particles, np.array([np.nan]))
    assert record.condition == "missing" and record.log_evidence == 0.0
    assert record.likelihood_evaluations == 0
    np.testing.assert_array_equal(record.posterior.weights, particles.weights)
    np.testing.assert_array_equal(record.posterior.history[:, 0], particles.innovation)
    deviations = record.posterior.innovation - model.dynamics.predict(particles.states)
    z = deviations.mean() / np.sqrt(model.dynamics.noise_covariance.item() / 2000)
    assert abs(z) < 5
    assert stats.kstest(deviations[:, 0] / model.dynamics.noise_factor.item(), "norm").pvalue > 1e-6


@pytest.mark.parametrize(
    ("observation", "missing"),
    [(None, True), (np.nan, True), (np.array([1.0, np.nan]), True), (np.zeros(2), False), ("features", False)],
)
def test_what_a_missing_observation_is(observation, missing):
    assert is_missing(observation) is missing


def test_dynamics_that_draw_in_their_own_way_are_asked():
    """The compiled propagation is for a plain autoregression; a kind of it with other noise draws for itself."""

    class Jumpy(Autoregression):
        def sample(self, rng: np.random.Generator, states: np.ndarray) -> np.ndarray:
            return self.predict(states) + 100.0

    model = model_of("line")
    dynamics = Jumpy(model.dynamics.coefficients, model.dynamics.noise_covariance, model.dynamics.mean)
    record = next(run(make_filter("condensation", 5), replace(model, dynamics=dynamics), [np.array([np.nan])]))
    np.testing.assert_allclose(record.posterior.innovation, dynamics.predict(record.previous.states) + 100.0)


def test_history_draws_follow_the_association():
    """Chi-square of the draw of I: many innovations at one place, histories of uneven weight."""
    world = get_world("figure-1")
    rng = np.random.default_rng(0)
    particles = ParticleSet(rng.normal(0.0, 0.15, (8, 2, 1)), np.log(rng.dirichlet(np.ones(8))))

    class OnePlace:
        components = (0,)

        def sample(self, rng: np.random.Generator, count: int) -> np.ndarray:
            return np.full((count, 1), 0.05)

        def log_density(self, proposed: np.ndarray) -> np.ndarray:
            return np.zeros(len(proposed))

    class Model:
        dynamics, sample_prior = world.model.dynamics, world.model.sample_prior
        log_likelihood = world.model.log_likelihood

        def proposal(self, observation: Any) -> OnePlace:
            return OnePlace()

    record = make_filter("rb-hs-sir", 20_000).step(step_rng(0, 1), Model(), particles, np.zeros(1))  # type: ignore[arg-type]
    assert record.association is not None
    counts = np.bincount(record.histories, minlength=8)
    assert stats.chisquare(counts, 20_000 * record.association.row(0)).pvalue > 1e-6
    assert (record.association.chosen == record.histories).all()


def test_a_flat_likelihood_leaves_the_weights_alone():
    model = model_of("line")
    rng = np.random.default_rng(1)
    particles = ParticleSet(rng.standard_normal((30, 2, 1)), np.log(rng.dirichlet(np.ones(30))))

    class Flat:
        dynamics, sample_prior, proposal = model.dynamics, model.sample_prior, model.proposal

        def log_likelihood(self, innovation: np.ndarray, observation: Any) -> np.ndarray:
            return np.full(len(innovation), -1.25)

    filter_ = make_filter("condensation", 30, ess_threshold=0.0)
    record = filter_.step(step_rng(0, 1), Flat(), particles, np.zeros(1))  # type: ignore[arg-type]
    np.testing.assert_allclose(record.posterior.weights, particles.weights, rtol=1e-12)
    assert record.log_evidence == pytest.approx(-1.25)
