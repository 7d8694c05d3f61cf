"""The video that a server shows, and what is followed in it."""

from __future__ import annotations

import argparse
from functools import partial

from pfviz.vision.limits import Limits
from pfviz.vision.shared import SharedVideo
from pfviz.vision.video import Box, open_source, suggested_box
from pfviz_app.films import Start, VideoSetup
from pfviz_app.start_box import USUAL, Assumptions, Polygon, learn_object
from pfviz_app.video_options import assumptions_of, limits_of


def video_of(options: argparse.Namespace) -> VideoSetup:
    """What the options of ``pfviz serve`` ask for.

    Raises:
        ValueError: as ``prepare_video``, and if the motion cannot be learnt.
    """
    return prepare_video(
        options.video,
        options.box,
        options.start_frame,
        polygon=options.polygon,
        learn_frame=options.learn_frame,
        assumed=assumptions_of(options),
        limits=limits_of(options),
        frame_rate=options.frame_rate,
    )


def prepare_video(
    source: str,
    box: Box | None,
    start_frame: int,
    *,
    polygon: Polygon | None = None,
    learn_frame: int | None = None,
    assumed: Assumptions = USUAL,
    limits: Limits | None = None,
    frame_rate: float | None = None,
) -> VideoSetup:
    """Open the video once, learn the object in it, and keep what visitors need.

    Args:
        source: as ``open_source`` takes it, and so ``limits`` and ``frame_rate``.
        box: as ``learn_object`` takes it, and so ``start_frame``, ``polygon``, ``learn_frame`` and ``assumed``.

    Raises:
        ValueError: if the video cannot be read, has no such frame, or the box is missing or outside the frame.
    """
    opened = partial(open_source, source, limits, frame_rate)
    learn_frame = start_frame if learn_frame is None else learn_frame
    with opened() as video:
        model = learn_object(video, box, polygon, start_frame, learn_frame, assumed)
        title = f"Video: {video.name}"
        if box is None and polygon is None and learn_frame != start_frame:
            box = suggested_box(video, learn_frame)
    outline = polygon if box is None else ((box[0], box[1]), (box[0] + box[2], box[1] + box[3]))
    start = None if outline is None else Start(learn_frame, tuple(outline))
    shared = SharedVideo(opened)
    return VideoSetup(shared.open, model, start_frame, title, source, start, assumed, limits or Limits(), frame_rate)
