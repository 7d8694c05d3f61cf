"""The tracker's answer drawn into the frame, after Figure 5 of the sources, and written as a video."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np

from pfviz.particles import FloatArray
from pfviz.record import StepRecord
from pfviz.vision.tracker import TrackerModel, TrackEstimate
from pfviz.vision.video import Image, VideoError, silence_opencv

_WHITE, _BLACK = (255, 255, 255), (0, 0, 0)
_DARK, _PALE = (30, 26, 24), (176, 170, 166)
_SHIFT = 4
_FINE_HEIGHT = 720


def draw_track(
    image: Image, model: TrackerModel, record: StepRecord, estimate: TrackEstimate, likely: int = 12
) -> Image:
    """A copy of the BGR ``image`` with contours of likely particles in black and the expected contour in
    white.

    Both have a thin rim of the opposite tone, so that they show on any background. They are drawn on an enlarged
    copy, so that they are thin in small frames too.

    Args:
        image: the frame.
        model: whose outline is drawn.
        record: what the filter did with the frame.
        estimate: the configuration to draw in white.
        likely: how many of the particles to draw, the heaviest first.
    """
    fineness = max(1, round(_FINE_HEIGHT / image.shape[0]))
    canvas: Image = image.repeat(fineness, axis=0).repeat(fineness, axis=1)
    line = max(1.0, fineness * image.shape[0] / 360.0)
    states = likely_states(record, likely)
    likely_outlines = fineness * model.contour.outlines(states)
    expected = fineness * model.contour.outlines(estimate.state)
    draw_closed(canvas, likely_outlines, _PALE, 1.8 * line)
    draw_closed(canvas, likely_outlines, _DARK, line)
    draw_closed(canvas, expected, _BLACK, 3.2 * line)
    draw_closed(canvas, expected, _WHITE, 1.7 * line)
    drawn = cv2.resize(canvas, image.shape[1::-1], interpolation=cv2.INTER_AREA)
    return np.asarray(drawn, dtype=np.uint8)


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


class VideoWriter:
    """Writes an MP4 file frame by frame. The file appears under its name when it is complete, or not at all.

    Use it in a ``with`` block; when that ends with an exception the unfinished file is removed.

    Raises:
        VideoError: if the file cannot be written.
    """

    def __init__(self, path: str | os.PathLike[str], size: tuple[int, int], frame_rate: float) -> None:
        self._path = Path(path)
        self._partial = self._path.with_name(f".{self._path.stem}.{os.getpid()}.partial.mp4")
        if not self._path.parent.is_dir():
            raise VideoError(f"{self._path}: there is no folder '{self._path.parent}' to write to")
        if self._path.is_dir():
            raise VideoError(f"{self._path}: is a folder, expected the name of a video file to write")
        if not os.access(self._path.parent, os.W_OK):
            raise VideoError(f"{self._path}: the folder '{self._path.parent}' cannot be written to")
        silence_opencv()
        codec = cv2.VideoWriter.fourcc(*"mp4v")
        self._writer = cv2.VideoWriter(str(self._partial), cv2.CAP_FFMPEG, codec, frame_rate, size)
        if not self._writer.isOpened():
            self._partial.unlink(missing_ok=True)
            raise VideoError(f"{self._path}: a video of {size[0]} x {size[1]} pixels cannot be written")

    def write(self, image: Image) -> None:
        """Add a BGR frame."""
        self._writer.write(image)

    def __enter__(self) -> VideoWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._writer.release()
        if kind is None:
            os.replace(self._partial, self._path)
        else:
            self._partial.unlink(missing_ok=True)
