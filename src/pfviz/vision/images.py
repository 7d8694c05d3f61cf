"""Sequences of images: which files belong to them, and how large they are, read from their headers alone."""

from __future__ import annotations

import glob
import os
import re
import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import BinaryIO

from pfviz.vision.limits import Limits, display_name
from pfviz.vision.video import VideoError

Size = tuple[int, int]

SUFFIXES = frozenset(
    {".png", ".jpg", ".jpeg", ".jpe", ".bmp", ".dib", ".tif", ".tiff", ".webp", ".ppm", ".pgm", ".pbm", ".pnm"}
)
_MOST_SEGMENTS = 1000
_NO_SIZE_MARKERS = frozenset({0xC4, 0xC8, 0xCC})


def natural_key(path: Path) -> list[tuple[int, int | str]]:
    """Sorts ``frame2.png`` before ``frame10.png``."""
    parts = re.split(r"([0-9]+)", path.stem)
    return [(0, int(part)) if i % 2 else (1, part.casefold()) for i, part in enumerate(parts)]


def images_in(folder: Path) -> list[Path]:
    """The images of ``folder`` in natural order, hidden files left out.

    Raises:
        VideoError: if there are none, or the folder cannot be read.
    """
    try:
        found = [Path(entry.path) for entry in os.scandir(folder) if entry.is_file() and not entry.name.startswith(".")]
    except OSError as error:
        raise VideoError(f"{display_name(folder)}: the folder cannot be read ({error.strerror})") from None
    paths = sorted((path for path in found if path.suffix.lower() in SUFFIXES), key=natural_key)
    if not paths:
        raise VideoError(f"{display_name(folder)}: is a folder without images (PNG, JPEG, BMP, TIFF, WebP, PNM)")
    return paths


def images_matching(pattern: str) -> list[Path]:
    """The files that ``pattern`` matches (``*``, ``?``, ``[...]``, ``**``), in natural order.

    Raises:
        VideoError: if there are none.
    """
    paths = [Path(match) for match in glob.glob(pattern, recursive=True) if os.path.isfile(match)]
    if not paths:
        raise VideoError(f"{display_name(pattern)}: no file matches")
    return sorted(paths, key=lambda path: ([part.casefold() for part in path.parent.parts], natural_key(path)))


def common_size(paths: Sequence[Path], limits: Limits) -> Size:
    """Width and height of the images, which must all have the same; nothing of them is decoded.

    Raises:
        VideoError: if one is not an image, is too large, or has another size than the first.
    """
    first: Size | None = None
    for path in paths:
        shown = display_name(path)
        size = image_size(path)
        if size is None:
            raise VideoError(f"{shown}: not an image that can be read")
        if size[0] * size[1] > limits.max_pixels:
            raise VideoError(f"{shown}: {size[0]} x {size[1]} pixels are too many (max_pixels is {limits.max_pixels})")
        if path.stat().st_size > limits.max_bytes:
            raise VideoError(f"{shown}: the file is too large (max_bytes is {limits.max_bytes})")
        first = first or size
        if size != first:
            raise VideoError(
                f"{shown}: {size[0]} x {size[1]} pixels, but {display_name(paths[0].name)} has {first[0]} x {first[1]}"
            )
    if first is None:
        raise VideoError("no images were given")
    return first


def image_size(path: Path) -> Size | None:
    """Width and height that the header of an image tells; None where it is no PNG, JPEG, BMP, TIFF, WebP or PNM."""
    try:
        with path.open("rb") as stream:
            head = stream.read(32)
            for signature, read in _READERS:
                if re.match(signature, head, re.DOTALL):
                    stream.seek(0)
                    width, height = read(stream)
                    return (width, height) if width > 0 and height > 0 else None
    except (OSError, ValueError, struct.error):
        pass
    return None


def _unpack(stream: BinaryIO, offset: int, layout: str) -> tuple[int, ...]:
    stream.seek(offset)
    return struct.unpack(layout, stream.read(struct.calcsize(layout)))


def _png_size(stream: BinaryIO) -> tuple[int, ...]:
    return _unpack(stream, 16, ">II")


def _bmp_size(stream: BinaryIO) -> tuple[int, ...]:
    (header,) = _unpack(stream, 14, "<I")
    width, height = _unpack(stream, 18, "<HH" if header == 12 else "<ii")
    return width, abs(height)


def _jpeg_size(stream: BinaryIO) -> tuple[int, ...]:
    """The size in the first start-of-frame segment."""
    offset = 2
    for _ in range(_MOST_SEGMENTS):
        mark, kind, length = _unpack(stream, offset, ">BBH")
        if mark != 0xFF:
            break
        if kind == 0xFF or kind == 0x01 or 0xD0 <= kind <= 0xD7:
            offset += 1 if kind == 0xFF else 2
        elif 0xC0 <= kind <= 0xCF and kind not in _NO_SIZE_MARKERS:
            height, width = _unpack(stream, offset + 5, ">HH")
            return width, height
        else:
            offset += 2 + length
    raise ValueError("no start of frame")


def _webp_size(stream: BinaryIO) -> tuple[int, ...]:
    stream.seek(12)
    kind = stream.read(4)
    if kind == b"VP8 ":
        width, height = _unpack(stream, 26, "<HH")
        return width & 0x3FFF, height & 0x3FFF
    if kind == b"VP8L":
        (bits,) = _unpack(stream, 21, "<I")
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    low_width, high_width, low_height, high_height = _unpack(stream, 24, "<HBHB")
    return (high_width << 16 | low_width) + 1, (high_height << 16 | low_height) + 1


def _tiff_size(stream: BinaryIO) -> tuple[int, ...]:
    """The size of the first page."""
    order = "<" if stream.read(2) == b"II" else ">"
    (directory,) = _unpack(stream, 4, f"{order}I")
    (entries,) = _unpack(stream, directory, f"{order}H")
    size = [0, 0]
    for entry in range(min(entries, _MOST_SEGMENTS)):
        offset = directory + 2 + 12 * entry
        tag, kind = _unpack(stream, offset, f"{order}HH")
        if tag in (256, 257):
            (size[tag - 256],) = _unpack(stream, offset + 8, f"{order}{'H' if kind == 3 else 'I'}")
    return size[0], size[1]


def _pnm_size(stream: BinaryIO) -> tuple[int, ...]:
    words = re.sub(rb"#[^\n]*\n", b" ", stream.read(4096)).split(maxsplit=3)
    return int(words[1]), int(words[2])


_READERS: tuple[tuple[bytes, Callable[[BinaryIO], tuple[int, ...]]], ...] = (
    (rb"\x89PNG\r\n\x1a\n.{4}IHDR", _png_size),
    (rb"\xff\xd8\xff", _jpeg_size),
    (rb"BM.{12}", _bmp_size),
    (rb"RIFF.{4}WEBPVP8", _webp_size),
    (rb"II\*\x00|MM\x00\*", _tiff_size),
    (rb"P[1-6]\s", _pnm_size),
)
