"""A receipt must add up: its numbers multiply to the weight that is shown, for every filter."""

import numpy as np
import pytest
from pfviz_app.receipt import receipt, receipt_html

from pfviz.filters import FILTERS, make_filter
from pfviz.particles import ParticleSet
from pfviz.record import Stage, StepRecord
from pfviz.running import run
from pfviz.worlds import get_world


@pytest.fixture(scope="module", params=FILTERS)
def record(request):
    world = get_world("figure-1")
    observations = world.record(3, 4).observations
    return list(run(make_filter(request.param, 25), world.model, observations, seed=1))[-1]


def test_the_numbers_multiply_to_the_weight(record):
    weights = record.stage("weight").particles.weights
    for index in range(25):
        slip = receipt(record, index)
        product = slip.before * np.prod([value for _, value in slip.factors]) / slip.normaliser
        assert product == pytest.approx(weights[index], rel=1e-9)
        assert slip.weight == pytest.approx(weights[index], rel=1e-12)
        assert slip.rank == 1 + sum(weights > weights[index])


def test_all_share_one_normaliser(record):
    normalisers = [receipt(record, index).normaliser for index in range(25)]
    np.testing.assert_allclose(normalisers, normalisers[0], rtol=1e-9)


def test_the_history_is_the_one_that_the_particle_continues(record):
    stage = record.stage("complete") or record.stage("predict")
    weighed = record.stage("weight").particles
    for index in range(25):
        slip = receipt(record, index)
        if slip.history >= 0:
            pairs = stage.particles.states[np.isclose(stage.particles.states[:, 0, 0], weighed.innovation[index, 0])]
            continued = record.previous.states[slip.history, 0, 0]
            moved = record.stage("search") is not None
            assert moved or continued in pairs[:, 1, 0]


def test_its_most_probable_histories_are_probabilities_in_order(record):
    for index in range(25):
        probabilities = [probability for _, probability in receipt(record, index).choices]
        assert probabilities == sorted(probabilities, reverse=True)
        assert sum(probabilities) <= 1 + 1e-9


def test_there_is_none_for_a_particle_that_does_not_exist(record):
    assert receipt(record, 25) is None
    assert receipt(record, -1) is None


def test_on_screen_it_shows_weight_and_factors(record):
    slip = receipt(record, 3)
    page = receipt_html(slip, dark=False)
    assert f"{slip.weight:.5g}" in page and "Particle 3" in page
    assert "Click a particle" in receipt_html(None, dark=True)


def test_copies_of_a_history_count_together(record):
    """A filter that ends by resampling leaves copies, and a row of copies would say nothing."""
    states = [state.tobytes() for state in record.previous.states]
    for index in range(25):
        slip = receipt(record, index)
        shown = [states[i] for i, probability in slip.choices if probability > 1e-9]
        assert len(set(shown)) == len(shown)
        assert all(states.index(states[i]) == i for i, probability in slip.choices if probability > 1e-9)
        assert slip.history < 0 or states.index(states[slip.history]) == slip.history


def test_a_particle_of_no_weight_has_a_receipt_too():
    """Uniform noise explains some particles not at all."""
    stage_set = ParticleSet(np.zeros((3, 1, 1)), np.log([0.5, 0.5, 1e-300]))
    likelihood = np.array([0.0, -np.inf, -1.0])
    weighed = ParticleSet(np.zeros((3, 1, 1)), stage_set.log_weights + likelihood + np.log(2.0))
    stages = (
        Stage("predict", stage_set, np.arange(3), np.arange(3)),
        Stage("weight", weighed, np.arange(3), np.arange(3), {"likelihood": likelihood}),
    )
    slip = receipt(StepRecord(np.zeros(1), stage_set, stages, 0.0), 1)
    assert slip.weight == 0.0 and slip.normaliser == pytest.approx(0.5)
    assert "nan" not in receipt_html(slip, dark=False)
