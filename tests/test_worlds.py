"""The toy worlds: seeded, described, and showing what they say."""

import numpy as np
import pytest

from pfviz.filters import FILTERS, make_filter
from pfviz.model import Model
from pfviz.names import UnknownName
from pfviz.running import run
from pfviz.worlds import WORLDS, Detector, World, get_world

every_world = pytest.mark.parametrize("world", WORLDS.values(), ids=list(WORLDS))


@every_world
def test_a_world_is_a_model_with_a_sentence_on_what_to_look_for(world: World):
    assert isinstance(world.model, Model)
    assert WORLDS[world.name] is world
    assert world.title and len(world.look_for.split()) > 8 and world.look_for[-1] in ".?"


@every_world
def test_a_seed_gives_one_recording(world: World):
    first, again, other = world.record(1, 10), world.record(1, 10), world.record(2, 10)
    assert len(first) == 10 and first.truth.shape == (10, world.model.dynamics.dimension)
    assert first.truth.tobytes() == again.truth.tobytes()
    assert all(a.tobytes() == b.tobytes() for a, b in zip(first.observations, again.observations, strict=True))
    assert first.truth.tobytes() != other.truth.tobytes()
    longer = world.record(1, 20)
    assert longer.truth[:10].tobytes() == first.truth.tobytes()


@every_world
def test_the_truth_stays_in_the_picture(world: World):
    outside = [np.abs(world.record(seed, 100).truth) > world.extent for seed in range(20)]
    assert np.mean(outside) < 0.02


@every_world
def test_the_proposal_covers_the_observation(world: World):
    recording = world.record(0, 20)
    for truth, observation in zip(recording.truth, recording.observations, strict=True):
        log_density = world.model.proposal(observation).log_density(truth[None])
        assert np.isfinite(log_density).all()


@pytest.mark.parametrize("filter_name", FILTERS)
@every_world
def test_every_filter_runs_in_every_world(world: World, filter_name: str):
    recording = world.record(0, 5)
    for record in run(make_filter(filter_name, 50), world.model, recording.observations):
        assert np.isfinite(record.estimate).all()


@every_world
def test_noises_are_scaled(world: World):
    model = world.model.with_noise(system=2.0, observation=3.0, proposal=0.5)
    np.testing.assert_allclose(model.dynamics.noise_covariance, 4.0 * world.model.dynamics.noise_covariance)
    observation = world.record(0, 1).observations[0]
    narrow, wide = model.proposal(observation), world.model.proposal(observation)
    np.testing.assert_allclose(4.0 * narrow.covariance, wide.covariance)


def test_a_detector_answers_around_what_it_detects():
    detector = Detector(0.5, np.array([[-1.0, 0.0], [1.0, 0.0]]), np.array([3.0, 1.0]), gain=0.5)
    one = detector(np.array([2.0, 4.0]))
    np.testing.assert_allclose(one.means, [[0.0, 2.0], [2.0, 2.0]])
    np.testing.assert_allclose(one.weights, [0.75, 0.25])
    two = detector(np.array([[2.0, 4.0], [0.0, 0.0]]))
    np.testing.assert_allclose(two.means, [[0.0, 2.0], [2.0, 2.0], [-1.0, 0.0], [1.0, 0.0]])
    np.testing.assert_allclose(two.weights, [0.375, 0.125, 0.375, 0.125])


def test_basic_sir_wastes_its_particles_where_history_sampling_does_not():
    """The world of Figures 1 and 2: the mean ESS over a recording, as a share of N."""
    world = get_world("figure-1")
    share = {}
    for name in ("basic-sir", "rb-hs-sir"):
        sizes = [
            record.effective_sample_size / world.n_particles
            for seed in range(5)
            for record in run(
                make_filter(name, world.n_particles), world.model, world.record(seed, 30).observations, seed
            )
        ]
        share[name] = np.mean(sizes)
    assert share["basic-sir"] < 0.25
    assert share["rb-hs-sir"] > 2 * share["basic-sir"]


def test_zero_steps_are_refused():
    with pytest.raises(ValueError, match="steps must be at least 1, got 0"):
        get_world("plane").record(0, 0)


def test_the_nearest_world_is_suggested():
    with pytest.raises(UnknownName, match="did you mean 'plane'"):
        get_world("plan")
