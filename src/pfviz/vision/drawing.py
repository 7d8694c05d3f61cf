"""The tracker's answer drawn into the frame, after Figure 5 of the sources, and written as a video."""

from __future__ import annotations

import os
from pathlib import Path
from secrets import token_hex

import cv2
import numpy as np

from pfviz.particles import FloatArray
from pfviz.record import StepRecord
from pfviz.vision.limits import display_name
from pfviz.vision.tracker import TrackerModel, TrackEstimate
from pfviz.vision.video import Image, VideoError, silence_opencv

_WHITE, _BLACK = (255, 255, 255), (0, 0, 0)
_DARK, _PALE = (30, 26, 24), (176, 170, 166)
_SHIFT = 4
_FINE_HEIGHT = 720
_KEPT_PER_TILE = 8

CODECS = {".mp4": "mp4v", ".m4v": "mp4v", ".mov": "mp4v", ".mkv": "mp4v", ".avi": "MJPG"}
"""What is written under which ending."""


def draw_track(
    image: Image, model: TrackerModel, record: StepRecord, estimate: TrackEstimate, likely: int = 12
) -> Image:
    """A copy of the BGR ``image`` with contours of likely particles in black and the expected contour in
    white.

    Both have a thin rim of the opposite tone, so that they show on any background. They are drawn on an enlarged
    copy of the part of the frame that they reach, so that they are thin in small frames too.

    Args:
        image: the frame.
        model: whose outline is drawn.
        record: what the filter did with the frame.
        estimate: the configuration to draw in white.
        likely: how many of the particles to draw, the heaviest first.
    """
    fineness = max(1, round(_FINE_HEIGHT / image.shape[0]))
    line = max(1.0, fineness * image.shape[0] / 360.0)
    likely_outlines = model.contour.outlines(likely_states(record, likely))
    expected = model.contour.outlines(estimate.state)
    drawn = image.copy()
    rows, columns = _window(np.concatenate([likely_outlines, expected]), 4.0 * line / fineness + 2.0, image.shape)
    if rows.start >= rows.stop or columns.start >= columns.stop:
        return drawn
    part = image[rows, columns]
    canvas: Image = part.repeat(fineness, axis=0).repeat(fineness, axis=1)
    corner = np.array([columns.start, rows.start])
    likely_outlines, expected = (fineness * (outlines - corner) for outlines in (likely_outlines, expected))
    draw_closed(canvas, likely_outlines, _PALE, 1.8 * line)
    draw_closed(canvas, likely_outlines, _DARK, line)
    draw_closed(canvas, expected, _BLACK, 3.2 * line)
    draw_closed(canvas, expected, _WHITE, 1.7 * line)
    drawn[rows, columns] = cv2.resize(canvas, part.shape[1::-1], interpolation=cv2.INTER_AREA)
    return drawn


def _window(outlines: FloatArray, margin: float, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Rows and columns of the part of an image of ``shape`` that ``outlines (N, n, 2)`` reach."""
    points = outlines.reshape(-1, 2)
    low = np.clip(np.floor(points.min(axis=0) - margin), 0, (shape[1], shape[0])).astype(int)
    high = np.clip(np.ceil(points.max(axis=0) + margin), 0, (shape[1], shape[0])).astype(int)
    return slice(low[1], high[1]), slice(low[0], high[0])


def likely_states(record: StepRecord, count: int) -> FloatArray:
    """``(n, k)``, n at most ``count``: the heaviest different innovations as weighed, before any resampling."""
    weighed = record.stage("weight")
    particles = weighed.particles if weighed else record.posterior
    heaviest = np.argsort(-particles.log_weights, kind="stable")[: 4 * count]
    states, first = np.unique(particles.innovation[heaviest], axis=0, return_index=True)
    return states[np.argsort(first)][:count]


def draw_closed(canvas: Image, outlines: FloatArray, colour: tuple[int, int, int], width: float) -> None:
    """Draw closed polygons ``(N, n, 2)`` in frame pixels, ``width`` pixels wide."""
    limit = 8.0 * max(canvas.shape)
    fine = np.rint((np.clip(outlines, -limit, limit) - 0.5) * (1 << _SHIFT)).astype(np.int32)
    cv2.polylines(canvas, list(fine), True, colour, max(1, round(width)), cv2.LINE_AA, shift=_SHIFT)


class ContactSheet:
    """A grid of evenly spaced pictures of a run, whatever its length turns out to be.

    A picture is kept of every n-th frame; when there are too many of them every second one is dropped and n doubled.

    Args:
        tiles: how many pictures the sheet has at the most.
        width: of a picture in pixels; larger ones are made smaller.
    """

    def __init__(self, tiles: int = 12, width: int = 320) -> None:
        self._tiles, self._width = tiles, width
        self._stride, self._count = 1, 0
        self._kept: list[tuple[int, str, Image]] = []

    @property
    def wants_next(self) -> bool:
        """Whether the next picture would be kept; if not, ``skip`` it."""
        return self._count % self._stride == 0

    def skip(self) -> None:
        """Count a frame of which no picture is kept."""
        self._count += 1

    def add(self, image: Image, caption: str) -> None:
        """Count a frame and keep its picture."""
        height = round(image.shape[0] * min(self._width / image.shape[1], 1.0))
        width = min(self._width, image.shape[1])
        small = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
        self._kept.append((self._count, caption, np.asarray(small, dtype=np.uint8)))
        self._count += 1
        if len(self._kept) > _KEPT_PER_TILE * self._tiles:
            self._kept = self._kept[::2]
            self._stride *= 2

    def chosen(self) -> list[tuple[str, Image]]:
        """The evenly spaced pictures with their captions, from the first to the last kept."""
        if not self._kept:
            return []
        indices = np.array([index for index, _, _ in self._kept])
        wanted = np.linspace(0, indices[-1], min(self._tiles, len(indices)))
        nearest = [int(np.argmin(np.abs(indices - index))) for index in wanted]
        return [self._kept[i][1:] for i in nearest]

    def picture(self) -> Image:
        """The sheet as a BGR image.

        Raises:
            ValueError: if there are no pictures.
        """
        tiles = [_captioned(image, caption) for caption, image in self.chosen()]
        if not tiles:
            raise ValueError("a contact sheet needs at least one picture")
        columns = int(np.ceil(np.sqrt(len(tiles))))
        tiles += [np.full_like(tiles[0], 255)] * (-len(tiles) % columns)
        rows = [np.hstack(tiles[i : i + columns]) for i in range(0, len(tiles), columns)]
        return np.vstack(rows)


def _captioned(image: Image, caption: str) -> Image:
    """The image in a white frame, its caption below."""
    tile = cv2.copyMakeBorder(image, 4, 22, 4, 4, cv2.BORDER_CONSTANT, value=_WHITE)
    at = (5, tile.shape[0] - 7)
    cv2.putText(tile, caption, at, cv2.FONT_HERSHEY_SIMPLEX, 0.42, _DARK, 1, cv2.LINE_AA)
    return np.asarray(tile, dtype=np.uint8)


class VideoWriter:
    """Writes a video file frame by frame. The file appears under its name when it is complete, or not at all.

    Use it in a ``with`` block; when that ends with an exception the unfinished file is removed.

    Raises:
        VideoError: if the file cannot be written, or its name has none of the endings of ``CODECS``.
    """

    def __init__(self, path: str | os.PathLike[str], size: tuple[int, int], frame_rate: float) -> None:
        self._path = Path(path)
        shown, folder = display_name(path), self._path.parent
        if not folder.is_dir():
            raise VideoError(f"{shown}: there is no folder '{display_name(folder)}' to write to")
        if self._path.is_dir():
            raise VideoError(f"{shown}: is a folder, expected the name of a video file to write")
        if not os.access(folder, os.W_OK):
            raise VideoError(f"{shown}: the folder '{display_name(folder)}' cannot be written to")
        suffix = self._path.suffix.lower()
        if suffix not in CODECS:
            raise VideoError(f"{shown}: expected the name of a video that ends in {', '.join(CODECS)}")
        self._partial = folder / f".pfviz-{os.getpid()}-{token_hex(4)}.partial{suffix}"
        silence_opencv()
        codec = cv2.VideoWriter.fourcc(*CODECS[suffix])
        self._writer = cv2.VideoWriter(str(self._partial), cv2.CAP_FFMPEG, codec, frame_rate, size)
        if not self._writer.isOpened():
            self._partial.unlink(missing_ok=True)
            raise VideoError(f"{shown}: a video of {size[0]} x {size[1]} pixels cannot be written")

    def write(self, image: Image) -> None:
        """Add a BGR frame."""
        self._writer.write(image)

    def __enter__(self) -> VideoWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._writer.release()
        try:
            if kind is None:
                self._finish()
        finally:
            self._partial.unlink(missing_ok=True)

    def _finish(self) -> None:
        if not self._partial.exists() or self._partial.stat().st_size == 0:
            raise VideoError(f"{display_name(self._path)}: the video could not be written")
        os.replace(self._partial, self._path)
