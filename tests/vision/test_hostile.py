"""No file can do harm: one clear line for each, and nothing of the decoder stays behind."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import cv2
import pytest
from hostile_files import (
    BAD_FILES,
    SIZE,
    children,
    coded,
    number_in,
    open_files,
    write_cut_video,
    write_images,
    write_video,
)
from hypothesis import given
from hypothesis import strategies as st

from pfviz.vision import decoder, decoding
from pfviz.vision.decoding import GuardedVideo, open_video
from pfviz.vision.limits import Limits, display_name
from pfviz.vision.video import EndOfVideo, VideoError, end_note, frames, open_source, open_upload

linux = pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="counts processes and files in /proc")
posix = pytest.mark.skipif(os.name != "posix", reason="needs the limits and signals of POSIX")


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> Path:
    return write_video(tmp_path_factory.mktemp("good") / "good.mp4", 100)


@pytest.fixture(autouse=True)
def nothing_stays_behind():
    """Whatever a test does, no process of it is left."""
    if not Path("/proc/self/task").is_dir():
        yield
        return
    before = children()
    yield
    if children() - before:
        gc.collect()
    assert children() <= before


@pytest.mark.parametrize("name", BAD_FILES)
def test_a_bad_file_is_named_in_one_line(tmp_path, name):
    BAD_FILES[name](tmp_path / name)
    with pytest.raises(VideoError) as error:
        open_upload(tmp_path / name)
    message = str(error.value)
    assert message.startswith(f"{tmp_path / name}: ")
    assert message.isprintable()
    assert len(message.removeprefix(str(tmp_path))) < 150


@linux
def test_nothing_leaks_however_often_files_are_opened(tmp_path):
    size, count = (640, 480), 30
    good = write_video(tmp_path / "good.mp4", count, size=size)
    names = ("garbage.mkv", "huge.png", "broken.png")
    for name in names:
        BAD_FILES[name](tmp_path / name)

    def visit():
        with open_source(good) as source:
            assert sum(1 for _ in frames(source)) == count
        for name in names:
            with pytest.raises(VideoError):
                open_source(tmp_path / name)

    def memory() -> int:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    visit()
    processes, files, before = children(), open_files(), memory()
    for _ in range(6):
        visit()
    assert children() == processes
    assert open_files() == files
    assert memory() - before < 6 * count * 3 * size[0] * size[1] / 3


def test_a_source_that_is_forgotten_is_closed(good):
    source = open_source(good)
    source.read(3)
    del source  # the fixture looks for what stays behind


@posix
def test_the_decoder_ends_when_its_parent_is_killed(good):
    script = """
import sys
from pfviz.vision.video import open_source
source = open_source(sys.argv[1])
print(source._decoder._process.pid, flush=True)
sys.stdin.read()
"""
    command = [sys.executable, "-c", script, str(good)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment) as parent:
        assert parent.stdout is not None
        pid = int(parent.stdout.readline())
        os.kill(pid, 0)
        parent.kill()
    for _ in range(400):
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return
        state = Path(f"/proc/{pid}/stat")
        if state.exists() and state.read_text().rsplit(")", 1)[1].split()[0] == "Z":
            return
        time.sleep(0.05)
    pytest.fail("the decoder lives on")


def pretend(monkeypatch, tmp_path, body: str) -> None:
    """Let ``body`` be the decoder; ``request()`` takes a request, ``answer(dict, pixels)`` answers."""
    program = f"""
import json, os, signal, sys, time
def request():
    return json.loads(sys.stdin.buffer.readline())
def answer(answer, pixels=b""):
    sys.stdout.buffer.write(json.dumps(answer).encode() + b"\\n" + pixels)
    sys.stdout.buffer.flush()
request()
{body}
"""
    path = tmp_path / "pretended.py"
    path.write_text(program)
    monkeypatch.setattr(decoder, "__file__", str(path))


OPENED = 'answer({"opened": [8, 4], "rate": 25.0, "count": 9})\n'
FRAME = 'answer({"frame": request()["read"], "shape": [4, 8]}, bytes(96))\n'


@pytest.mark.parametrize(
    ("body", "trouble"),
    [
        ("time.sleep(60)", "no frame within 0.5 seconds"),
        ("os.kill(os.getpid(), signal.SIGSEGV)", "crashed on it"),
        ("sys.exit(3)", r"crashed on it \(code 3\)"),
        ("print('hello', flush=True)", "cannot be understood"),
        ("sys.stdout.write('x' * 1_000_000)", "cannot be understood"),
        ("answer({'fail': 'two\\nlines \\u202e'})", r"two\\nlines \\u202e"),
        ("answer({'frame': 0, 'shape': [4, 8]}, bytes(96))", "cannot be understood"),
        (OPENED + OPENED + "time.sleep(60)", "cannot be understood"),
        (OPENED + FRAME + "time.sleep(60)", "no frame within 0.5 seconds"),
        (OPENED + FRAME + "os.abort()", "crashed on it"),
        (OPENED + "answer({'frame': 5, 'shape': [4, 8]}, bytes(96)); time.sleep(60)", "cannot be understood"),
        (OPENED + "answer({'frame': 0, 'shape': [65535, 65535]}); time.sleep(60)", "cannot be understood"),
        (OPENED + "answer({'frame': 0, 'shape': [-4, -8]}); time.sleep(60)", "cannot be understood"),
        (OPENED + "answer({'frame': 0, 'shape': [4, 8]}, bytes(95))", "cannot be understood"),
    ],
)
def test_a_decoder_that_hangs_crashes_or_lies_does_no_harm(tmp_path, monkeypatch, good, body, trouble):
    pretend(monkeypatch, tmp_path, body)
    limits = Limits(patience=0.5) if "0.5" in trouble else Limits()
    with pytest.raises(VideoError, match=trouble) as error, open_source(good, limits) as source:
        for index in range(9):
            source.read(index)
    assert str(error.value).startswith(f"{good}: ")
    assert "\n" not in str(error.value)


def test_a_decoder_that_hangs_is_closed_at_once(tmp_path, monkeypatch, good):
    pretend(monkeypatch, tmp_path, OPENED + "time.sleep(1000)")
    source = open_source(good)
    closing = threading.Thread(target=source.close, daemon=True)
    closing.start()
    closing.join(20.0)
    assert not closing.is_alive()


def test_signs_of_life_keep_a_slow_decoder_going(tmp_path, monkeypatch, good):
    slow = 'for i in range(8): time.sleep(0.4); answer({"alive": i})\n'
    pretend(monkeypatch, tmp_path, OPENED + slow + FRAME * 9)
    with open_source(good, Limits(patience=2.5)) as source:
        assert source.read(0).shape == (4, 8, 3)


@posix
def test_a_decoder_that_is_killed_in_the_middle_is_told(good):
    with open_video(good) as source:
        source.read(0)
        source._decoder._process.send_signal(signal.SIGKILL)
        with pytest.raises(VideoError, match=r"good.mp4: the decoder crashed on it \(signal 9\)"):
            for index in range(1, 100):
                source.read(index)
        with pytest.raises(VideoError, match="signal 9"):
            source.read(99)
        assert number_in(source.read(0)) == 0


@linux
def test_memory_is_limited(tmp_path):
    (tmp_path / "large.png").write_bytes(coded(1, size=(5000, 5000)))
    with open_source(tmp_path / "large.png") as source:
        assert number_in(cv2.resize(source.read(0), SIZE)) == 1
    with pytest.raises(VideoError, match=r"large.png: decoding it needs more memory than max_memory"):
        open_source(tmp_path / "large.png", Limits(max_memory=340 * 2**20))


@pytest.mark.parametrize(
    ("limits", "trouble"),
    [
        (Limits(max_bytes=1000), "bytes are too many .max_bytes is 1000"),
        (Limits(max_pixels=3000), "64 x 48 pixels are too many .max_pixels is 3000"),
    ],
)
def test_a_file_beyond_the_limits_is_refused(good, limits, trouble):
    with pytest.raises(VideoError, match=f"good.mp4: .*{trouble}"):
        open_source(good, limits)


def test_the_pixels_are_counted_before_any_are_decoded(good, monkeypatch):
    monkeypatch.setattr(decoder.VideoReader, "_grab", lambda _: pytest.fail("a frame was decoded"))
    with pytest.raises(decoder.Unreadable, match="64 x 48 pixels are too many"):
        decoder.VideoReader(str(good), 3000)


def test_a_video_that_is_too_long_ends_and_says_so(good):
    with open_source(good, Limits(max_frames=10)) as source:
        assert source.frame_count == 10
        assert end_note(source) is None
        assert [number_in(image) for _, image in frames(source)] == list(range(10))
        assert end_note(source) == "no more than 10 frames are used (max_frames)"
        with pytest.raises(EndOfVideo, match=r"ends early after 10 frames, .*max_frames"):
            source.read(10)


@pytest.mark.parametrize("field", ["max_bytes", "max_pixels", "max_frames", "patience", "max_memory"])
@pytest.mark.parametrize("value", [0, -1, float("nan")])
def test_limits_are_positive(field, value):
    with pytest.raises(ValueError, match=f"{field} must be positive, got {value}"):
        Limits(**{field: value})


def test_a_video_that_stops_in_the_middle_says_so(tmp_path):
    with open_source(write_cut_video(tmp_path / "cut.avi")) as source:
        count = sum(1 for _ in frames(source))
        assert 30 < count < 70
        assert end_note(source) == "100 frames were announced: the file is damaged or cut short"


CONTAINERS = [
    *(("a.mp4", "mp4v"), ("a.mov", "MJPG"), ("a.avi", "MJPG"), ("raw.avi", "I420"), ("a.mkv", "mp4v")),
    *(("a.webm", "VP80"), ("a.flv", "FLV1"), ("a.wmv", "WMV2"), ("a.mpg", "MPG2"), ("a.ts", "MPG2")),
]


@pytest.mark.parametrize(("name", "codec"), CONTAINERS)
def test_common_containers_are_read_to_their_end_and_back(tmp_path, name, codec):
    path = write_video(tmp_path / name, 30, codec)
    if path.stat().st_size < 1000:
        pytest.skip(f"this OpenCV does not write {codec}")
    with open_video(path) as source:
        assert [number_in(image) for _, image in frames(source)] == list(range(30))
        assert (source.frame_count, end_note(source)) == (30, None)
        for index in (17, 3, 29, 0):
            source._cache.clear()
            assert number_in(source.read(index)) == index


@pytest.mark.parametrize("codec", [".mp4", ".avi", ".mkv"])
def test_the_content_counts_and_not_the_name(tmp_path, codec):
    write_video(tmp_path / f"film{codec}", 5, "MJPG").rename(tmp_path / "film.png")
    with open_source(tmp_path / "film.png") as source:
        assert sum(1 for _ in frames(source)) == 5


NAMES = [
    b"caf\xe9.mp4",
    b"two\nlines.mp4",
    b"\x1b[31mred.mp4",
    "gpj.\u202e4pm.mp4".encode(),
    b"50%d.mp4",
    b"-a b'c.mp4",
]


@posix
@pytest.mark.parametrize("name", NAMES)
def test_whatever_the_name_the_file_opens_and_the_name_is_harmless(tmp_path, name, good):
    path = Path(os.fsdecode(os.fsencode(tmp_path) + b"/" + name))
    path.write_bytes(good.read_bytes())
    with open_source(path) as source:
        assert source.name.isprintable()
        assert number_in(source.read(7)) == 7
        assert number_in(source.read(2)) == 2
    path.write_bytes(b"x")
    with pytest.raises(VideoError) as error:
        open_source(path)
    assert str(error.value).isprintable()


@given(st.text(max_size=400))
def test_a_name_that_is_shown_is_one_short_printable_line(name):
    shown = display_name(name)
    assert shown.isprintable()
    assert len(shown) <= 240
    if name.isprintable() and len(name) <= 240:
        assert shown == name


def test_what_is_escaped_can_be_told_apart():
    assert display_name("a\nb") == r"a\nb"
    assert display_name("a\x1b[0m\u202eb\u200fc") == r"a\x1b[0m\u202eb\u200fc"
    assert display_name(os.fsdecode(b"caf\xe9")) == r"caf\xe9"
    assert display_name("a" * 300 + "b" * 300 + ".mp4") == "a" * 120 + "…" + "b" * 115 + ".mp4"


@posix
def test_only_regular_files_are_opened(tmp_path, good):
    os.mkfifo(tmp_path / "pipe.mp4")
    (tmp_path / "link.mp4").symlink_to(good)
    with pytest.raises(VideoError, match=r"pipe.mp4: is not a regular file"):
        open_source(tmp_path / "pipe.mp4")
    with pytest.raises(VideoError, match=r"link.mp4: is a link"):
        open_upload(tmp_path / "link.mp4")
    with pytest.raises(VideoError, match="is a folder"):
        open_upload(write_images(tmp_path / "images", 2))
    with open_source(tmp_path / "link.mp4") as source:
        assert source.frame_count == 100


def test_of_an_upload_fewer_frames_are_kept(good):
    with open_upload(good, cache_bytes=5 * 3 * SIZE[0] * SIZE[1]) as source:
        assert [number_in(image) for _, image in frames(source)] == list(range(100))
        assert number_in(source.read(3)) == 3
        assert isinstance(source, GuardedVideo) and source._cache.nbytes <= 5 * 3 * SIZE[0] * SIZE[1]


def test_a_name_that_no_system_knows_is_no_such_file():
    for name in ("x" * 5000, "a\0b"):
        with pytest.raises(VideoError, match="no such file"):
            open_source(name)


def test_a_closed_source_gives_no_more_frames(good):
    source: GuardedVideo = decoding.open_video(good)
    source.close()
    source.close()
    with pytest.raises(VideoError, match=r"good.mp4: is closed"):
        source.read(0)
