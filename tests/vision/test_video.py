"""Video sources: right frames in any order, and one clear line for whatever cannot be used."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator

import numpy as np
import pytest
from hostile_files import SIZE, number_in, numbered, write_video

from pfviz.vision import video as video_module
from pfviz.vision.decoding import GuardedVideo, open_video
from pfviz.vision.limits import Limits
from pfviz.vision.video import Camera, EndOfVideo, VideoError, VideoSource, frames, open_source, suggested_box


@pytest.fixture
def video(tmp_path) -> Iterator[GuardedVideo]:
    with open_video(write_video(tmp_path / "numbers.mp4", 120)) as opened:
        yield opened


def test_a_file_tells_its_size_rate_and_length(video):
    assert isinstance(video, VideoSource)
    assert (video.name, video.size, video.frame_rate, video.frame_count) == ("numbers.mp4", SIZE, 25.0, 120)
    assert video.truth(0) is None
    assert suggested_box(video) is None


def test_frames_come_in_order(video):
    assert [(index, number_in(image)) for index, image in frames(video, 3)] == [(i, i) for i in range(3, 120)]


@pytest.mark.parametrize("cached", [True, False])
def test_any_frame_can_be_read_at_any_time(video, cached):
    for index in (50, 10, 51, 119, 0, 118, 60, 61, 5):
        if not cached:
            video._cache.clear()
        assert number_in(video.read(index)) == index


def test_past_the_end_is_the_end_and_not_a_failure(video):
    with pytest.raises(EndOfVideo, match=r"numbers.mp4.*ends after 120 frames"):
        video.read(120)
    with pytest.raises(EndOfVideo):
        video.read(-1)
    assert number_in(video.read(7)) == 7


def test_frames_cannot_be_written_to(video):
    with pytest.raises(ValueError, match="read-only"):
        video.read(0)[0, 0] = 0


def test_of_a_truncated_file_the_whole_frames_are_used(tmp_path):
    path = tmp_path / "cut.avi"
    write_video(path, 100, "MJPG")
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with open_source(path) as source:
        numbers = [number_in(image) for _, image in frames(source)]
        assert 30 < len(numbers) < 70
        assert numbers == list(range(len(numbers)))
        assert source.frame_count == len(numbers)
        with pytest.raises(EndOfVideo, match=r"ends early after .* frames, 100 frames were announced"):
            source.read(len(numbers))


def bad_files(folder):
    (folder / "folder.mp4").mkdir()
    (folder / "empty.mp4").write_bytes(b"")
    (folder / "text.mp4").write_text("this is not a video\n" * 50)
    (folder / "garbage.mp4").write_bytes(np.random.default_rng(0).bytes(30_000))
    write_video(folder / "none.mp4", 0)
    headless = folder / "headless.mp4"
    write_video(headless, 30)
    headless.write_bytes(headless.read_bytes()[:1000])


@pytest.mark.parametrize(
    ("name", "trouble"),
    [
        ("missing.mp4", "no such file"),
        ("folder.mp4", "is a folder"),
        ("empty.mp4", "is empty"),
        ("text.mp4", "not a video"),
        ("garbage.mp4", "not a video"),
        ("none.mp4", "decoded"),
        ("headless.mp4", "decoded"),
    ],
)
def test_a_file_that_cannot_be_used_is_named_in_one_line(tmp_path, name, trouble):
    bad_files(tmp_path)
    with pytest.raises(VideoError) as error:
        open_source(tmp_path / name)
    message = str(error.value)
    assert str(tmp_path / name) in message
    assert trouble in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("text", "trouble"),
    [
        ("scene:twim", "did you mean 'twin'"),
        ("scene:", "there are twin"),
        ("scene:twin:x", "seed must be a whole number, got 'x'"),
        ("scene:twin:-3", "seed must be a whole number, got '-3'"),
        ("camera:front", "expected camera:N"),
        ("camera:97", "camera:97: there is no such camera"),
    ],
)
def test_a_name_that_means_nothing_is_answered_with_what_was_expected(text, trouble):
    with pytest.raises(VideoError, match=trouble):
        open_source(text)


def test_scenes_are_opened_by_name_and_seed():
    default, seventh = open_source("scene:twin"), open_source("scene:twin:7")
    assert (default.name, seventh.name) == ("scene:twin", "scene:twin:7")
    assert default.truth(0) != seventh.truth(0)
    assert suggested_box(default, 3) == default.box(3)  # pyright: ignore[reportAttributeAccessIssue]


def test_nothing_is_written_on_stderr_by_the_decoder(tmp_path):
    bad_files(tmp_path)
    write_video(tmp_path / "cut.avi", 60, "MJPG")
    (tmp_path / "cut.avi").write_bytes((tmp_path / "cut.avi").read_bytes()[:20_000])
    script = """
import pathlib, sys
from pfviz.vision.video import VideoError, frames, open_source
for name in [*sorted(map(str, pathlib.Path(sys.argv[1]).iterdir())), "camera:97"]:
    try:
        list(frames(open_source(name)))
    except VideoError:
        pass
"""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path)], capture_output=True, text=True, env=environment
    )
    assert (done.returncode, done.stderr) == (0, "")


class Capture:
    """A camera that shows numbers, 40 of them, and then breaks."""

    def __init__(self) -> None:
        self.count, self.released = 0, False

    def isOpened(self) -> bool:
        return True

    def get(self, _: int) -> float:
        return float("nan")

    def read(self):
        self.count += 1
        return self.count <= 40, numbered(self.count - 1)

    def release(self) -> None:
        self.released = True


def test_a_camera_numbers_its_frames_and_keeps_the_recent_ones(monkeypatch):
    capture = Capture()
    monkeypatch.setattr(video_module, "_capture", lambda *_: capture)
    monkeypatch.setattr(video_module, "CACHE_BYTES", 10 * numbered(0).nbytes)
    with open_source("camera:3", Limits(max_frames=50)) as camera:
        assert isinstance(camera, Camera) and isinstance(camera, VideoSource)
        assert (camera.name, camera.size, camera.frame_rate, camera.frame_count) == ("camera:3", SIZE, 30.0, None)
        assert [number_in(camera.read(i)) for i in (0, 1, 5, 4, 30)] == [0, 1, 5, 4, 30]
        assert camera.latest == 30
        assert number_in(camera.read(25)) == 25
        with pytest.raises(VideoError, match=r"camera:3: frame 3 is no longer kept"):
            camera.read(3)
        with pytest.raises(VideoError, match="gives no more frames"):
            camera.read(45)
        with pytest.raises(EndOfVideo, match="ends after 50 frames"):
            camera.read(50)
    assert capture.released
