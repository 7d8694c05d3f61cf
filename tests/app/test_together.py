"""Visitors who look at the same share the work; what they see is what each would have seen alone."""

import itertools

import numpy as np
import pytest
from pfviz_app.commands import Arrange, Click, Drag, Keep, Outline, Play, Reset, Seek, Set, Step, Walk
from pfviz_app.settings import Settings
from pfviz_app.shelf import Shelf
from pfviz_app.stage.composition import compose
from stand_ins import DiscVideo, Visit, disc_setup

FEW = Settings(toy_particles=12, tracker_particles=20)
SIZE = (900, 700)


def shelf():
    return Shelf(2**26)


def records(picture):
    lanes = [picture.lane] + ([picture.rival] if picture.rival else [])
    return [room.trace[t] for lane in lanes for room in lane.rooms for t in range(1, lane.last + 1)]


def contents(record):
    arrays = [a for s in record.stages for a in (s.particles.states, s.particles.log_weights)]
    return b"".join(array.tobytes() for array in (record.previous.states, record.previous.log_weights, *arrays))


def exact(picture):
    answer = picture.toy.exact
    return [(answer.marginal(t).mean.tolist(), answer.log_evidence(t)) for t in range(1, picture.last + 1)]


COURSES = {
    "steps": (Step(4),),
    "other noise on the way": (Step(2), Set("system", 1.5), Step(2)),
    "another filter on the way": (Step(2), Set("filter", "condensation"), Step(2)),
    "more particles on the way": (Step(2), Set("toy_particles", 15), Set("tracker_particles", 25), Step(2)),
    "another seed": (Set("seed", 3), Step(4)),
    "another world": (Set("world", "two-modes"), Step(4)),
    "dragged": (Step(2), Drag(1.25, 1.0, False), Step(2)),
    "there and back": (Step(4), Seek(2), Set("observation", 0.5), Step(2)),
    "with a rival": (Set("rival", "basic-sir"), Step(4)),
    "with what was kept": (Step(2), Keep(), Set("filter", "basic-sir"), Step(2)),
    "begun again": (Step(4), Reset(), Step(4)),
}


@pytest.mark.parametrize("course", COURSES.values(), ids=COURSES)
def test_who_comes_later_sees_what_they_would_have_seen_alone(course):
    setup, runs = disc_setup(), shelf()
    with Visit(FEW, setup) as alone, Visit(FEW, setup, runs) as first, Visit(FEW, setup, runs) as second:
        wanted, made, shared = alone.do(*course), first.do(*course), second.do(*course)
    assert all(a is b for a, b in zip(records(made), records(shared), strict=True))
    assert list(map(contents, records(shared))) == list(map(contents, records(wanted)))
    assert exact(shared) == exact(made) == exact(wanted)
    for mine, theirs in zip(wanted.lane.rooms, shared.lane.rooms, strict=True):
        assert np.array_equal(mine.errors, theirs.errors, equal_nan=True)
        assert np.array_equal(mine.log_evidences, theirs.log_evidences, equal_nan=True)
    assert shared.shared == wanted.shared


def test_those_who_do_different_things_do_not_disturb_each_other():
    setup, runs = disc_setup(), shelf()
    for course in COURSES.values():
        with Visit(FEW, setup) as alone, Visit(FEW, setup, runs) as among_others:
            wanted, found = alone.do(*course), among_others.do(*course)
        assert list(map(contents, records(found))) == list(map(contents, records(wanted)))


def test_after_a_step_that_was_shared_one_can_go_ones_own_way():
    setup, runs, own = disc_setup(), shelf(), (Set("world", "two-modes"), Step(3), Set("system", 2.0), Step(2))
    with Visit(FEW, setup) as alone, Visit(FEW, setup, runs) as first, Visit(FEW, setup, runs) as second:
        first.do(Set("world", "two-modes"), Step(5))
        wanted, found = alone.do(*own), second.do(*own)
    assert exact(found) == exact(wanted)
    assert list(map(contents, records(found))) == list(map(contents, records(wanted)))


def test_visitors_of_different_videos_share_nothing_of_them():
    runs = shelf()
    with Visit(FEW, disc_setup(), runs) as first, Visit(FEW, disc_setup(), runs) as second:
        a, b = first.do(Step(2)), second.do(Step(2))
    assert a.toy.trace[2] is b.toy.trace[2]
    assert a.tracker.trace[2] is not b.tracker.trace[2]


def test_those_who_follow_something_else_share_nothing_of_it():
    setup, runs = disc_setup(), shelf()
    with Visit(FEW, setup, runs) as first, Visit(FEW, setup, runs) as second:
        a = first.do(Step(2))
        second.do(Outline(), Click(20, 20), Click(60, 20), Click(60, 60), Outline())
        b = second.do(Step(2))
    assert a.tracker.trace[2] is not b.tracker.trace[2]


def test_the_end_of_a_film_ends_it_for_everyone():
    setup, runs = disc_setup(lambda: DiscVideo(frame_count=3)), shelf()
    with Visit(FEW, setup, runs) as first, Visit(FEW, setup, runs) as second:
        pictures = [first.do(Step(5)), second.do(Step(5))]
    assert [picture.t for picture in pictures] == [3, 3]
    assert all("ends here" in picture.message for picture in pictures)


LOOKS = (
    *((Step(2), Set(field, value)) for field, value in (("dark", True), ("arrows", 20), ("ancestry", True))),
    *((Step(2), Set(field, value)) for field, value in (("truth", False), ("exact", False), ("overlay", "edges"))),
    *((Step(3), Set(field, value)) for field, value in (("pane", "toy"), ("rival", "basic-sir"), ("speed", 9.0))),
    *((Step(3), Seek(2), Set(field, value)) for field, value in (("dark", True), ("ancestry", True), ("speed", 9.0))),
    (Set("filter", "condensation"),),
    (Set("toy_particles", 30),),
    (Step(2), Walk(-1)),
    (Step(2), Walk(-2)),
    (Step(2), Click(3, 0)),
    (Step(2), Click(4, 0)),
    (Step(2), Outline(), Click(30, 30)),
    (Step(2), Outline(), Click(30, 30), Click(60, 30)),
    (Step(2), Keep(), Set("filter", "basic-sir")),
    (Step(2), Keep(), Set("filter", "condensation")),
    (Arrange("occlusion"),),
    *COURSES.values(),
)


def test_pictures_that_are_said_to_look_alike_are_drawn_alike():
    setup, drawn, met = disc_setup(), {}, 0
    for course, _ in itertools.product(LOOKS, range(2)):
        with Visit(FEW, setup) as visit:
            picture = visit.do(*course)
            marks = {
                name: (mark.place, {key: np.asarray(value).tobytes() for key, value in mark.properties.items()})
                for name, mark in compose(picture, SIZE, False).marks.items()
            }
        met += picture.look in drawn
        assert drawn.setdefault(picture.look, marks) == marks, course
    assert met >= len(LOOKS)
    assert len(drawn) >= len(LOOKS) - 6


def test_who_plays_at_another_speed_sees_the_same():
    with Visit(FEW) as visit:
        looks = {visit.do(Set("speed", speed)).look for speed in (2.0, 4.0, 30.0)}
        assert len(looks) == 1
        assert visit.do(Play(True), Play(False), Seek(0)).look in looks
