"""Visitors of the same video share one decoder and one cache."""

from __future__ import annotations

import threading
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hostile_files import number_in, write_video

from pfviz.vision.decoding import GuardedVideo, open_video
from pfviz.vision.scenes import Scene
from pfviz.vision.shared import SharedVideo
from pfviz.vision.video import FrameCache, VideoError, VideoSource, suggested_box


@pytest.fixture
def opened() -> list[GuardedVideo]:
    """The sources that were opened, in order."""
    return []


@pytest.fixture
def shared(tmp_path, opened) -> SharedVideo:
    path = write_video(tmp_path / "numbers.mp4", 60)

    def open_counted() -> GuardedVideo:
        opened.append(open_video(path))
        return opened[-1]

    return SharedVideo(open_counted)


def is_running(source: GuardedVideo) -> bool:
    return source._decoder._process.poll() is None


def test_frames_are_decoded_once_for_everybody(shared, opened):
    with shared.open() as one, shared.open() as other:
        assert isinstance(one, VideoSource)
        assert (one.size, one.frame_rate, one.frame_count, one.name) == ((64, 48), 25.0, 60, "numbers.mp4")
        assert one.read(5) is other.read(5)
        assert shared.visitors == 2
    assert len(opened) == 1


def test_the_last_to_leave_closes_and_the_next_to_come_opens_again(shared, opened):
    one, other = shared.open(), shared.open()
    one.close()
    one.close()
    assert is_running(opened[0]) and number_in(other.read(8)) == 8
    with pytest.raises(VideoError, match=r"numbers.mp4: is closed"):
        one.read(8)
    other.close()
    assert not is_running(opened[0]) and shared.visitors == 0
    with shared.open() as third:
        assert number_in(third.read(9)) == 9
    assert len(opened) == 2


def test_who_comes_after_a_failure_gets_a_new_source(shared, opened):
    with shared.open() as early:
        early.read(0)
        opened[0]._decoder._process.kill()
        with pytest.raises(VideoError, match="crashed"):
            for index in range(1, 60):
                early.read(index)
        with shared.open() as late:
            assert number_in(late.read(50)) == 50
            early.close()
            assert number_in(late.read(20)) == 20 and shared.visitors == 1
    assert len(opened) == 2 and not any(map(is_running, opened))


def test_many_visitors_each_get_what_they_ask_for(shared):
    wrong: list[tuple[int, int]] = []

    def visit(seed: int) -> None:
        with shared.open() as source:
            for index in np.random.default_rng(seed).integers(0, 60, 40):
                number = number_in(source.read(int(index)))
                if number != index:
                    wrong.append((number, int(index)))

    threads = [threading.Thread(target=visit, args=(seed,)) for seed in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong
    assert shared.visitors == 0


def test_a_source_that_does_not_open_has_no_visitors(tmp_path):
    shared = SharedVideo(partial(open_video, Path(tmp_path / "missing.mp4")))
    for _ in range(2):
        with pytest.raises(VideoError, match="no such file"):
            shared.open()
    assert shared.visitors == 0


def test_what_only_some_sources_have_is_passed_on(shared):
    scene = Scene(0)
    with SharedVideo(lambda: scene).open() as source:
        assert suggested_box(source, 3) == scene.box(3)
        assert source.truth(3) == scene.truth(3)
    with shared.open() as source:
        assert suggested_box(source) is None


class Lamp:
    """A camera: frames come once, ``latest`` counts them."""

    name, size, frame_rate, frame_count = "camera:0", (2, 2), 30.0, None

    def __init__(self) -> None:
        self.latest = 0

    def read(self, index: int) -> np.ndarray:
        self.latest = max(self.latest, index)
        return np.full((2, 2, 3), index, np.uint8)

    def truth(self, index: int) -> None:
        return None

    def close(self) -> None:
        pass

    def __enter__(self):
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def test_who_comes_later_to_a_camera_begins_with_what_it_shows_now():
    shared = SharedVideo(Lamp)
    with shared.open() as early:
        assert [int(early.read(i)[0, 0, 0]) for i in range(3)] == [0, 1, 2]
        with shared.open() as late:
            assert [int(late.read(i)[0, 0, 0]) for i in range(3)] == [2, 3, 4]
        assert int(early.read(3)[0, 0, 0]) == 3


def test_the_cache_keeps_the_latest_within_its_bytes():
    cache = FrameCache(10 * 300)
    for index in range(25):
        cache.put(index, np.full((10, 10, 3), index, np.uint8))
        cache.get(0)
    assert [index for index in range(25) if index in cache] == [0, *range(16, 25)]
    assert cache.nbytes == 3000
    cache.put(20, np.zeros((10, 10, 3), np.uint8))
    assert cache.nbytes == 3000 and 16 in cache
    cache.clear()
    assert cache.nbytes == 0 and 20 not in cache
