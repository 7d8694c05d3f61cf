"""Learning the object to track from a video and a box or an outline, the same for the command line and the app."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import cast

from pfviz.dynamics import Autoregression
from pfviz.filters.registry import Filter
from pfviz.vision.motion import DEFAULT_DYNAMICS
from pfviz.vision.options import TrackerOptions
from pfviz.vision.presence import NOT_YET_FOUND
from pfviz.vision.restart import Restarting
from pfviz.vision.shapes import DEFAULT_SHAPE
from pfviz.vision.tracker import DEFAULT_MODEL, TrackerModel, learn_tracker
from pfviz.vision.video import Box, EndOfVideo, Image, VideoError, VideoSource, suggested_box

Polygon = Sequence[tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Assumptions:
    """What is assumed of any object that is followed.

    Attributes:
        model: what is measured of it, a key of ``MODELS``.
        shape: how its outline can change, a key of ``SHAPES``.
        dynamics: how it moves, a key of ``DYNAMICS``, where nothing was learnt.
        working_width: about how many pixels wide the image is that is measured.
        restart: whether it is looked for where it is lost.
        learnt_from: the file of positions that its motion was learnt from.
        learnt: what was learnt from it.
    """

    model: str = DEFAULT_MODEL
    shape: str = DEFAULT_SHAPE
    dynamics: str = DEFAULT_DYNAMICS
    working_width: int = TrackerOptions().working_width
    restart: bool = True
    learnt_from: str | None = None
    learnt: Autoregression | None = field(default=None, compare=False)

    def learn(
        self, image: Image, frame_rate: float, box: Box | None = None, polygon: Polygon | None = None
    ) -> TrackerModel:
        """The tracker's model of what is in ``box`` or ``polygon`` in a BGR image; see ``learn_tracker``."""
        return learn_tracker(
            image,
            box,
            polygon,
            frame_rate=frame_rate,
            model=self.model,
            options=TrackerOptions(working_width=self.working_width),
            shape=self.shape,
            dynamics=self.dynamics if self.learnt is None else self.learnt,
        )

    def looking(self, filter: Filter) -> Filter:
        """The filter as it is run on videos: it looks for an object that is lost, where it is to."""
        return cast(Filter, Restarting(filter) if self.restart else Restarting(filter, share=0.0))


USUAL = Assumptions()
"""What is assumed where nobody says otherwise."""


def learn_object(
    source: VideoSource,
    box: Box | None = None,
    polygon: Polygon | None = None,
    start_frame: int = 0,
    learn_frame: int | None = None,
    assumed: Assumptions = USUAL,
) -> TrackerModel:
    """The tracker's model of what is in ``box`` or ``polygon``; without either it is of what the source suggests.

    Args:
        source: the video.
        box: ``(x, y, width, height)`` in pixels.
        polygon: the outline's corners in pixels, instead of a box.
        start_frame: the first frame to be tracked in.
        learn_frame: the frame in which the box or polygon is, the start frame by default; where it is another one, the
            object may be anywhere at the start.
        assumed: of the object.

    Raises:
        VideoError: if there is no such frame, or no box; the message names the command line's options.
        ValueError: if the box or polygon does not fit the frame, or what is assumed is not known.
    """
    learn_frame = start_frame if learn_frame is None else learn_frame
    known = learn_frame == start_frame
    image = frame_of(source, start_frame, "--start-frame")
    if not known:
        image = frame_of(source, learn_frame, "--learn-frame")
    if polygon is not None:
        check_polygon(polygon, source.size)
    elif box is None:
        box = suggested_box(source, learn_frame)
        if box is None:
            where = f"where is the object in frame {learn_frame} of {source.name}?"
            raise VideoError(f"--box is missing: {where} Give x,y,w,h (or --polygon)")
    model = assumed.learn(image, source.frame_rate, box, polygon)
    return model if known else model.given(NOT_YET_FOUND)


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
