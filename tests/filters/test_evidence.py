"""The evidence over whole runs, against Kalman: E[Z estimated / Z] = 1 for every filter that claims it."""

from functools import cache

import numpy as np
import pytest
from oracles import as_linear_gaussian, observations_of, random_model, textbook_kalman, z_scores

from pfviz.filters import FILTERS, make_filter
from pfviz.running import run
from pfviz.worlds import ToyModel, get_world

UNBIASED = [name for name, info in FILTERS.items() if info.unbiased]
SLICE = ["condensation", "basic-sir", "rb-hs-sir", "rb-ss-hs-sir"]


def ratios(name: str, model: ToyModel, films, n_particles: int, **settings) -> np.ndarray:
    """``(len(films),)``: the estimated evidence of each film over the exact one; film number = seed."""
    filter_ = make_filter(name, n_particles, **settings)
    linear = as_linear_gaussian(model)
    exact: dict[int, float] = {}
    for film in films:
        if id(film) not in exact:
            exact[id(film)] = sum(answer.log_evidence for answer in textbook_kalman(linear, film))
    estimates = [
        sum(record.log_evidence or 0.0 for record in run(filter_, model, film, seed)) for seed, film in enumerate(films)
    ]
    return np.exp(np.array(estimates) - [exact[id(film)] for film in films])


@cache
def recorded_films(count: int, steps: int) -> list[tuple[np.ndarray, ...]]:
    return [get_world("linear-gaussian").record(seed, steps).observations for seed in range(count)]


@pytest.mark.parametrize("name", SLICE)
def test_linear_gaussian_world(name):
    world = get_world("linear-gaussian")
    films = recorded_films(200, 20)
    assert abs(z_scores(ratios(name, world.model, films, 100), 1.0)) < 5


@pytest.mark.parametrize("order", [1, 2, 4])
@pytest.mark.parametrize("name", UNBIASED)
def test_random_models_in_a_few_steps(name, order):
    dimension = {1: 3, 2: 2, 4: 1}[order]
    components = (0, 2) if dimension == 3 else None
    rng = np.random.default_rng(order)
    model = random_model(rng, order, dimension, components)
    observations = observations_of(model, rng, 4)
    assert abs(z_scores(ratios(name, model, [observations] * 150, 40), 1.0)) < 5


@pytest.mark.parametrize(
    ("threshold", "scheme"),
    [
        (0.0, "systematic"),
        (0.5, "systematic"),
        (0.5, "multinomial"),
        (1.0, "residual"),
        (1.0, "stratified"),
        (1.0, "multinomial"),
    ],
)
@pytest.mark.parametrize("name", ["condensation", "basic-sir"])
def test_weights_are_carried_into_the_evidence_when_not_resampling(name, threshold, scheme):
    rng = np.random.default_rng(11)
    model = random_model(rng, 2, 1)
    observations = observations_of(model, rng, 4)
    settings = {"resampling": scheme, "ess_threshold": threshold}
    assert abs(z_scores(ratios(name, model, [observations] * 250, 40, **settings), 1.0)) < 5


def test_history_sampling_has_the_smaller_variance():
    world = get_world("figure-1")
    films = [world.record(0, 6).observations] * 60
    plain, history = (np.log(ratios(name, world.model, films, 40)).std() for name in ("basic-sir", "rb-hs-sir"))
    assert history < 0.7 * plain
