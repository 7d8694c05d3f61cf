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
from pfviz.worlds import WORLDS, World, get_world


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
    observations = film.world.record(5, 4).observations
    expected = run(make_filter(filter_name, 20), model, observations, seed=5)
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
    believed = room.exact.marginal(1).covariance[0, 0]
    room.rewind(0)
    room.configure("condensation", doubting, 10)
    room.step()
    assert room.exact.marginal(1).covariance[0, 0] > believed


def test_a_world_without_an_exact_answer_has_none():
    room = toy_room(world="plane")
    room.step()
    assert room.exact.marginal(1) is None
    assert np.isnan(room.exact.log_evidence(1))


@pytest.mark.parametrize("world", WORLDS)
def test_a_seed_is_a_film(world):
    films = [ToyFilm(get_world(world), seed) for seed in (1, 1, 2)]
    seen = [np.concatenate([np.ravel(film.observe(t, None)) for t in range(1, 21)]) for film in films]
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
    model, exact = film.model(1.0, 1.0, 1.0), film.exact()
    answers = {}
    for t in range(1, 61):
        exact.step(t, model, film.observe(t, model))
        answers[t] = (exact.marginal(t).mean, exact.log_evidence(t))
    for t in (60, 20, 1):
        exact.step(t, model, film.observe(t, model))
        np.testing.assert_allclose(exact.marginal(t).mean, answers[t][0], atol=1e-12)
        assert exact.log_evidence(t) == pytest.approx(answers[t][1])
        assert exact.marginal(t + 1) is None


def test_a_room_can_be_forked_and_neither_sees_what_the_other_does():
    room = toy_room(seed=3)
    records = steps(room, 5)
    other = room.fork(3)
    assert (room.trace.last, other.trace.last) == (5, 3)
    again = steps(other, 2)
    assert [fingerprint(record) for record in again] == [fingerprint(record) for record in records[3:]]
    other.configure("condensation", other.film.model(2.0, 1.0, 1.0), 20)
    other.rewind(1)
    steps(other, 1)
    assert room.trace[2] is records[1] and room.outcome(2).filter_name != "condensation"
    assert room.exact.marginal(5) is not None and other.exact.marginal(5) is None


def test_the_log_evidence_of_a_room_is_the_sum_of_its_steps_and_near_the_exact_one():
    room = toy_room("rb-hs-sir", world="linear-gaussian", n_particles=500)
    records = steps(room, 10)
    np.testing.assert_allclose(room.log_evidences, np.cumsum([record.log_evidence for record in records]))
    exact = sum(room.exact.log_evidence(t) for t in range(1, 11))
    assert room.log_evidences[-1] == pytest.approx(exact, abs=1.5)


def test_a_target_that_is_taken_somewhere_is_there_and_goes_on_from_there():
    film, free = ToyFilm(get_world("recovery"), 2), ToyFilm(get_world("recovery"), 2)
    film.hold(5, np.array([3.5]))
    assert film.truth(4) == free.truth(4) and film.truth(5) == 3.5
    moved = film.truth(6) - free.truth(6)
    assert moved != 0 and film.observe(6, None) - free.observe(6, None) == pytest.approx(moved)
    film.hold(9, np.array([-1.0]))
    film.hold(7, np.array([1.0]))
    assert set(film.held) == {5, 7}, "what was done later is void"


class GoneVideo(DiscVideo):
    """The disc is taken away after frame 7 and comes back at 16."""

    def read(self, index):
        image = super().read(index)
        if not 8 <= index < 16:
            return image
        empty = np.full_like(image, 205)
        return empty


def test_an_object_that_is_gone_is_lost_and_found_again():
    film = VideoFilm(disc_setup(GoneVideo))
    room = Room(film, "rb-ss-hs-sir", film.model(1.0, 1.0, 1.0), 200, 0)
    steps(room, 28)
    lost = [room.outcome(t).lost for t in range(1, 29)]
    assert not any(lost[:8]) and lost[14]
    assert not any(lost[24:])
    assert room.errors[27] < 6.0
    again = room.fork(12)
    assert [again.outcome(t).lost for t in range(1, 13)] == lost[:12]
    assert fingerprint(again.step()) == fingerprint(room.trace[13])


def test_a_target_in_the_hand_is_not_followed_from_the_beginning_at_every_step(monkeypatch):
    begun, unfold = [], World.unfold
    monkeypatch.setattr(World, "unfold", lambda *given: begun.append(given) or unfold(*given))
    film = ToyFilm(get_world("linear-gaussian"), 1)
    held = {t: np.array([0.1 * t]) for t in (3, 4, 5, 8)}
    for t in range(1, 10):
        if t in held:
            film.hold(t, held[t])
        film.observe(t, None)
    assert len(begun) == 1
    again = ToyFilm(get_world("linear-gaussian"), 1, held)
    for t in range(1, 10):
        np.testing.assert_array_equal(film.observe(t, None), again.observe(t, None))
    film.hold(4, np.array([2.0]))
    assert (sorted(film.held), film.truth(4)) == ([3, 4], 2.0)
