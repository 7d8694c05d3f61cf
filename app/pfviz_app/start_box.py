"""Learning the object to track from a video and a box, the same for the command line and the app."""

from __future__ import annotations

from pfviz.vision.tracker import DEFAULT_MODEL, TrackerModel, learn_tracker
from pfviz.vision.video import Box, EndOfVideo, VideoError, VideoSource, suggested_box


def learn_from_start(
    source: VideoSource, box: Box | None, start_frame: int, model: str = DEFAULT_MODEL
) -> TrackerModel:
    """The tracker's model of what is in ``box`` in ``start_frame``; without a box, of what the source suggests.

    Raises:
        VideoError: if there is no such frame, or no box.
        ValueError: if the box does not fit the frame, or there is no such model.
    """
    try:
        image = source.read(start_frame)
    except EndOfVideo:
        raise VideoError(f"--start-frame {start_frame}: {source.name} has only {source.frame_count} frames") from None
    box = box or suggested_box(source, start_frame)
    if box is None:
        raise VideoError(f"--box is missing: where is the object in frame {start_frame} of {source.name}? Give x,y,w,h")
    return learn_tracker(image, box, frame_rate=source.frame_rate, model=model)
