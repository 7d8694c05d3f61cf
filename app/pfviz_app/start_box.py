"""Learning the object to track from a video and a box or an outline, the same for the command line and the app."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pfviz.vision.tracker import DEFAULT_MODEL, TrackerModel, learn_tracker
from pfviz.vision.video import Box, EndOfVideo, Image, VideoError, VideoSource, suggested_box

Polygon = Sequence[tuple[float, float]]


def learn_from_start(
    source: VideoSource,
    box: Box | None,
    start_frame: int,
    model: str = DEFAULT_MODEL,
    polygon: Polygon | None = None,
    option: str = "--start-frame",
    **assumed: Any,
) -> TrackerModel:
    """The tracker's model of what is in ``box`` or ``polygon`` in ``start_frame``.

    Without either it is of what the source suggests.

    Args:
        source: the video.
        box: ``(x, y, width, height)`` in pixels.
        start_frame: the frame in which the box or polygon is.
        model: the measurement.
        polygon: the outline's corners in pixels, instead of a box.
        option: what the user calls ``start_frame``.
        assumed: what else ``learn_tracker`` takes: ``options``, ``shape``, ``dynamics``.

    Raises:
        VideoError: if there is no such frame, or no box.
        ValueError: if the box or polygon does not fit the frame, or there is no such model.
    """
    image = frame_of(source, start_frame, option)
    if polygon is not None:
        check_polygon(polygon, source.size)
    elif box is None:
        box = suggested_box(source, start_frame)
        if box is None:
            where = f"where is the object in frame {start_frame} of {source.name}?"
            raise VideoError(f"--box is missing: {where} Give x,y,w,h (or --polygon)")
    return learn_tracker(image, box, polygon, frame_rate=source.frame_rate, model=model, **assumed)


def frame_of(source: VideoSource, index: int, option: str) -> Image:
    """Frame ``index``, which the user asks for by ``option``.

    Raises:
        VideoError: if there is no such frame; the message names the option.
    """
    try:
        return source.read(index)
    except EndOfVideo:
        raise VideoError(f"{option} {index}: {source.name} has only {source.frame_count} frames") from None


def check_polygon(polygon: Polygon, size: tuple[int, int]) -> None:
    """Refuse an outline that has its centre outside the frame of ``size`` (width, height), or is larger than it.

    Raises:
        ValueError: naming the outline.
    """
    xs, ys = zip(*polygon, strict=True)
    x, y, w, h = min(xs), min(ys), max(xs) - min(xs), max(ys) - min(ys)
    frame = f"the frame of {size[0]} x {size[1]} pixels"
    shown = f"polygon of {len(polygon)} points from {x:g},{y:g} to {x + w:g},{y + h:g}"
    if w < 4 or h < 4:
        raise ValueError(f"{shown}: too small to hold an object, at least 4 x 4 pixels are needed (in {frame})")
    if not (0 <= x + w / 2 <= size[0] and 0 <= y + h / 2 <= size[1]):
        raise ValueError(f"{shown}: its centre lies outside {frame}")
    if w > 1.5 * size[0] or h > 1.5 * size[1]:
        raise ValueError(f"{shown}: larger than {frame}")
