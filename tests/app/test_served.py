"""Who serves a video can say as much of it as who tracks it, and it holds for what visitors follow and send."""

import argparse
import shutil
from dataclasses import replace

import numpy as np
import pytest
from pfviz_app import cli, server
from pfviz_app.commands import Drag, Load, Open, Select, Set, Step
from pfviz_app.films import Start, ToyFilm, VideoFilm
from pfviz_app.lane import Lane
from pfviz_app.served import video_of
from pfviz_app.settings import Settings
from pfviz_app.share import encode
from pfviz_app.start_box import USUAL
from pfviz_app.video_options import assumptions_of, limits_of
from stand_ins import (
    DISC_BOX,
    DISC_OUTLINE,
    Visit,
    centre,
    disc_setup,
    message_of,
    run_here,
    write_disc_video,
    write_positions,
)

from pfviz.filters import make_filter
from pfviz.vision import Limits, Restarting
from pfviz.worlds import get_world

BOX = ",".join(f"{value:g}" for value in DISC_BOX)


def parsed(*words) -> argparse.Namespace:
    return cli.build_parser().parse_args([str(word) for word in words])


def served(video, *words):
    return video_of(parsed("serve", "--video", video, *words))


@pytest.mark.parametrize("words", [("serve",), ("track", "film.mp4")])
def test_where_nothing_is_said_the_usual_is_assumed(words):
    options = parsed(*words)
    assert assumptions_of(options) == USUAL and limits_of(options) == Limits()


def test_serving_takes_all_that_tracking_takes():
    tracking, serving = (set(vars(parsed(*words))) for words in (("track", "film.mp4"), ("serve",)))
    assert tracking - serving == {"source", "csv", "output", "contact_sheet", "json", "force"}


@pytest.mark.parametrize(
    ("words", "seen"),
    [
        (("--model", "colour"), lambda model: model.name == "colour"),
        (("--shape", "affine"), lambda model: len(model.start) == 6),
        (("--dynamics", "constant-position"), lambda model: model.dynamics.order == 1),
        (("--working-width", 48), lambda model: model.extractor.working_scale < 1),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else "",
)
def test_what_is_assumed_holds_for_whatever_a_visitor_follows(disc_file, tmp_path, words, seen):
    film = VideoFilm(served(disc_file, "--box", "0,10,60,60", *words))
    assert seen(film.setup.model)
    assert seen(film.following(Start(0, ((2.0, 12.0), (58.0, 66.0)))).setup.model)
    sent = VideoFilm.uploaded(shutil.copy(disc_file, tmp_path / "sent.mp4"), "sent.mp4", film.setup)
    assert seen(sent.following(Start(0, ((2.0, 12.0), (58.0, 66.0)))).setup.model)
    sent.close()
    film.close()


def test_motion_that_was_learnt_is_that_of_the_video_served(disc_file, tmp_path):
    path = write_positions(tmp_path / "truth.csv")
    film = VideoFilm(served(disc_file, "--box", BOX, "--learn-dynamics", path))
    learnt, start = film.setup.model.dynamics, Start(0, ((12.0, 26.0), (32.0, 46.0)))
    np.testing.assert_array_equal(film.following(start).setup.model.dynamics.coefficients, learnt.coefficients)
    sent = VideoFilm.uploaded(shutil.copy(disc_file, tmp_path / "sent.mp4"), "sent.mp4", film.setup)
    assert not np.array_equal(sent.following(start).setup.model.dynamics.coefficients, learnt.coefficients)
    sent.close()
    film.close()


def test_limits_hold_for_the_video_and_for_what_visitors_send(capfd, disc_file, tmp_path, monkeypatch):
    monkeypatch.setattr(server, "App", lambda *_: pytest.fail("the app started"))
    words = ("serve", "--no-browser", "--video", disc_file, "--box", BOX)
    assert "96 x 72 pixels are too many" in message_of(run_here(capfd, *words, "--max-pixels", 6000))
    setup = served("scene:twin", "--max-pixels", 6000)
    with pytest.raises(ValueError, match=r"sent\.mp4: 96 x 72 pixels are too many"):
        VideoFilm.uploaded(shutil.copy(disc_file, tmp_path / "a.mp4"), "sent.mp4", setup)
    assert list(tmp_path.iterdir()) == []
    film = VideoFilm(served(disc_file, "--box", BOX, "--max-frames", 7))
    assert film.length == 7
    film.close()


def test_the_rate_of_images(late_disc):
    film = VideoFilm(served(late_disc, "--box", "10,10,30,30", "--frame-rate", 12))
    assert film.source.frame_rate == 12.0
    film.close()


def test_an_outline_instead_of_a_box(disc_file):
    outline = ";".join(f"{x:.2f},{y:.2f}" for x, y in DISC_OUTLINE)
    film = VideoFilm(served(disc_file, "--polygon", outline))
    assert film.setup.start is not None and len(film.setup.start.outline) == len(DISC_OUTLINE)
    assert np.hypot(*(film.setup.model.start[:2] - centre(0))) < 1.0
    film.close()


def test_an_object_that_is_learnt_from_a_later_frame_is_found_when_it_appears(late_disc):
    x, y = centre(30)
    film = VideoFilm(served(late_disc, "--learn-frame", 30, "--box", f"{x - 10},{y - 10},20,20"))
    settings = Settings(toy_particles=1, tracker_particles=300)
    lane = Lane(settings, ToyFilm(get_world(settings.world), 0), film)
    for _ in range(40):
        lane.step()
    assert all(lane.tracker.outcome(t).lost for t in range(1, 21))
    assert not any(lane.tracker.outcome(t).lost for t in range(31, 41))
    assert np.hypot(*(lane.tracker.trace[40].estimate[:2] - centre(39))) < 6.0
    film.close()


@pytest.mark.parametrize(("words", "share"), [((), 0.25), (("--no-restart",), 0.0)])
def test_what_is_lost_is_looked_for_unless_it_is_not_wanted(words, share):
    film, plain = VideoFilm(served("scene:twin", *words)), make_filter("basic-sir", 7)
    assert film.looking(plain) == Restarting(plain, share)  # type: ignore[comparison-overlap]


def test_experiments_know_a_scene_only_as_it_is():
    assert VideoFilm(served("scene:twin")).place == "scene:twin"
    for words in (("--model", "colour"), ("--no-restart",), ("--learn-frame", 3), ("--box", BOX)):
        assert VideoFilm(served("scene:twin", *words)).place is None


@pytest.mark.parametrize(
    ("name", "public"),
    [
        ("scene:twin:3", "scene:twin:3"),
        ("camera:0", "camera:0"),
        ("/home/somebody/holiday.mp4", "holiday.mp4"),
        ("C:\\Users\\somebody\\holiday.mp4", "holiday.mp4"),
        ("/home/somebody/frames/", "frames"),
        ("/home/somebody/a\nb.mp4", r"a\nb.mp4"),
        (None, "disc"),
    ],
)
def test_a_video_is_known_by_a_name_without_folders(name, public):
    assert replace(disc_setup(), name=name).public_name == public


def test_a_code_of_another_video_brings_back_the_rest_and_says_so(tmp_path):
    few, path = Settings(toy_particles=12, tracker_particles=15), write_disc_video(tmp_path / "other.mp4")
    with Visit(few) as visit:
        picture = visit.do(Step(2), Select(17.0, 28.0, 35.0, 44.0), Set("system", 2.0), Step(3), Drag(0.4, 0.0))
        code, same = encode(picture.shared), visit.do(Open(encode(picture.shared)))
        assert (same.t, same.message, same.tracker.film.chosen_start) == (3, "", picture.shared.start)
        there = visit.do(Load(path, "other.mp4"), Open(code))
    assert (there.t, there.settings, there.tracker.film.chosen_start) == (3, picture.settings, None)
    assert "the video disc" in there.message and "it is other.mp4" in there.message
    assert there.toy.trace[3].estimate == picture.toy.trace[3].estimate


def test_what_the_filter_believes_is_what_visitors_begin_with(capfd):
    settings = server._settings(
        parsed("serve", "--system-noise", 2, "--observation-noise", 0.5, "--proposal-width", 1.5)
    )
    assert settings.noises == {"system": 2.0, "observation": 0.5, "proposal": 1.5}
    message = message_of(run_here(capfd, "serve", "--no-browser", "--system-noise", 50))
    assert message == "System noise ×: expected 0.1 to 4, got 50.0"


def test_limits_hold_for_a_visitors_session(tmp_path):
    path = write_disc_video(tmp_path / "sent.mp4")
    with Visit(Settings(toy_particles=12, tracker_particles=15), served("scene:twin", "--max-pixels", 6000)) as visit:
        picture = visit.do(Load(path, "holiday.mp4"))
    assert picture.message == "holiday.mp4: 96 x 72 pixels are too many (max_pixels is 6000)"


def test_the_truth_is_relative_to_the_frame_that_was_learnt_from():
    film = VideoFilm(served("scene:twin", "--learn-frame", 40))
    turned = [film.truth(t).state[2] for t in (1, 41)]
    assert turned[1] == 0.0 and abs(turned[0]) > 0.1
