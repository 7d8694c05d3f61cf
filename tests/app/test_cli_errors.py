"""Whatever a user gets wrong ends in one line on stderr and exit code 2, and leaves nothing behind."""

import shutil
import socket

import cv2
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pfviz_app import cli, server
from stand_ins import DISC_BOX, SIZE, Outcome, listing, message_of, run_here, run_there, write_disc_video

BOX = ",".join(f"{value:g}" for value in DISC_BOX)


@pytest.fixture(autouse=True)
def no_app(monkeypatch):
    """An app that starts where it should not would run for ever."""
    monkeypatch.setattr(server, "App", lambda *_: pytest.fail("the app started"))


def missing(path):
    pass


def empty(path):
    path.touch()


def text(path):
    path.write_text("This is not a video.\n" * 50)


def truncated(path):
    whole = write_disc_video(path.with_name("whole.mp4"))
    path.write_bytes(whole.read_bytes()[:400])
    whole.unlink()


def without_frames(path):
    cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 25.0, SIZE).release()


def folder(path):
    path.mkdir()


BAD_VIDEOS = [missing, empty, text, truncated, without_frames, folder]


@pytest.mark.parametrize("make", BAD_VIDEOS)
@pytest.mark.parametrize("command", ["track", "serve"])
def test_a_video_that_cannot_be_used(capfd, workplace, make, command):
    make(workplace / "film.mp4")
    before = listing(workplace)
    source = ["--video", "film.mp4", "--no-browser"] if command == "serve" else ["film.mp4", "--output", "out.mp4"]
    outcome = run_here(capfd, command, *source, "--box", BOX)
    assert "film.mp4" in message_of(outcome)
    assert listing(workplace) == before


def test_a_video_that_cannot_be_used_in_a_process_of_its_own(workplace):
    """OpenCV and FFmpeg write on stderr by themselves, where they are let."""
    for make in (empty, text, truncated, without_frames):
        make(workplace / f"{make.__name__}.mp4")
        outcome = run_there("track", f"{make.__name__}.mp4", "--box", BOX, cwd=workplace)
        assert f"{make.__name__}.mp4" in message_of(outcome)


@pytest.mark.parametrize(
    "box",
    ["200,10,20,20", "10,200,20,20", "-50,10,20,20", "10,-50,20,20", "1,1,500,500", "1e5,1e5,20,20"],
)
@pytest.mark.parametrize("command", ["track", "serve"])
def test_a_box_outside_the_frame(capfd, workplace, disc_file, command, box):
    source = ["--video", disc_file, "--no-browser"] if command == "serve" else [disc_file, "--csv", "out.csv"]
    message = message_of(run_here(capfd, command, *source, "--box", box))
    assert "box" in message and f"{SIZE[0]} x {SIZE[1]}" in message
    assert listing(workplace) == []


@pytest.mark.parametrize(
    "box",
    [
        *("10,10,0,20", "10,10,20,0", "10,10,-5,20", "10,10,20,-5", "10,10,inf,20", "nan,10,20,20"),
        *("a,b,c,d", "10,10,20", "10,10,20,20,20", "", ",,,", "10 10 20 20", "--csv"),
    ],
)
def test_a_box_that_is_none(capfd, disc_file, box):
    message = message_of(run_here(capfd, "track", disc_file, "--box", box))
    assert "--box" in message and "x,y,w,h" in message and repr(box) in message


@given(st.text(st.characters(exclude_categories=["Cs"]), max_size=20))
def test_no_text_is_a_box_by_accident(words):
    try:
        _, _, w, h = cli.box(words)
    except cli.argparse.ArgumentTypeError as error:
        assert repr(words) in str(error)
    else:
        assert words.count(",") == 3
        assert w > 0 and h > 0


@given(st.tuples(*[st.floats(-1e5, 1e5)] * 2, *[st.floats(1e-3, 1e5)] * 2))
def test_four_numbers_are_a_box(numbers):
    assert cli.box(",".join(map(repr, numbers))) == numbers


def test_a_box_may_reach_beyond_the_frame_and_begin_with_a_minus(capfd, disc_file):
    outcome = run_here(capfd, "track", disc_file, "--box", "-4,26,40,20", "--particles", 5)
    assert outcome.code == 0


def test_a_missing_box_is_asked_for(capfd, disc_file):
    message = message_of(run_here(capfd, "track", disc_file))
    assert "--box" in message and "x,y,w,h" in message and "disc.mp4" in message
    assert "--box" in message_of(run_here(capfd, "track", disc_file, "--box"))


@pytest.mark.parametrize("count", ["0", "-3", "many", "1.5", "", "nan", "1000000000000"])
@pytest.mark.parametrize("command", [["toy"], ["track", "scene:twin"], ["serve", "--no-browser"]])
def test_a_number_of_particles_that_is_none(capfd, command, count):
    message = message_of(run_here(capfd, *command, "--particles", count))
    assert "--particles" in message and repr(count) in message and "1" in message


def test_more_particles_than_the_app_has_room_for(capfd):
    message = message_of(run_here(capfd, "serve", "--no-browser", "--particles", 100_000))
    assert "articles" in message and "100000" in message


@pytest.mark.parametrize(
    ("option", "wrong", "suggestion"),
    [
        ("--filter", "rb-hs-sri", "rb-hs-sir"),
        ("--filter", "Condensation", "condensation"),
        ("--filter", "basic", "basic-sir"),
        ("--world", "figure1", "figure-1"),
        ("--world", "linear-gausian", "linear-gaussian"),
        ("--world", "plain", "plane"),
    ],
)
@pytest.mark.parametrize("command", ["toy", "serve"])
def test_an_unknown_name_suggests_the_nearest(capfd, command, option, wrong, suggestion):
    message = message_of(run_here(capfd, command, option, wrong))
    assert option in message and f"'{wrong}'" in message
    assert f"did you mean '{suggestion}'?" in message


@pytest.mark.parametrize(("option", "wrong"), [("--filter", "zzz"), ("--world", "zzz"), ("--filter", "")])
def test_a_name_like_no_other_is_told_what_there_is(capfd, option, wrong):
    message = message_of(run_here(capfd, "toy", option, wrong))
    assert "condensation" in message or "figure-1" in message


def test_unknown_scenes_models_and_cameras(capfd, disc_file):
    assert "did you mean 'twin'" in message_of(run_here(capfd, "track", "scene:twins"))
    assert "scene:twin:x" in message_of(run_here(capfd, "track", "scene:twin:x"))
    assert "camera:N" in message_of(run_here(capfd, "track", "camera:front", "--box", BOX))
    assert "contour" in message_of(run_here(capfd, "track", disc_file, "--box", BOX, "--model", "contours"))


@pytest.mark.parametrize("frame", [12, 500])
def test_a_start_frame_past_the_end(capfd, disc_file, frame):
    message = message_of(run_here(capfd, "track", disc_file, "--box", BOX, "--start-frame", frame))
    assert f"--start-frame {frame}" in message and "12 frames" in message


@pytest.mark.parametrize("option", ["--csv", "--output", "--contact-sheet"])
def test_a_place_that_cannot_be_written_to(capfd, workplace, disc_file, option):
    words = ("track", disc_file, "--box", BOX, "--particles", 5)
    assert "nowhere" in message_of(run_here(capfd, *words, option, "nowhere/out.mp4"))
    (workplace / "taken.mp4").mkdir()
    assert "taken.mp4" in message_of(run_here(capfd, *words, option, "taken.mp4"))
    assert listing(workplace) == ["taken.mp4"]


def test_an_error_in_the_middle_leaves_no_files_and_old_ones_alone(capfd, workplace, disc_file, monkeypatch):
    (workplace / "out.csv").write_text("old")
    calls = iter(range(3))

    def tired(*_):
        if next(calls) == 2:
            raise OSError("the brush broke")
        return original(*_)

    from pfviz_app import commands_track

    original = commands_track.draw_track
    monkeypatch.setattr(commands_track, "draw_track", tired)
    words = ("track", disc_file, "--box", BOX, "--particles", 5)
    outputs = ("--csv", "out.csv", "--output", "out.mp4", "--contact-sheet", "out.png", "--force")
    message = message_of(run_here(capfd, *words, *outputs))
    assert message == "the brush broke"
    assert listing(workplace) == ["out.csv"]
    assert (workplace / "out.csv").read_text() == "old"


@pytest.mark.parametrize(
    "words",
    [
        ("dance",),
        ("toy", "--colour", "red"),
        ("toy", "more"),
        ("toy", "--steps", "0"),
        ("toy", "--steps"),
        ("toy", "--repeat", "0"),
        ("toy", "--seed", "-1"),
        ("track",),
        ("serve", "--port", "0"),
        ("serve", "--port", "70000"),
        ("serve", "--port", "http"),
        ("--dance",),
    ],
)
def test_words_that_are_not_understood(capfd, words):
    message = message_of(run_here(capfd, *words))
    assert words[-1] in message or words == ("track",)


def test_a_port_in_use(capfd):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        message = message_of(run_here(capfd, "serve", "--no-browser", "--port", port))
    assert f"--port {port}" in message and "in use" in message


def test_an_address_that_is_not_ours(capfd):
    message = message_of(run_here(capfd, "serve", "--no-browser", "--host", "203.0.113.7", "--port", 9999))
    assert "203.0.113.7" in message


def test_what_is_wrong_is_also_one_line_in_a_process_of_its_own(workplace):
    message = message_of(run_there("toy", "--world", "mars", cwd=workplace))
    assert "mars" in message
    assert listing(workplace) == []


def test_a_file_without_permission(capfd, workplace, disc_file):
    shutil.copy(disc_file, workplace / "mine.mp4")
    (workplace / "mine.mp4").chmod(0)
    outcome: Outcome = run_here(capfd, "track", "mine.mp4", "--box", BOX, "--particles", 5)
    if outcome.code:  # root may read everything
        assert "mine.mp4" in message_of(outcome)
