"""``pfviz track``: where the object is learnt, what is written, and what is never done to a file."""

from __future__ import annotations

import csv
import io
import json
import os
import signal
from contextlib import nullcontext
from pathlib import Path

import cv2
import numpy as np
import pytest
from hostile_files import BAD_FILES, children, write_cut_video
from hypothesis import given
from hypothesis import strategies as st
from pfviz_app import cli, commands_track
from pfviz_app.outputs import replacing
from pfviz_app.progress import Progress, duration
from stand_ins import (
    DISC_BOX,
    DISC_OUTLINE,
    SIZE,
    DiscVideo,
    centre,
    disc_frame,
    listing,
    message_of,
    run_here,
    write_positions,
)

from pfviz.dynamics import learn_dynamics, read_states
from pfviz.filters import FILTERS, make_filter
from pfviz.vision.motion import DYNAMICS
from pfviz.vision.restart import Restarting
from pfviz.vision.shapes import SHAPES
from pfviz.vision.tracker import MODELS

BOX = ",".join(f"{value:g}" for value in DISC_BOX)
POLYGON = [f"{x:.2f},{y:.2f}" for x, y in DISC_OUTLINE]
FEW = ("--particles", 60)


def rows_of(text: str) -> list[dict[str, float]]:
    return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(io.StringIO(text))]


def errors_in(text: str) -> np.ndarray:
    return np.array([np.hypot(row["x"] - centre(int(row["frame"]))[0], row["y"] - 36.0) for row in rows_of(text)])


@pytest.mark.parametrize("words", [("--polygon", *POLYGON), ("--polygon", ";".join(POLYGON))])
def test_an_outline_instead_of_a_box(capfd, disc_file, words):
    outcome = run_here(capfd, "track", disc_file, *words, *FEW)
    assert (outcome.code, outcome.err) == (0, "")
    assert errors_in(outcome.out).max() < 6.0


def test_options_may_follow_the_outline_and_points_may_be_negative(capfd, disc_file):
    parser = cli.build_parser()
    words = ["track", "--polygon", "-1.5,2", "30,-2e0", "+3,40", "film.mp4", "--json"]
    options = parser.parse_args(list(cli._joined(words)))
    assert options.polygon == ((-1.5, 2.0), (30.0, -2.0), (3.0, 40.0))
    assert options.source == "film.mp4" and options.json


@pytest.mark.parametrize(
    "text", ["", "1,2", "1,2;3,4", "1,2;3,4;5", "a,b;c,d;e,f", "1,1;2,2;3,3", "1,1;nan,5;9,2", "1,1;9,inf;9,2", "--csv"]
)
def test_an_outline_that_is_none(capfd, disc_file, text):
    message = message_of(run_here(capfd, "track", disc_file, "--polygon", text))
    assert "--polygon" in message and repr(text) in message


@given(st.lists(st.tuples(*[st.floats(-1e5, 1e5)] * 2), min_size=3, max_size=9))
def test_points_are_an_outline_if_they_enclose_an_area(points):
    text = ";".join(f"{x!r},{y!r}" for x, y in points)
    area = abs(cv2.contourArea(np.array(points, np.float32)))
    try:
        assert cli.polygon(text) == tuple(points)
    except cli.argparse.ArgumentTypeError as error:
        assert area < 2.0 + 1e-3 * np.abs(points).max() ** 2 and repr(text) in str(error)


@pytest.mark.parametrize(
    ("polygon", "trouble"),
    [
        ("200,10;220,10;220,30", "its centre lies outside the frame of 96 x 72"),
        ("10,10;12,10;12,12;10,12", "too small"),
        ("-400,-400;500,-400;500,500;-400,500", "larger than the frame of 96 x 72"),
    ],
)
def test_an_outline_that_does_not_fit_the_frame(capfd, disc_file, polygon, trouble):
    message = message_of(run_here(capfd, "track", disc_file, "--polygon", polygon))
    assert "polygon" in message and trouble in message


def test_box_and_outline_exclude_each_other(capfd, disc_file):
    message = message_of(run_here(capfd, "track", disc_file, "--box", BOX, "--polygon", *POLYGON))
    assert "--polygon" in message and "not allowed with" in message and "--box" in message


def test_an_object_that_is_learnt_from_a_later_frame_is_found_when_it_appears(capfd, late_disc):
    x, y = centre(30)
    words = ("track", late_disc, "--learn-frame", 30, "--box", f"{x - 10},{y - 10},20,20", "--json")
    outcome = run_here(capfd, *words, "--particles", 300)
    assert outcome.err == ""
    lines = [json.loads(line) for line in outcome.out.splitlines()]
    assert [line["frame"] for line in lines] == list(range(40))
    assert {line["state"] for line in lines[:20]} == {"lost"}
    assert {line["state"] for line in lines[30:]} == {"tracked"}
    for line in lines[30:]:
        assert np.hypot(line["x"] - centre(line["frame"])[0], line["y"] - 36.0) < 6.0


ASSUMED = [("--model", MODELS), ("--shape", SHAPES), ("--dynamics", DYNAMICS)]


@pytest.mark.parametrize(("option", "name"), [(option, name) for option, table in ASSUMED for name in table])
def test_whatever_is_assumed_the_disc_is_followed(capfd, disc_file, option, name):
    outcome = run_here(capfd, "track", disc_file, "--box", BOX, "--particles", 200, option, name, "--json")
    assert (outcome.code, outcome.err) == (0, "")
    last = json.loads(outcome.out.splitlines()[-1])
    assert np.hypot(last["x"] - centre(11)[0], last["y"] - 36.0) < 6.0
    turned_or_scaled = (last["rotation"], last["scale"]) != (0.0, 1.0)
    assert turned_or_scaled == (name != "translation")
    assert (last["stretch"] is not None) == (name == "affine")


@pytest.mark.parametrize("shape", SHAPES)
def test_dynamics_are_learnt_from_positions(capfd, workplace, disc_file, monkeypatch, shape):
    models = []
    original = commands_track._sinks
    monkeypatch.setattr(commands_track, "_sinks", lambda *a: [models.append(a[2]), *original(*a)][1:])
    write_positions(workplace / "truth.csv")
    words = ("track", disc_file, "--box", BOX, *FEW, "--shape", shape, "--learn-dynamics", "truth.csv")
    outcome = run_here(capfd, *words)
    assert (outcome.code, outcome.err) == (0, "")
    assert errors_in(outcome.out).max() < 6.0
    learnt, known = models[0].dynamics, learn_dynamics(read_states(workplace / "truth.csv"))
    np.testing.assert_array_equal(learnt.coefficients[:, :2, :2], known.coefficients)
    np.testing.assert_array_equal(learnt.noise_covariance[:2, :2], known.noise_covariance)


@pytest.mark.parametrize(
    ("content", "trouble"),
    [
        (None, "No such file"),
        (b"", "expected columns"),
        (b"a,b\n1,2\n", "expected columns"),
        (b"frame,x,y\n1,2,left\n", "not a number"),
        (b"frame,x,y\n1,2,3\n2,3,4\n", "too few"),
        (b"frame,x,y\n1,2\0,3\n", ""),
        (b"\xff\xfe\x00\x01" * 20, ""),
        (b"frame,x,y\n1,2," + b"9" * 200_000, "field larger"),
    ],
)
def test_positions_that_nothing_can_be_learnt_from(capfd, workplace, disc_file, content, trouble):
    if content is not None:
        (workplace / "truth.csv").write_bytes(content)
    message = message_of(run_here(capfd, "track", disc_file, "--box", BOX, "--learn-dynamics", "truth.csv"))
    assert message.startswith("--learn-dynamics truth.csv: ") and trouble in message
    assert message.isprintable()


def test_what_can_be_assumed_is_listed(capfd):
    lines = [json.loads(line) for line in run_here(capfd, "models", "--json").out.splitlines()]
    assert [(line["option"], line["name"]) for line in lines] == [(o, name) for o, table in ASSUMED for name in table]
    assert [line["name"] for line in lines if line["default"]] == ["contour+colour", "similarity", "hand-held"]
    assert len(run_here(capfd, "models").out.splitlines()) == len(lines)


@pytest.mark.parametrize(
    ("option", "wrong", "right"),
    [("--model", "contours", "contour"), ("--shape", "affin", "affine"), ("--dynamics", "handheld", "hand-held")],
)
def test_what_cannot_be_assumed(capfd, disc_file, option, wrong, right):
    message = message_of(run_here(capfd, "track", disc_file, "--box", BOX, option, wrong))
    assert option.removeprefix("--") in message and f"'{wrong}': did you mean '{right}'" in message


@pytest.mark.parametrize(("width", "scale"), [(320, 1.0), (96, 1.0), (48, 0.5), (24, 0.5)])
def test_the_working_width(capfd, disc_file, monkeypatch, width, scale):
    models = []
    original = commands_track._sinks
    monkeypatch.setattr(commands_track, "_sinks", lambda *a: [models.append(a[2]), *original(*a)][1:])
    words = ("track", disc_file, "--box", "0,10,60,60", "--particles", 5, "--working-width", width)
    assert run_here(capfd, *words).code == 0
    assert models[0].extractor.working_scale == scale


def test_a_learn_frame_or_a_start_frame_past_the_end(capfd, workplace, disc_file):
    message = message_of(run_here(capfd, "track", disc_file, "--box", BOX, "--learn-frame", 12))
    assert "--learn-frame 12" in message and "12 frames" in message
    words = ("--learn-frame", 3, "--start-frame", 12, "--csv", "out.csv")
    message = message_of(run_here(capfd, "track", disc_file, "--box", BOX, *words))
    assert message == "--start-frame 12: disc.mp4 has only 12 frames"
    assert listing(workplace) == []


@pytest.mark.parametrize("option", ["--csv", "--output", "--contact-sheet"])
def test_nothing_is_overwritten_unasked(capfd, workplace, disc_file, option):
    name = {"--csv": "out.csv", "--output": "out.mp4", "--contact-sheet": "out.png"}[option]
    (workplace / name).write_bytes(b"old")
    words = ("track", disc_file, "--box", BOX, *FEW, option, name)
    assert message_of(run_here(capfd, *words)) == f"{option} {name}: exists already; --force replaces it"
    assert (workplace / name).read_bytes() == b"old"
    assert run_here(capfd, *words, "--force").code == 0
    assert (workplace / name).read_bytes() != b"old"
    assert listing(workplace) == [name]


@pytest.mark.skipif(os.name != "posix", reason="needs links and pipes")
def test_the_video_that_is_read_and_files_named_twice_are_refused(capfd, workplace, disc_file):
    (workplace / "film.mp4").write_bytes(disc_file.read_bytes())
    words = ("track", "film.mp4", "--box", BOX, "--force")
    assert "is the video that is read" in message_of(run_here(capfd, *words, "--output", "./film.mp4"))
    (workplace / "link.mp4").symlink_to("film.mp4")
    assert "is the video that is read" in message_of(run_here(capfd, *words, "--output", "link.mp4"))
    assert "is also the file of --csv" in message_of(run_here(capfd, *words, "--csv", "x.mp4", "--output", "./x.mp4"))
    os.mkfifo("pipe.csv")
    assert "not a regular file" in message_of(run_here(capfd, *words, "--csv", "pipe.csv"))
    assert (workplace / "film.mp4").read_bytes() == disc_file.read_bytes()


@pytest.mark.parametrize(("option", "name"), [("--output", "out.txt"), ("--contact-sheet", "out.gif")])
def test_an_ending_that_is_not_written(capfd, workplace, disc_file, option, name):
    message = message_of(run_here(capfd, "track", disc_file, "--box", BOX, option, name))
    assert name in message and "ends in ." in message
    assert listing(workplace) == []


@pytest.mark.parametrize("name", ["out.avi", "out.mkv", "out.mov"])
def test_other_containers(capfd, workplace, disc_file, name):
    assert run_here(capfd, "track", disc_file, "--box", BOX, *FEW, "--output", name).code == 0
    capture = cv2.VideoCapture(str(workplace / name))
    assert capture.read()[0] and (capture.get(3), capture.get(4)) == SIZE


def test_what_is_written_appears_complete_or_not_at_all(tmp_path):
    path = tmp_path / "out.txt"
    with replacing(path) as partial:
        partial.write_text("new")
        assert not path.exists() and partial.parent == tmp_path
    assert path.read_text() == "new"
    with pytest.raises(KeyboardInterrupt), replacing(path) as partial:
        partial.write_text("newer")
        raise KeyboardInterrupt
    assert path.read_text() == "new"
    assert listing(tmp_path) == ["out.txt"]


def test_the_contact_sheet_shows_frames_from_the_first_to_the_last(capfd, workplace, disc_file):
    assert run_here(capfd, "track", disc_file, "--box", BOX, *FEW, "--contact-sheet", "out.png").out == ""
    sheet = cv2.imread(str(workplace / "out.png"))
    tile = (SIZE[1] + 26, SIZE[0] + 8)
    assert sheet.shape == (3 * tile[0], 4 * tile[1], 3)
    for index in (0, 11):
        row, column = divmod(index, 4)
        shown = sheet[row * tile[0] + 4 :, column * tile[1] + 4 :][: SIZE[1], : SIZE[0]]
        reds = np.nonzero((shown[..., 2] > 150) & (shown[..., 1] < 90))
        assert abs(reds[1].mean() - centre(index)[0]) < 2.0
        changed = np.abs(shown.astype(int) - disc_frame(index)).max(axis=2) > 90
        assert changed.sum() > 20


def test_an_interrupt_before_the_first_frame_leaves_nothing(capfd, workplace, disc_file, monkeypatch):
    monkeypatch.setattr(commands_track, "_run", lambda *_: (0, None))
    monkeypatch.setattr(commands_track, "_interrupts", lambda: nullcontext([signal.SIGINT]))
    outcome = run_here(capfd, "track", disc_file, "--box", BOX, "--csv", "out.csv", "--output", "out.mp4")
    assert (outcome.code, outcome.err) == (130, "pfviz: interrupted before the first frame\n")
    assert listing(workplace) == []


def test_a_video_that_stops_in_the_middle_is_used_and_it_is_said(capfd, workplace):
    write_cut_video(workplace / "cut.avi")
    outcome = run_here(capfd, "track", "cut.avi", "--box", "8,8,40,30", "--particles", 5, "--csv", "out.csv")
    assert outcome.code == 0
    count = len(rows_of((workplace / "out.csv").read_text()))
    assert 30 < count < 70
    expected = f"pfviz: cut.avi ended early, after {count} frames: 100 frames were announced: the file is damaged"
    assert outcome.err.startswith(expected) and outcome.err.count("\n") == 1


def test_where_the_decoder_breaks_the_frames_before_are_kept(capfd, workplace, disc_file, monkeypatch):
    class Breaking(DiscVideo):
        def __init__(self):
            super().__init__(broken=5)

    monkeypatch.setattr(commands_track, "open_source", lambda *_: Breaking())
    words = ("track", "disc.mp4", "--box", BOX, *FEW, "--csv", "out.csv", "--output", "out.mp4")
    message = message_of(run_here(capfd, *words))
    assert message == "disc: the disc drive is on fire, after 5 frames; they are kept in out.csv, out.mp4"
    assert [row["frame"] for row in rows_of((workplace / "out.csv").read_text())] == list(range(5))
    assert listing(workplace) == ["out.csv", "out.mp4"]
    message = message_of(run_here(capfd, *words, "--force", "--learn-frame", 0, "--start-frame", 5))
    assert message == "disc: the disc drive is on fire"
    assert [row["frame"] for row in rows_of((workplace / "out.csv").read_text())] == list(range(5))


@pytest.mark.parametrize("name", BAD_FILES)
def test_no_file_can_do_harm(capfd, workplace, name):
    BAD_FILES[name](workplace / name)
    in_proc = Path("/proc/self/task").is_dir()
    before, processes = listing(workplace), children() if in_proc else set()
    message = message_of(run_here(capfd, "track", name, "--box", "8,8,40,30", "--output", "out.mp4"))
    assert message.startswith(f"{name}: ")
    assert listing(workplace) == before
    assert not in_proc or children() <= processes


def test_names_are_shown_harmless(capfd, workplace):
    (workplace / "a\u202e\x1b[31m\nb.mp4").write_text("no video")
    message = message_of(run_here(capfd, "track", "a\u202e\x1b[31m\nb.mp4", "--box", BOX))
    assert message.startswith(r"a\u202e\x1b[31m\nb.mp4: not a video")


@pytest.mark.parametrize(
    ("limit", "value", "trouble"),
    [("--max-pixels", 6000, "96 x 72 pixels are too many"), ("--max-memory", 1, "disc.mp4"), ("--patience", 0.1, "")],
)
def test_limits(capfd, disc_file, limit, value, trouble):
    outcome = run_here(capfd, "track", disc_file, "--box", BOX, *FEW, limit, value)
    if trouble:
        assert trouble in message_of(outcome)
    for wrong in (0, "nan", "-1"):
        message = message_of(run_here(capfd, "track", disc_file, "--box", BOX, f"{limit}={wrong}"))
        assert limit in message and repr(str(wrong)) in message


def test_a_limit_on_frames_and_a_rate_of_images(capfd, workplace, late_disc):
    words = ("track", late_disc, "--box", "10,10,30,30", *FEW, "--max-frames", 7, "--frame-rate", 12)
    outcome = run_here(capfd, *words, "--output", "out.mp4", "--json")
    assert len(outcome.out.splitlines()) == 7
    assert outcome.err.endswith("ended early, after 7 frames: no more than 7 frames are used (max_frames)\n")
    assert cv2.VideoCapture("out.mp4").get(cv2.CAP_PROP_FPS) == pytest.approx(12.0)


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_progress_tells_rate_and_time_left():
    seconds = iter([0.0, 0.1, 2.0, 2.1, 4.0, 10.0])
    screen = Terminal()
    progress = Progress(lambda: 300, screen, lambda: next(seconds))
    for count in (1, 20, 21, 60):
        progress.show(count)
    progress.close(300)
    *shown, last = screen.getvalue().replace("\x1b[K", "").split("\r")[1:]
    assert shown[1] == f"{'██':░<24} 20 of 300 frames  10 frames/s  0:28 left"
    assert shown[2] == f"{'█████':░<24} 60 of 300 frames  15 frames/s  0:16 left"
    assert len(shown) in (3, 4)
    assert (shown[-1] + last).endswith("300 frames in 0:10, 30 frames/s\n")


def test_progress_without_a_known_end_and_without_a_terminal():
    seconds = iter([0.0, 1.0, 2.0])
    screen = Terminal()
    Progress(lambda: None, screen, lambda: next(seconds)).show(25)
    assert "25 frames  25 frames/s" in screen.getvalue() and "left" not in screen.getvalue()
    paper = io.StringIO()
    progress = Progress(lambda: 10, paper)
    progress.show(3)
    progress.close(10)
    assert paper.getvalue() == ""


def test_durations():
    assert [duration(s) for s in (0, 7.4, 59.6, 750, 11_100)] == ["0:00", "0:07", "1:00", "12:30", "3:05:00"]


@pytest.mark.parametrize("name", FILTERS)
def test_whatever_is_lost_is_looked_for_unless_it_is_not_wanted(capfd, disc_file, monkeypatch, name):
    """Without restarts it is still resampled, which keeps the smallest weights of look-alikes from growing."""
    filters = []
    monkeypatch.setattr(commands_track, "track", lambda *a: filters.append(a[2]) or ())
    words = ("track", disc_file, "--box", BOX, "--filter", name, "--particles", 7)
    run_here(capfd, *words)
    run_here(capfd, *words, "--no-restart")
    assert filters == [Restarting(make_filter(name, 7)), Restarting(make_filter(name, 7), share=0.0)]
