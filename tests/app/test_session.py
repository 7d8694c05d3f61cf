"""What a visitor asks for happens, and nothing a visitor asks for ends the session."""

import gc
import random
import threading
import weakref
from dataclasses import replace

import numpy as np
import pytest
from pfviz_app import room as room_module
from pfviz_app.commands import (
    Arrange,
    Ask,
    Click,
    Drag,
    Keep,
    Load,
    Open,
    Outline,
    Play,
    Reset,
    Resize,
    Seek,
    Select,
    Set,
    Step,
    Walk,
)
from pfviz_app.films import Start
from pfviz_app.picture import Pick
from pfviz_app.scenarios import SCENARIOS
from pfviz_app.settings import CONTROLS, Settings
from pfviz_app.share import Shared, encode
from stand_ins import DiscVideo, Visit, centre, disc_setup, write_disc_video

from pfviz.filters import FILTERS
from pfviz.worlds import WORLDS

FEW = Settings(toy_particles=12, tracker_particles=15, speed=30.0)


@pytest.fixture(autouse=True)
def short_recordings(monkeypatch):
    """A toy's film takes a while to draw; no test here looks at more than these steps."""
    monkeypatch.setattr("pfviz_app.films.TOY_STEPS", 80)


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
    """How many stages the filter's first two iterations have, in the room that has more."""
    picture = visit.do(Set("filter", filter_name), Step(2))
    counts = [max(len(room.trace[t].stages) for room in picture.lane.rooms) for t in (1, 2)]
    visit.do(Reset())
    return counts


@pytest.mark.parametrize("filter_name", FILTERS)
def test_one_can_walk_through_the_stages_of_iterations_there_and_back(visit, filter_name):
    counts = stages_of(visit, filter_name)
    places = [(0, None)] + [(t, stage) for t, count in enumerate(counts, 1) for stage in (*range(count), None)]
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


CODES = ["", "pf2-x", encode(Shared(FEW, 3, 1)), encode(Shared(replace(FEW, rival="itself"), 2))]


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
            Drag(rng.uniform(-3.0, 3.0), 0.0, rng.random() < 0.2),
            Set("rival", rng.choice(["none", "itself", "condensation", "basic-sir"])),
            Keep(),
            Select(*(rng.uniform(0.0, 70.0) for _ in range(4))),
            Outline(),
            Open(rng.choice(CODES)),
            Arrange(rng.choice(["jump", "look-alike", "nothing"])),
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
                if not picture.playing:  # or else it may be in the middle of a step
                    lasts = [room.trace.last for room in rooms(picture)]
                    assert lasts[::2] == lasts[1::2] and min(lasts) == picture.last
        assert len(times) > 5
        assert visit.session.alive
        video.broken = None
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


# Two lanes


def rooms(picture):
    return [*picture.lane.rooms, *(picture.rival.rooms if picture.rival else ())]


def fingerprints(lane, times):
    records = [room.trace[t] for room in lane.rooms for t in times]
    return [array.tobytes() for record in records for array in (record.posterior.states, record.posterior.log_weights)]


def test_a_rival_runs_on_the_same_data_and_random_numbers_from_the_start(visit):
    picture = visit.do(Step(3), Set("rival", "basic-sir"))
    assert (picture.t, picture.last) == (3, 3)
    for own, rival in zip(picture.lane.rooms, picture.rival.rooms, strict=True):
        assert own.film is rival.film
        np.testing.assert_array_equal(innovations(own.trace[1]), innovations(rival.trace[1]))
        assert rival.outcome(3).filter_name == "basic-sir"
    picture = visit.do(Step(2), Set("system", 2.0))
    assert {room.trace.last for room in rooms(picture)} == {5}
    with Visit(Settings(filter="basic-sir", toy_particles=12, tracker_particles=15)) as alone:
        again = alone.do(Step(4)).lane
        assert fingerprints(picture.rival, range(1, 5)) == fingerprints(again, range(1, 5))
    assert visit.do(Set("rival", "none")).rival is None


def test_a_rival_is_run_again_under_the_settings_of_each_step(visit):
    picture = visit.do(Step(2), Set("system", 3.0), Step(2), Set("rival", "condensation"))
    deviations = [picture.rival.toy.outcome(t).model.dynamics.noise_covariance[0, 0] for t in (1, 2, 3, 4)]
    assert deviations[1] == deviations[2] == deviations[3] == pytest.approx(9.0 * deviations[0])


def test_a_rival_of_what_is_recorded_runs_under_the_settings_of_each_step(visit):
    visit.do(Step(3), Set("system", 2.0), Step(), Set("system", 3.0), Seek(1), Set("rival", "condensation"))
    picture = visit.do(Step(2))
    assert [settings.system for settings in picture.rival.log] == [1.0, 1.0, 2.0]
    brought_back(picture)


def test_a_branch_keeps_what_was_and_lets_go_what_is(visit):
    picture = visit.do(Step(6), Seek(4), Keep())
    kept = fingerprints(picture.rival, range(1, 7))
    assert (picture.t, picture.settings.rival) == (4, "itself")
    picture = visit.do(Set("filter", "condensation"), Step(2))
    assert fingerprints(picture.rival, range(1, 7)) == kept
    assert fingerprints(picture.lane, range(1, 4)) == fingerprints(picture.rival, range(1, 4))
    assert fingerprints(picture.lane, [4, 5]) != fingerprints(picture.rival, [4, 5])
    picture = visit.do(Step(1))
    assert picture.t == 7 and picture.rival.toy.outcome(7).filter_name == FEW.filter
    picture = visit.do(Reset(), Step(2))
    assert [lane.toy.outcome(2).filter_name for lane in (picture.lane, picture.rival)] == ["condensation", FEW.filter]


def test_what_is_kept_keeps_its_particles_when_all_begins_again(visit):
    picture = visit.do(Step(2), Keep(), Set("toy_particles", 30), Reset(), Step())
    assert [len(lane.toy.trace[1].posterior) for lane in (picture.lane, picture.rival)] == [30, 12]
    picture = visit.do(Set("world", "plane"))
    assert len(picture.rival.toy.trace.initial) == WORLDS["plane"].n_particles


def test_one_can_branch_again(visit):
    visit.do(Step(2), Keep(), Set("filter", "condensation"), Step(2))
    picture = visit.do(Keep())
    assert picture.rival.toy.outcome(4).filter_name == "condensation"
    assert fingerprints(picture.rival, range(1, 5)) == fingerprints(picture.lane, range(1, 5))


def test_a_target_that_is_dragged_is_dragged_for_what_was_kept_at_the_prior_too(visit):
    picture = visit.do(Keep(), Set("filter", "condensation"), Step(3), Drag(1.5, 0.0))
    assert picture.rival.toy.film.truth(3) == picture.toy.film.truth(3) == 1.5
    brought_back(picture)


def test_the_picture_of_the_rival_is_the_rivals(visit):
    assert visit.do(Step()).of_rival() is None
    picture = visit.do(Set("rival", "condensation"), Click(3, 0))
    other = picture.of_rival()
    assert other.lane is picture.rival and other.rival is None and other.chosen is None
    assert other.t == picture.t


@pytest.mark.parametrize("rival", ["none", "condensation", "itself"])
def test_a_share_code_brings_back_exactly_this_for_somebody_else(visit, rival):
    visit.do(Step(2), Set("system", 2.0), Step(2), Set("toy_particles", 20), Set("rival", rival))
    picture = visit.do(Set("observation", 0.5), Step(2), Drag(0.4, 0.0), Step(1), Walk(2))
    code = encode(picture.shared)
    with Visit(Settings()) as other:
        again = other.do(Open(code))
        assert (again.t, again.stage, again.settings, again.message) == (8, 1, picture.settings, "")
        times = range(1, 9)
        assert fingerprints(again.lane, times) == fingerprints(picture.lane, times)
        if rival != "none":
            assert fingerprints(again.rival, times) == fingerprints(picture.rival, times)
        assert encode(again.shared) == code


def brought_back(picture):
    """What somebody else sees who opens the code of a picture: the same."""
    with Visit(Settings()) as other:
        again = other.do(Open(encode(picture.shared)))
    assert (again.t, again.stage, again.message) == (picture.t, picture.stage, "")
    times = range(1, picture.t + 1)
    assert fingerprints(again.lane, times) == fingerprints(picture.lane, times)
    if picture.rival is not None:
        assert fingerprints(again.rival, times) == fingerprints(picture.rival, times)
    return again


def test_a_code_says_exactly_where_the_target_was_put(visit):
    brought_back(visit.do(Step(3), Drag(1 / 3, 0.0), Step(2)))


def test_a_code_says_exactly_what_was_selected(visit):
    brought_back(visit.do(Step(3), Select(17.03, 28.06, 35.011, 44.02), Step(3)))


@pytest.mark.parametrize(
    "redo", [[Set("toy_particles", 20)], [Step(), Set("toy_particles", 20), Seek(1), Drag(0.5, 0.0)]]
)
def test_a_code_brings_back_a_first_step_that_was_done_again_with_more_particles(visit, redo):
    brought_back(visit.do(Step(), *redo, Set("tracker_particles", 20), Step(2)))


def test_a_code_holds_the_settings_under_which_a_kept_lane_goes_on(visit):
    visit.do(Keep(), Set("filter", "condensation"))
    assert brought_back(visit.settled()).rival.settings.filter == FEW.filter
    visit.do(Play(), Set("system", 2.0), Play(False))
    picture = visit.do(Keep())
    assert brought_back(picture).rival.settings.system == 2.0


def test_a_code_brings_back_a_stage_that_only_the_rival_has(visit):
    picture = visit.do(Set("filter", "condensation"), Set("rival", "rb-ss-hs-sir"), Step(2), Walk(-1))
    assert picture.stage == max(len(room.trace[2].stages) for room in picture.rival.rooms) - 1 > 2
    brought_back(picture)


def test_after_a_code_whose_video_fails_the_settings_shown_are_those_that_hold():
    video, now = DiscVideo(broken=3), replace(FEW, system=2.0)
    with Visit(FEW, disc_setup(lambda: video)) as visit:
        assert visit.do(Open(encode(Shared(now, 8, changes=((1, FEW), (7, now)))))).t == 3
        video.broken = None
        assert visit.do(Step()).lane.log[3].system == 2.0


def test_a_code_without_a_choice_follows_what_the_video_says(visit):
    picture = visit.do(Step(3))
    code, third = encode(picture.shared), fingerprints(picture.lane, [3])
    picture = visit.do(Select(50.0, 28.0, 70.0, 44.0), Step(), Open(code))
    assert (picture.message, picture.tracker.film.chosen_start) == ("", None)
    assert fingerprints(picture.lane, [3]) == third


def test_a_place_of_another_world_is_none_in_this_one(visit):
    visit.do(Set("world", "plane"), Step(2))
    picture = visit.do(Drag(1.0, 0.0), Drag(float("nan"), 0.0))
    assert (picture.toy.film.held, picture.message) == ({}, "")


def test_a_code_that_cannot_be_opened_loses_nothing(visit):
    visit.do(Step(3))
    picture = visit.do(Open("nonsense"))
    assert "share code" in picture.message and picture.t == 3


def test_a_code_with_a_place_of_another_world_loses_nothing(visit):
    before = visit.do(Step(3))
    picture = visit.do(Open(encode(Shared(replace(FEW, seed=9), 2, held={1: (0.5, 0.5)}))))
    assert "no room" in picture.message
    assert (picture.settings, picture.t, picture.lane) == (before.settings, 3, before.lane)


def test_what_takes_long_shows_how_far_it_is_and_can_be_stopped(visit, monkeypatch):
    monkeypatch.setattr("pfviz_app.session._PROGRESS_PERIOD", 0.0)
    code = encode(Shared(FEW, 50))
    visit.session.post(Open(code))
    picture = visit.screen.wait_for(lambda picture: (picture.progress or 0.0) > 0.1)
    assert picture.progress < 1.0
    visit.session.post(Play(False))
    picture = visit.settled()
    assert (picture.progress is None and "Interrupted" in picture.message) or picture.t == 50
    assert visit.do(Step()).message == ""


# What a visitor takes hold of


def test_the_target_is_where_it_is_dragged_and_the_step_is_done_again(visit):
    picture = visit.do(Step(4))
    before, posterior = picture.toy.film.truth(4), picture.toy.trace[4].posterior.states
    picture = visit.do(Drag(1.5, 0.0))
    assert picture.t == picture.last == 4
    assert picture.toy.film.truth(4) == 1.5 != before
    assert not np.array_equal(picture.toy.trace[4].posterior.states, posterior)
    np.testing.assert_array_equal(picture.toy.exact.marginal(4).mean.shape, (1,))
    assert picture.shared.held == {4: (1.5,)}
    assert visit.do(Reset()).toy.film.held == {}


def test_the_target_is_where_it_was_let_go(visit):
    """A page that is slow tells only where the hand came from and where it let go."""
    picture = visit.do(Step(2), Drag(0.5, 0.0), Drag(1.5, 0.0, end=True))
    assert picture.toy.film.truth(2) == 1.5
    trace = picture.toy.trace[2]
    assert visit.do(Drag(1.5, 0.0, end=True)).toy.trace[2] is trace, "nothing is done twice"


def test_while_it_plays_the_target_stays_in_the_hand(visit):
    visit.do(Step(2), Play())
    visit.session.post(Drag(1.25, 0.0))
    picture = visit.screen.wait_for(lambda picture: len(picture.toy.film.held) >= 3)
    visit.do(Drag(1.25, 0.0, end=True))
    visit.do(Play(False))
    held = dict(visit.settled().toy.film.held)
    assert set(held.values().__iter__().__next__().tolist()) == {1.25}
    assert visit.do(Step(2)).toy.film.truth(max(held) + 1) != 1.25
    assert picture.message == ""


def test_the_hand_lets_go_even_if_it_is_paused_meanwhile(visit):
    visit.do(Step(2), Play())
    visit.session.post(Drag(1.25, 0.0))
    visit.screen.wait_for(lambda picture: len(picture.toy.film.held) >= 2)
    held = len(visit.do(Play(False), Drag(1.25, 0.0, end=True)).toy.film.held)
    assert len(visit.do(Step(2)).toy.film.held) == held


def test_before_the_first_step_there_is_nothing_to_drag(visit):
    picture = visit.do(Drag(1.0, 0.0))
    assert (picture.t, picture.toy.film.held, picture.message) == (0, {}, "")


def test_what_is_selected_is_followed_from_there_on(visit):
    picture = visit.do(Step(3), Select(17.0, 28.0, 35.0, 44.0))
    assert (picture.t, picture.playing) == (0, False)
    assert picture.tracker.film.chosen_start == Start(2, ((17.0, 28.0), (35.0, 44.0)))
    picture = visit.do(Step(5))
    estimate = picture.tracker.film.setup.model.estimate(picture.tracker.trace[5])
    assert np.hypot(estimate.x - centre(6)[0], estimate.y - centre(6)[1]) < 6.0
    assert np.isnan(picture.tracker.errors).all(), "the source knows nothing of what a visitor has chosen"
    with Visit(FEW) as other:
        again = other.do(Open(encode(picture.shared)))
        assert fingerprints(again.lane, [5]) == fingerprints(picture.lane, [5])


@pytest.mark.parametrize("corners", [(-5.0, 3.0, 20.0, 30.0), (10.0, 10.0, 10.5, 10.2)])
def test_what_cannot_be_followed_is_refused_and_nothing_lost(visit, corners):
    picture = visit.do(Step(3), Select(*corners))
    assert picture.t == 3 and picture.message
    assert picture.tracker.film.chosen_start is None


def test_an_outline_is_clicked_corner_by_corner(visit):
    picture = visit.do(Step(1), Outline())
    assert picture.outline == () and "outline" in picture.message
    corners = [(18.0, 26.0), (32.0, 26.0), (32.0, 46.0), (18.0, 46.0)]
    picture = visit.do(*(Click(*corner) for corner in corners))
    assert picture.outline == tuple(corners)
    picture = visit.do(Outline())
    assert picture.outline is None and picture.tracker.film.chosen_start.outline == tuple(corners)
    assert visit.do(Outline(), Click(20.0, 20.0), Reset()).outline is None, "it can be given up"
    picture = visit.do(Outline(), Click(20.0, 20.0), Outline())
    assert "3 corners" in picture.message and picture.outline is None


def test_a_video_of_ones_own_is_read_and_its_file_deleted(visit, tmp_path):
    path = write_disc_video(tmp_path / "disc.mp4").rename(tmp_path / "upload-0")
    picture = visit.do(Outline(), Click(20.0, 20.0), Load(path, "<b>mine</b>\n.mp4"))
    assert picture.outline is None, "it was of another video"
    assert picture.tracker.film.setup.title == r"Video: <b>mine</b>\n.mp4"
    assert visit.do(Select(12.0, 26.0, 32.0, 46.0), Step(3)).t == 3
    visit.session.close()
    assert not path.exists()


def test_a_file_that_is_no_video_is_refused_by_the_name_that_the_visitor_knows(visit, tmp_path):
    path = tmp_path / "upload-0"
    path.write_bytes(b"no video")
    picture = visit.do(Step(2), Load(path, "holiday.mp4"))
    assert "holiday.mp4" in picture.message and "upload-0" not in picture.message
    assert picture.t == 2 and not path.exists()
    assert visit.do(Step()).t == 3


# The gallery


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_situation_can_be_shown(name):
    with Visit(Settings(dark=True), disc_setup(lambda: DiscVideo(frame_count=None))) as visit:
        picture = visit.do(Arrange(name))
        scenario = SCENARIOS[name]
        assert (picture.situation, picture.t, picture.message) == (name, scenario.t or 0, "")
        assert picture.settings.dark and picture.settings.world == scenario.settings.world
        assert (picture.rival is not None) == (scenario.settings.rival != "none")
        assert visit.do(Step()).situation == name
        assert visit.do(Set("system", 3.0)).situation is None


def test_a_question_is_answered_with_the_picture_on_screen(visit):
    answers = []
    picture = visit.do(Step(2), Ask(answers.append))
    assert answers[0].t == picture.t == 2
