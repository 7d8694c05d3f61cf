"""A room records what its filter did, and can do it again."""

import itertools

import numpy as np
import pytest
from pfviz_app import room as room_module
from pfviz_app.films import ToyFilm, VideoFilm
from pfviz_app.room import Room
from stand_ins import DiscVideo, centre, disc_setup

from pfviz import kernels
from pfviz.filters import FILTERS, make_filter
from pfviz.running import run
from pfviz.vision.video import EndOfVideo
from pfviz.worlds import WORLDS, get_world


@pytest.fixture(autouse=True)
def one_backend():
    """Kernels that are compiled in mid-test would change the last digits."""
    with kernels.use_numpy():
        yield


def toy_room(filter_name="rb-hs-sir", world="linear-gaussian", n_particles=20, seed=3):
    film = ToyFilm(get_world(world), seed)
    return Room(film, filter_name, film.model(1.0, 1.0, 1.0), n_particles, seed)


def disc_room(filter_name="rb-ss-hs-sir", n_particles=20, seed=3, **video):
    film = VideoFilm(disc_setup(lambda: DiscVideo(**video)))
    return Room(film, filter_name, film.model(1.0, 1.0, 1.0), n_particles, seed)


MAKERS = {"toy": toy_room, "video": disc_room}


def steps(room, count):
    return [room.step() for _ in range(count)]


def fingerprint(record):
    """Everything a step drew and weighed, as bytes."""
    parts = [record.previous, *(stage.particles for stage in record.stages)]
    arrays = [array for particles in parts for array in (particles.states, particles.log_weights)]
    arrays += [factor for stage in record.stages for factor in stage.log_factors.values()]
    arrays += [stage.ancestors for stage in record.stages if stage.ancestors is not None]
    return b"".join(array.tobytes() for array in arrays)


@pytest.mark.parametrize("filter_name", FILTERS)
@pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS)
def test_a_step_that_is_done_again_is_equal_byte_for_byte(make, filter_name):
    room = make(filter_name)
    first = steps(room, 5)
    room.rewind(2)
    assert room.trace.last == 2
    again = steps(room, 3)
    assert [fingerprint(record) for record in again] == [fingerprint(record) for record in first[2:]]
    assert not np.array_equal(first[3].posterior.states, first[4].posterior.states)


@pytest.mark.parametrize("filter_name", FILTERS)
def test_a_room_runs_as_the_library_does(filter_name):
    room = toy_room(filter_name, seed=5)
    film, model = room.film, room.film.model(1.0, 1.0, 1.0)
    expected = run(make_filter(filter_name, 20), model, film.recording.observations[:4], seed=5)
    for record, other in zip(steps(room, 4), expected, strict=True):
        assert fingerprint(record) == fingerprint(other)


@pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS)
def test_another_seed_is_another_run(make):
    assert fingerprint(make(seed=1).step()) != fingerprint(make(seed=2).step())


@pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS)
def test_each_step_begins_where_the_one_before_ended(make):
    room = make()
    records = steps(room, 4)
    assert records[0].previous is room.trace.initial
    for before, after in itertools.pairwise(records):
        assert after.previous is before.posterior


@pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS)
def test_what_is_kept_beside_the_records_goes_with_them(make):
    room = make()
    steps(room, 6)
    room.rewind(3)
    assert len(room.errors) == len(room.effective_sample_sizes) == len(room.times) == 3
    room.configure("condensation", room.film.model(2.0, 1.0, 1.0), 20)
    room.step()
    assert [room.outcome(t).filter_name for t in (3, 4)] == [room.outcome(1).filter_name, "condensation"]
    assert room.outcome(4).model is not room.outcome(3).model
    assert len(room.errors) == 4


@pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS)
@pytest.mark.parametrize("count", [1, 7, 20, 63])
def test_another_number_of_particles_holds_from_the_next_step(make, count):
    room = make()
    before = steps(room, 2)[-1].posterior
    room.configure("rb-hs-sir", room.film.model(1.0, 1.0, 1.0), count)
    record = room.step()
    assert len(record.previous) == len(record.posterior) == count
    known = {row.tobytes() for row in before.states}
    assert all(row.tobytes() in known for row in record.previous.states)


def test_particles_that_are_resized_keep_the_distribution():
    room = toy_room(n_particles=5)
    before = room.step().posterior
    room.configure("rb-hs-sir", room.film.model(1.0, 1.0, 1.0), 1000)
    previous = room.step().previous
    counts = np.array([(previous.states == state).all(axis=(1, 2)).sum() for state in before.states])
    assert np.abs(counts - 1000 * before.weights).max() <= 1.0
    np.testing.assert_allclose(previous.weights, 1e-3)


def test_the_error_is_the_distance_from_the_truth():
    room = toy_room(world="plane")
    records = steps(room, 3)
    distances = [np.linalg.norm(record.estimate - room.film.truth(t)) for t, record in enumerate(records, start=1)]
    np.testing.assert_allclose(room.errors, distances)


def test_the_error_on_video_is_in_pixels_from_the_true_centre():
    room = disc_room(n_particles=100)
    records = steps(room, 5)
    estimates = [room.film.setup.model.estimate(record) for record in records]
    distances = [np.hypot(e.x - centre(i)[0], e.y - centre(i)[1]) for i, e in enumerate(estimates)]
    np.testing.assert_allclose(room.errors, distances)
    assert max(distances) < 6.0


def test_the_exact_answer_of_a_room_is_that_of_the_model_believed_in():
    film = ToyFilm(get_world("linear-gaussian"), 1)
    true, doubting = film.model(1.0, 1.0, 1.0), film.model(1.0, 3.0, 1.0)
    room = Room(film, "condensation", true, 10, 1)
    room.step()
    believed = film.exact(1).covariance[0, 0]
    room.rewind(0)
    room.configure("condensation", doubting, 10)
    room.step()
    assert film.exact(1).covariance[0, 0] > believed


def test_a_world_without_an_exact_answer_has_none():
    room = toy_room(world="plane")
    room.step()
    assert room.film.exact(1) is None


@pytest.mark.parametrize("world", WORLDS)
def test_a_seed_is_a_film(world):
    films = [ToyFilm(get_world(world), seed) for seed in (1, 1, 2)]
    seen = [np.concatenate([np.ravel(y) for y in film.recording.observations[:20]]) for film in films]
    np.testing.assert_array_equal(seen[0], seen[1])
    assert not np.array_equal(seen[0], seen[2])


def test_the_film_ends_and_the_room_stays_as_it_was():
    room = disc_room(frame_count=4)
    steps(room, 4)
    assert room.film.length == 4
    with pytest.raises(EndOfVideo):
        room.step()
    assert room.trace.last == len(room.errors) == 4


def test_a_film_that_starts_later_is_shorter():
    film = VideoFilm(disc_setup(start_frame=25))
    assert film.length == 5
    film.image(1)
    assert film.source.reads == [25]


def test_records_are_forgotten_when_they_outgrow_their_memory(monkeypatch):
    monkeypatch.setattr(room_module, "_TRACE_BYTES", 40_000)
    room = toy_room(n_particles=50)
    records = steps(room, 30)
    assert 1 < room.trace.first < room.trace.last == 30
    kept = records[room.trace.first - 1 :]
    assert sum(record.nbytes for record in kept) <= 40_000
    assert len(room.errors) == len(room.effective_sample_sizes) == len(kept)
    distances = [np.linalg.norm(record.estimate - room.film.truth(t)) for t, record in enumerate(records, start=1)]
    np.testing.assert_allclose(room.errors, distances[room.trace.first - 1 :])


@pytest.mark.parametrize("world", ["linear-gaussian", "two-modes"])
def test_the_exact_answer_is_found_again_when_its_states_are_long_forgotten(world):
    film = ToyFilm(get_world(world), 2)
    model = film.model(1.0, 1.0, 1.0)
    means = {}
    for t in range(1, 61):
        film.observe(t, model)
        means[t] = film.exact(t).mean
    for t in (60, 20, 1, 45):
        film.observe(t, model)
        np.testing.assert_allclose(film.exact(t).mean, means[t], atol=1e-12)
