"""What a visitor asks for happens, and nothing a visitor asks for ends the session."""

import gc
import random
import threading
import weakref

import numpy as np
import pytest
from pfviz_app import room as room_module
from pfviz_app.commands import Click, Play, Reset, Resize, Seek, Set, Step, Walk
from pfviz_app.picture import Pick
from pfviz_app.settings import CONTROLS, Settings
from stand_ins import DiscVideo, Visit, disc_setup

from pfviz.filters import FILTERS
from pfviz.worlds import WORLDS

FEW = Settings(toy_particles=12, tracker_particles=15, speed=30.0)


@pytest.fixture(autouse=True)
def short_recordings(monkeypatch):
    """A toy's film takes a while to draw; no test here looks at more than these steps."""
    monkeypatch.setattr("pfviz_app.films.TOY_STEPS", 60)


@pytest.fixture
def visit():
    with Visit(FEW) as visit:
        yield visit


def numbers(picture):
    """What both rooms hold at the time that is shown."""
    records = [room.trace[picture.t] for room in (picture.toy, picture.tracker)]
    return [array for record in records for array in (record.posterior.states, record.posterior.log_weights)]


def same(first, second):
    return all(np.array_equal(a, b) for a, b in zip(first, second, strict=True))


def test_it_begins_paused_at_the_prior(visit):
    picture = visit.settled()
    assert (picture.t, picture.last, picture.playing, picture.message) == (0, 0, False, "")
    assert len(picture.toy.trace.initial) == 12
    assert len(picture.tracker.trace.initial) == 15


def test_steps_forward_are_recorded_and_steps_back_only_shown(visit):
    picture = visit.do(Step(), Step(), Step(2))
    assert (picture.t, picture.last) == (4, 4)
    fourth = numbers(picture)
    picture = visit.do(Step(-1), Step(-1))
    assert (picture.t, picture.last) == (2, 4)
    picture = visit.do(Step(2))
    assert (picture.t, picture.last) == (4, 4)
    assert same(numbers(picture), fourth)


def test_one_cannot_go_back_beyond_the_prior(visit):
    assert visit.do(Step(), Step(-5)).t == 0
    assert visit.do(Step(-1)).t == 0


@pytest.mark.parametrize(("asked", "shown"), [(0, 0), (2, 2), (5, 5), (99, 5), (-3, 0)])
def test_seeking_shows_what_is_recorded(visit, asked, shown):
    picture = visit.do(Step(5), Seek(asked))
    assert (picture.t, picture.last) == (shown, 5)


def test_seeking_computes_nothing():
    video = DiscVideo()
    with Visit(FEW, disc_setup(lambda: video)) as visit:
        visit.do(Step(4))
        before = list(video.reads)
        visit.do(Seek(1))
        visit.do(Seek(3))
        visit.do(Step(-2))
        assert video.reads == before


def test_both_rooms_are_always_at_the_same_time(visit):
    for command in (Step(), Step(3), Step(-2), Set("filter", "basic-sir"), Seek(0), Set("system", 2.0), Step()):
        picture = visit.do(command)
        assert picture.toy.trace.last == picture.tracker.trace.last == picture.last


def test_play_runs_on_until_it_is_paused(visit):
    visit.do(Play())
    picture = visit.screen.wait_for(lambda picture: picture.t >= 5)
    assert picture.playing
    picture = visit.do(Play())
    assert not picture.playing
    t = picture.t
    assert visit.settled().t == t


def test_play_can_be_told_what_to_do(visit):
    assert not visit.do(Play(False)).playing
    visit.do(Play(True), Play(True))
    assert visit.screen.wait_for(lambda picture: picture.t >= 2).playing


@pytest.mark.parametrize("command", [Step(), Step(-1), Seek(1)])
def test_who_steps_or_seeks_while_it_plays_wants_it_to_pause(visit, command):
    visit.do(Play())
    visit.screen.wait_for(lambda picture: picture.t >= 3)
    assert not visit.do(command).playing


def test_play_shows_what_is_recorded_before_it_runs_on(visit):
    tenth = numbers(visit.do(Step(6)))
    visit.do(Seek(1), Play())
    picture = visit.screen.wait_for(lambda picture: picture.t >= 6)
    visit.do(Play(False))
    assert picture.last == max(6, picture.t)
    assert same(numbers(visit.do(Seek(6))), tenth)


def stages_of(visit, filter_name):
    """How many stages the filter's first iteration has."""
    picture = visit.do(Set("filter", filter_name), Step())
    count = len(picture.toy.trace[1].stages)
    visit.do(Reset())
    return count


@pytest.mark.parametrize("filter_name", FILTERS)
def test_one_can_walk_through_the_stages_of_iterations_there_and_back(visit, filter_name):
    count = stages_of(visit, filter_name)
    places = [(0, None)] + [(t, stage) for t in (1, 2) for stage in (*range(count), None)]
    there = [visit.settled(), *(visit.do(Walk()) for _ in places[1:])]
    assert [(picture.t, picture.stage) for picture in there] == places
    back = [visit.do(Walk(-1)) for _ in places[1:]]
    assert [(picture.t, picture.stage) for picture in back] == places[-2::-1]
    assert (visit.do(Walk(-1)).t, visit.do(Walk(3)).last) == (0, 2)


def test_walking_computes_the_same_as_stepping(visit):
    third = numbers(visit.do(Step(3)))
    visit.do(Reset())
    picture = visit.do(*[Walk()] * 3)
    while (picture.t, picture.stage) != (3, None):
        picture = visit.do(Walk())
    assert same(numbers(picture), third)


def test_walking_ends_where_the_film_ends():
    with Visit(FEW, disc_setup(lambda: DiscVideo(frame_count=2))) as visit:
        picture = visit.do(Walk(50))
        assert (picture.t, picture.stage) == (2, None)
        assert "ends" in picture.message


@pytest.mark.parametrize("command", [Step(), Step(-1), Seek(1), Play(True), Set("filter", "basic-sir"), Reset()])
def test_whatever_else_is_asked_for_shows_whole_iterations_again(visit, command):
    visit.do(Step(2), Walk(2), Play(False))
    assert visit.do(Walk(1)).stage is not None
    visit.do(command)
    picture = visit.screen.wait_for(lambda picture: picture.stage is None)
    assert picture.t <= picture.last


def test_a_particle_that_is_clicked_stays_chosen_while_its_iteration_is_shown(visit):
    visit.do(Step(2))
    assert visit.do(Click(3, 7)).chosen == Pick("toy", 3)
    assert visit.do(Walk(-1)).chosen == Pick("toy", 3)
    assert visit.do(Set("arrows", 3), Resize(100, 100)).chosen == Pick("toy", 3)
    assert visit.do(Click(-1, 0)).chosen is None


@pytest.mark.parametrize(
    "command", [Step(), Step(-1), Seek(1), Set("filter", "basic-sir"), Set("system", 2.0), Set("seed", 1), Reset()]
)
def test_a_chosen_particle_is_not_one_of_another_iteration(visit, command):
    visit.do(Step(2), Click(3, 7))
    assert visit.do(command).chosen is None


def test_a_chosen_particle_is_dropped_when_its_iteration_cannot_be_done_again():
    video = DiscVideo()
    with Visit(FEW, disc_setup(lambda: video)) as visit:
        visit.do(Step(3), Click(3, 7))
        video.broken = 2
        picture = visit.do(Set("system", 2.0))
        assert (picture.t, picture.chosen) == (2, None)
        assert "on fire" in picture.message


def test_reset_begins_again_with_the_same_numbers(visit):
    third = numbers(visit.do(Step(3)))
    picture = visit.do(Step(2), Reset())
    assert (picture.t, picture.last) == (0, 0)
    assert same(numbers(visit.do(Step(3))), third)


def test_a_seed_is_a_run(visit):
    third = numbers(visit.do(Step(3)))
    picture = visit.do(Set("seed", 5))
    assert (picture.t, picture.last) == (0, 0)
    assert not same(numbers(visit.do(Step(3))), third)
    visit.do(Set("seed", 0))
    assert same(numbers(visit.do(Step(3))), third)


@pytest.mark.parametrize("world", [name for name in WORLDS if name != FEW.world])
def test_another_world_begins_anew_with_its_own_number_of_particles(visit, world):
    visit.do(Step(3))
    picture = visit.do(Set("world", world))
    assert picture.toy.film.world.name == world
    assert (picture.t, picture.last) == (0, 0)
    assert picture.settings.toy_particles == WORLDS[world].n_particles == len(picture.toy.trace.initial)


def innovations(record):
    return record.stage("propose").particles.states


def test_filters_that_share_a_proposal_draw_the_same_innovations(visit):
    picture = visit.do(Set("filter", "basic-sir"), Step(3))
    before = [room.trace[3] for room in (picture.toy, picture.tracker)]
    picture = visit.do(Set("filter", "rb-hs-sir"))
    after = [room.trace[3] for room in (picture.toy, picture.tracker)]
    assert (picture.t, picture.last) == (3, 3)
    for old, new in zip(before, after, strict=True):
        np.testing.assert_array_equal(innovations(old), innovations(new))
        np.testing.assert_array_equal(old.previous.states, new.previous.states)
        assert not np.array_equal(old.posterior.weights, new.posterior.weights)
    assert picture.toy.outcome(3).filter_name == "rb-hs-sir"
    assert picture.toy.outcome(2).filter_name == "basic-sir"


@pytest.mark.parametrize("noise", ["system", "observation", "proposal"])
def test_the_step_on_screen_is_done_again_with_another_noise_and_back(visit, noise):
    picture = visit.do(Step(3))
    before, old = numbers(picture), picture.toy.trace[3]
    picture = visit.do(Set(noise, 2.5))
    new = picture.toy.trace[3]
    assert (picture.t, picture.last) == (3, 3)
    assert not same(numbers(picture), before)
    assert np.array_equal(innovations(old), innovations(new)) == (noise != "proposal")
    assert same(numbers(visit.do(Set(noise, 1.0))), before)


def test_what_came_after_the_step_that_is_done_again_is_forgotten(visit):
    picture = visit.do(Step(5), Seek(2), Set("observation", 2.0))
    assert (picture.t, picture.last) == (2, 2)
    picture = visit.do(Step())
    assert picture.toy.outcome(3).model.observed.covariance == pytest.approx(4 * 4.0)


def test_what_is_set_to_what_it_is_already_changes_nothing(visit):
    visit.do(Step(5), Seek(2))
    picture = visit.do(Set("filter", FEW.filter), Set("system", 1.0), Set("world", FEW.world), Set("seed", FEW.seed))
    assert (picture.t, picture.last) == (2, 5)


def test_while_it_plays_what_is_set_holds_from_the_next_step_on(visit):
    visit.do(Step(6), Seek(1), Play())
    visit.do(Set("filter", "condensation"))
    visit.do(Play(False), Step(6))
    shown = [picture for picture in visit.screen.drawn if picture.settings.filter == FEW.filter][-1].t
    picture = visit.settled()
    names = [picture.toy.outcome(t).filter_name for t in range(1, shown + 4)]
    assert names == [FEW.filter] * shown + ["condensation"] * 3


def test_a_setting_changed_at_the_prior_makes_what_was_recorded_void(visit):
    picture = visit.do(Step(3), Seek(0), Set("filter", "basic-sir"))
    assert (picture.t, picture.last) == (0, 0)
    picture = visit.do(Step())
    assert picture.toy.outcome(1).filter_name == "basic-sir"


def test_particles_added_at_the_prior_are_drawn_from_it_and_not_copied(visit):
    picture = visit.do(Set("toy_particles", 300), Set("tracker_particles", 200))
    assert len(np.unique(picture.toy.trace.initial.states, axis=0)) == 300
    assert len(np.unique(picture.tracker.trace.initial.states, axis=0)) == 200
    picture = visit.do(Step())
    assert len(picture.toy.trace[1].posterior) == 300
    assert len(picture.tracker.trace[1].posterior) == 200


def test_settings_of_the_picture_only_run_nothing():
    video = DiscVideo()
    with Visit(FEW, disc_setup(lambda: video)) as visit:
        visit.do(Step(2))
        before = list(video.reads)
        for field, value in (("arrows", 10), ("dark", True), ("truth", False), ("pane", "toy"), ("speed", 9)):
            picture = visit.do(Set(field, value))
            assert getattr(picture.settings, field) == value
        assert video.reads == before


def test_a_slider_that_is_dragged_redoes_the_step_once():
    video = DiscVideo()
    with Visit(FEW, disc_setup(lambda: video)) as visit:
        visit.do(Step(2))
        visit.screen.open.clear()
        visit.session.post(Resize(5, 5))
        reads, drawn = len(video.reads), len(visit.screen.drawn)
        for i in range(200):
            visit.session.post(Set("system", 0.5 + i / 100))
        visit.screen.open.set()
        picture = visit.settled()
        assert picture.settings.system == 2.49
        assert len(video.reads) - reads <= 2
        assert len(visit.screen.drawn) - drawn <= 4


def test_it_is_idle_when_all_that_was_asked_for_is_done(visit):
    visit.settled()
    assert visit.session.idle()
    visit.screen.resize = lambda *_: visit.screen.open.clear()
    visit.session.post(Resize(5, 5))
    while visit.screen.open.is_set():
        pass
    visit.session.post(Set("arrows", 3))
    assert not visit.session.idle()
    visit.screen.open.set()
    visit.screen.wait_for(lambda picture: picture.settings.arrows == 3)
    assert visit.session.idle()


def test_the_film_ends_and_play_starts_it_again():
    with Visit(FEW, disc_setup(lambda: DiscVideo(frame_count=4))) as visit:
        visit.do(Play())
        picture = visit.screen.wait_for(lambda picture: not picture.playing and picture.t > 0)
        assert picture.t == picture.last == 4
        assert "ends" in picture.message
        picture = visit.do(Step())
        assert picture.t == 4 and "ends" in picture.message
        assert visit.do(Step(-1)).message == ""
        visit.do(Seek(4), Play())
        assert visit.screen.wait_for(lambda picture: picture.t == 2).playing


def test_a_toy_that_ends_before_the_video_can_be_started_again(monkeypatch):
    monkeypatch.setattr("pfviz_app.films.TOY_STEPS", 3)
    with Visit(FEW) as visit:
        picture = visit.do(Step(9))
        assert picture.t == picture.last == picture.tracker.trace.last == 3
        assert "ends" in picture.message
        visit.do(Play())
        assert visit.screen.wait_for(lambda picture: picture.t in (1, 2)).playing


def test_a_step_that_fails_pauses_and_says_why_and_reset_helps():
    video = DiscVideo(broken=3)
    with Visit(FEW, disc_setup(lambda: video)) as visit:
        visit.do(Play())
        picture = visit.screen.wait_for(lambda picture: bool(picture.message))
        assert "on fire" in picture.message
        assert not picture.playing
        assert picture.t == picture.last == picture.toy.trace.last == 3
        video.broken = None
        picture = visit.do(Reset())
        assert (picture.t, picture.message) == (0, "")
        assert visit.do(Step(5)).t == 5


def test_one_can_go_on_when_what_failed_works_again():
    video = DiscVideo(broken=3)
    with Visit(FEW, disc_setup(lambda: video)) as visit:
        assert visit.do(Step(4)).t == 3
        video.broken = None
        picture = visit.do(Step())
        assert (picture.t, picture.message) == (4, "")


def test_a_drawing_that_fails_pauses_and_says_why(visit):
    visit.do(Step())
    visit.screen.fault = RuntimeError("out of paint")
    picture = visit.do(Play())
    assert "out of paint" in picture.message
    assert not picture.playing
    assert visit.do(Reset()).message == ""
    assert visit.do(Step()).t == 1


@pytest.mark.parametrize(("field", "value"), [("toy_particles", 0), ("filter", "best"), ("seed", "x"), ("nothing", 1)])
def test_a_setting_that_cannot_be_is_refused_with_a_message(visit, field, value):
    visit.do(Step())
    picture = visit.do(Set(field, value))
    assert picture.settings == FEW
    assert repr(value) in picture.message or field in picture.message
    assert visit.do(Step()).message == ""


def test_a_visitor_who_leaves_frees_thread_and_video():
    video = DiscVideo()
    visit = Visit(FEW, disc_setup(lambda: video))
    visit.do(Step(), Play())
    visit.session.close()
    assert not visit.session.alive
    assert video.closed == 1
    visit.session.close()
    assert video.closed == 1


def test_a_session_that_never_started_frees_its_video_too():
    from pfviz_app.session import Session

    video = DiscVideo()
    Session(FEW, disc_setup(lambda: video), None).close()  # type: ignore[arg-type]
    assert video.closed == 1


def test_a_session_can_be_closed_while_its_screen_is_failing():
    video = DiscVideo()
    visit = Visit(FEW, disc_setup(lambda: video))
    visit.do(Play())
    visit.screen.draw = lambda picture: 1 / 0
    visit.session.close()
    assert not visit.session.alive
    assert video.closed == 1


def test_visitors_are_independent():
    with Visit(FEW) as one, Visit(FEW) as other:
        third = numbers(one.do(Step(3)))
        assert other.settled().t == 0
        picture = other.do(Set("world", "plane"), Set("filter", "condensation"), Set("seed", 9), Step(5))
        assert picture.t == 5
        picture = one.settled()
        assert (picture.t, picture.settings) == (3, FEW)
        assert same(numbers(picture), third)
    with Visit(FEW) as alone:
        assert same(numbers(alone.do(Step(3))), third)


def test_the_first_records_are_forgotten_and_time_goes_no_further_back(monkeypatch):
    with Visit(FEW) as visit:
        largest = max(room.trace[1].nbytes for room in visit.do(Step()).lane.rooms)
    monkeypatch.setattr(room_module, "_TRACE_BYTES", 6 * largest)
    with Visit(FEW) as visit:
        picture = visit.do(Step(25))
        earliest = picture.tracker.trace.first
        assert 1 < earliest < picture.t == 25
        picture = visit.do(Seek(0))
        assert picture.t == earliest
        particles = picture.tracker.trace[earliest].posterior
        picture = visit.do(Set("system", 2.0))
        assert picture.t == picture.last == earliest
        assert visit.do(Step()).tracker.trace[earliest + 1].previous is particles


def any_command(rng):
    """What a visitor might do, sensible or not."""
    field = rng.choice([*CONTROLS, "nothing"])
    control = CONTROLS.get(field)
    if control is None or rng.random() < 0.1:
        value = rng.choice([None, "x", -1, 1e9, float("nan"), []])
    elif control.kind == "slider":
        value = rng.uniform(control.low, min(control.high, 60.0))
    elif control.kind == "choice":
        value = rng.choice(control.choices)[0]
    else:
        value = rng.random() < 0.5
    return rng.choice(
        [
            Set(field, value),
            Set(field, value),
            Set("filter", rng.choice(list(FILTERS))),
            Play(rng.choice([None, True, False])),
            Step(rng.choice([-3, -1, 1, 1, 2])),
            Walk(rng.choice([-5, -1, 1, 1, 3])),
            Seek(rng.randint(-2, 40)),
            Reset(),
            Click(rng.randint(-2, 12), 0),
            Resize(rng.randint(1, 3000), rng.randint(1, 3000)),
        ]
    )


@pytest.mark.parametrize("seed", [1, 2])
def test_a_thousand_commands_at_random_do_not_end_the_session(seed):
    rng = random.Random(seed)
    video = DiscVideo(broken=23)
    with Visit(FEW, disc_setup(lambda: video)) as visit:
        times = set()
        for i in range(1000):
            visit.session.post(any_command(rng))
            if i % 10 == 0:
                picture = visit.settled()
                times.add(picture.t)
                assert 0 <= picture.t <= picture.last
                assert picture.toy.trace.last == picture.tracker.trace.last == picture.last
        assert len(times) > 5
        assert visit.session.alive
        picture = visit.do(Play(False), Reset(), Step(2))
        assert (picture.t, picture.last, picture.message) == (2, 2, "")


def test_fifty_visitors_later_nothing_is_left_of_them():
    videos, sessions = [], []

    def open_video():
        videos.append(DiscVideo())
        return videos[-1]

    with Visit(FEW) as visit:
        visit.do(Step())
    threads = threading.active_count()
    for _ in range(50):
        with Visit(FEW, disc_setup(open_video)) as visit:
            visit.do(Step(2))
            visit.session.post(Play())
            sessions.append(weakref.ref(visit.session))
    del visit
    gc.collect()
    assert threading.active_count() == threads
    assert [video.closed for video in videos] == [1] * 50
    assert not any(reference() for reference in sessions)
