"""Sequences of images: in their order, of one size, and their sizes known from the headers."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from hostile_files import BAD_FILES, SIZE, coded, number_in, write_images
from hypothesis import given
from hypothesis import strategies as st

from pfviz.vision import decoding
from pfviz.vision.images import image_size, natural_key
from pfviz.vision.limits import Limits
from pfviz.vision.video import EndOfVideo, VideoError, end_note, frames, open_source

FORMATS = (".png", ".jpg", ".bmp", ".tif", ".webp", ".ppm")


def numbers(source) -> list[int]:
    return [number_in(image) for _, image in frames(source)]


@pytest.mark.parametrize("suffix", FORMATS)
def test_a_folder_of_images_is_a_video(tmp_path, suffix):
    folder = write_images(tmp_path / "images", 12, suffix)
    (folder / "notes.txt").write_text("not an image")
    (folder / ".hidden.png").write_text("not an image")
    with open_source(folder) as source:
        assert (source.name, source.size, source.frame_count, source.frame_rate) == ("images", SIZE, 12, 30.0)
        assert numbers(source) == list(range(12))
        assert end_note(source) is None
        assert number_in(source.read(4)) == 4
        with pytest.raises(EndOfVideo, match="images: ends after 12 frames"):
            source.read(12)


def test_a_pattern_chooses_among_images_in_natural_order(tmp_path):
    folder = write_images(tmp_path / "images", 21)
    for pattern, expected in (("*.png", range(21)), ("frame?.png", range(10)), ("frame*[02468].png", range(0, 21, 2))):
        with open_source(folder / pattern, frame_rate=12.0) as source:
            assert numbers(source) == list(expected)
            assert source.frame_rate == 12.0


def test_a_file_whose_name_looks_like_a_pattern_is_that_file(tmp_path):
    (tmp_path / "[1]*.png").write_bytes(coded(9))
    with open_source(tmp_path / "[1]*.png") as source:
        assert numbers(source) == [9]


@pytest.mark.parametrize("name", ["nine.png", "nine.mp4"])
def test_an_image_is_a_video_of_one_frame(tmp_path, name):
    (tmp_path / name).write_bytes(coded(9))
    with open_source(tmp_path / name) as source:
        assert numbers(source) == [9]


@pytest.mark.parametrize(
    ("name", "trouble"),
    [("empty", "is a folder without images"), ("*.png", "no file matches"), ("texts/*", "t.txt: not an image")],
)
def test_where_there_are_no_images_that_is_said(tmp_path, name, trouble):
    (tmp_path / "empty").mkdir()
    (tmp_path / "texts").mkdir()
    (tmp_path / "texts" / "t.txt").write_text("text")
    with pytest.raises(VideoError, match=trouble):
        open_source(tmp_path / name)


def test_images_of_another_size_or_none_are_named_before_anything_is_decoded(tmp_path, monkeypatch):
    monkeypatch.setattr(decoding, "DecoderProcess", lambda *_: pytest.fail("the decoder started"))
    folder = write_images(tmp_path / "images", 5)
    (folder / "frame3.png").write_bytes(coded(3, size=(32, 24)))
    with pytest.raises(VideoError, match=r"frame3.png: 32 x 24 pixels, but frame0.png has 64 x 48"):
        open_source(folder)
    (folder / "frame3.png").write_text("text")
    with pytest.raises(VideoError, match=r"frame3.png: not an image"):
        open_source(folder)
    BAD_FILES["huge.png"](folder / "frame3.png")
    with pytest.raises(VideoError, match=r"frame3.png: 65535 x 65535 pixels are too many"):
        open_source(folder)
    with pytest.raises(VideoError, match=r"frame0.png: the file is too large .max_bytes is 100"):
        open_source(folder, Limits(max_bytes=100))


def test_an_image_that_breaks_off_ends_the_sequence_early(tmp_path):
    folder = write_images(tmp_path / "images", 5)
    BAD_FILES["broken.png"](folder / "frame3.png")
    with open_source(folder) as source:
        assert numbers(source) == [0, 1, 2]
        assert end_note(source) == "image 3 cannot be decoded or is of another size"
        assert source.frame_count == 3


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("size", [(1, 1), (300, 7), (7, 300)])
def test_the_header_tells_the_size(tmp_path, suffix, size):
    path = tmp_path / f"image{suffix}"
    path.write_bytes(coded(5, suffix, size))
    assert image_size(path) == size


def test_the_other_kinds_of_header(tmp_path):
    image = np.zeros((21, 37, 4), np.uint8)
    lossless = cv2.imencode(".webp", image, [cv2.IMWRITE_WEBP_QUALITY, 101])[1].tobytes()
    cases = {
        "lossless.webp": lossless,
        "extended.webp": b"RIFF" + bytes(4) + b"WEBPVP8X" + bytes(8) + bytes([36, 0, 0, 20, 0, 0]),
        "big-endian.tif": b"MM\0*\0\0\0\x08\0\x02\x01\0\0\x03\0\0\0\x01\0\x25\0\0\x01\x01\0\x04\0\0\0\x01\0\0\0\x15",
        "padded.jpg": patched_jpeg(),
        "commented.ppm": b"P6 # made by hand\n# of 37\n37 21\n255\n" + bytes(3 * 37 * 21),
        "old.bmp": b"BM" + bytes(12) + b"\x0c\0\0\0" + bytes([37, 0, 21, 0]) + bytes(10),
    }
    for name, data in cases.items():
        (tmp_path / name).write_bytes(data)
        assert image_size(tmp_path / name) == (37, 21), name


def patched_jpeg() -> bytes:
    """With a fill byte before a segment, and that segment to be skipped."""
    data = cv2.imencode(".jpg", np.zeros((21, 37, 3), np.uint8))[1].tobytes()
    return data[:2] + b"\xff\xff\xe5\x00\x06\xff\xc0\xff\xc0" + data[2:]


@given(st.binary(max_size=200), st.sampled_from([coded(3, suffix) for suffix in FORMATS]), st.integers(0, 200))
def test_no_header_is_too_strange(tmp_path_factory, noise, image, keep):
    path = tmp_path_factory.getbasetemp() / "strange"
    path.write_bytes(image[:keep] + noise)
    size = image_size(path)
    assert size is None or min(size) > 0


def test_natural_order():
    names = ["a.png", "a1.png", "a2.png", "a10.png", "A11.png", "b1.png", "b1c2.png", "b01c10.png"]
    assert [p.name for p in sorted(map(Path, reversed(names)), key=natural_key)] == names
