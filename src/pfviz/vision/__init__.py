"""Particle filters on video: sources, the contour tracker's model, and what it takes to run and draw it."""

from pfviz.vision.drawing import VideoWriter, draw_track
from pfviz.vision.limits import Limits, display_name
from pfviz.vision.motion import DEFAULT_DYNAMICS, DYNAMICS
from pfviz.vision.presence import AT_START, NOT_YET_FOUND, Presence, PresenceRule
from pfviz.vision.restart import Restarting
from pfviz.vision.shapes import DEFAULT_SHAPE, SHAPES
from pfviz.vision.shared import SharedVideo
from pfviz.vision.track import CSV_HEADER, TrackedFrame, track, write_csv
from pfviz.vision.tracker import (
    DEFAULT_MODEL,
    MODELS,
    TrackerModel,
    TrackerOptions,
    TrackEstimate,
    learn_tracker,
)
from pfviz.vision.video import (
    EndOfVideo,
    VideoError,
    VideoSource,
    end_note,
    frames,
    open_source,
    open_upload,
    suggested_box,
)

__all__ = [
    "AT_START",
    "CSV_HEADER",
    "DEFAULT_DYNAMICS",
    "DEFAULT_MODEL",
    "DEFAULT_SHAPE",
    "DYNAMICS",
    "MODELS",
    "NOT_YET_FOUND",
    "SHAPES",
    "EndOfVideo",
    "Limits",
    "Presence",
    "PresenceRule",
    "Restarting",
    "SharedVideo",
    "TrackEstimate",
    "TrackedFrame",
    "TrackerModel",
    "TrackerOptions",
    "VideoError",
    "VideoSource",
    "VideoWriter",
    "display_name",
    "draw_track",
    "end_note",
    "frames",
    "learn_tracker",
    "open_source",
    "open_upload",
    "suggested_box",
    "track",
    "write_csv",
]
