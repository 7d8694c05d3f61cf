"""Particle filters on video: sources, the contour tracker's model, and what it takes to run and draw it."""

from pfviz.vision.drawing import VideoWriter, draw_track
from pfviz.vision.track import CSV_HEADER, TrackedFrame, track, write_csv
from pfviz.vision.tracker import (
    DEFAULT_MODEL,
    MODELS,
    TrackerModel,
    TrackerOptions,
    TrackEstimate,
    learn_tracker,
)
from pfviz.vision.video import EndOfVideo, VideoError, VideoSource, frames, open_source, suggested_box

__all__ = [
    "CSV_HEADER",
    "DEFAULT_MODEL",
    "MODELS",
    "EndOfVideo",
    "TrackEstimate",
    "TrackedFrame",
    "TrackerModel",
    "TrackerOptions",
    "VideoError",
    "VideoSource",
    "VideoWriter",
    "draw_track",
    "frames",
    "learn_tracker",
    "open_source",
    "suggested_box",
    "track",
    "write_csv",
]
