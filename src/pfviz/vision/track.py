"""Following an object through a video."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from time import perf_counter
from typing import TextIO

from pfviz.filters.registry import Filter
from pfviz.randomness import step_rng
from pfviz.record import StepRecord
from pfviz.vision.presence import AT_START, NOT_YET_FOUND, Presence, Status
from pfviz.vision.tracker import TrackerModel, TrackEstimate
from pfviz.vision.video import Image, VideoSource, frames

CSV_HEADER = (
    "frame",
    "x",
    "y",
    "rotation",
    "scale",
    "box_x",
    "box_y",
    "box_w",
    "box_h",
    "ess",
    "milliseconds",
)


@dataclass(frozen=True, slots=True)
class TrackedFrame:
    """One frame of a run.

    Attributes:
        frame: its index in the video.
        image: the frame itself, BGR.
        record: what the filter did.
        estimate: where the object is.
        milliseconds: what the frame took, without reading it.
        presence: whether the object is there at all.
    """

    frame: int
    image: Image
    record: StepRecord
    estimate: TrackEstimate
    milliseconds: float
    presence: Presence = AT_START

    @property
    def status(self) -> Status:
        """ "tracked" or "lost"."""
        return self.presence.status

    @property
    def row(self) -> tuple[float, ...]:
        """The values of ``CSV_HEADER``."""
        e = self.estimate
        return (
            self.frame,
            e.x,
            e.y,
            e.rotation,
            e.scale,
            *e.box,
            self.record.effective_sample_size,
            self.milliseconds,
        )


def track(
    source: VideoSource, model: TrackerModel, filter: Filter, seed: int = 0, start_frame: int = 0
) -> Iterator[TrackedFrame]:
    """Run ``filter`` over ``source`` from ``start_frame`` (time 1) to its end.

    The prior is that of the frame before, so the start frame is the first to be predicted and weighed. The
    step at time t draws from ``step_rng(seed, t)`` and is that of ``model.given`` the presence before it, so that any
    step can be replayed.

    Args:
        source: the video.
        model: of the object. Where the run begins before the object has come into view, or where it is not known,
            pass ``model.given(NOT_YET_FOUND)``.
        filter: what runs. Pass ``Restarting(filter)`` to look for the object whenever it is lost.
        seed: of the run.
        start_frame: the first frame.
    """
    presence = NOT_YET_FOUND if model.searching else AT_START
    particles = filter.initial(step_rng(seed, 0), model)
    for t, (index, image) in enumerate(frames(source, start_frame), start=1):
        began = perf_counter()
        record = filter.step(step_rng(seed, t), model.given(presence), particles, model.observe(image))
        estimate = model.estimate(record)
        presence = model.presence(presence, record, estimate)
        elapsed = 1000.0 * (perf_counter() - began)
        particles = record.posterior
        yield TrackedFrame(index, image, record, estimate, elapsed, presence)


def write_csv(stream: TextIO, tracked: Iterable[TrackedFrame]) -> int:
    """Write one row a frame under ``CSV_HEADER``, as the frames come; how many rows there were."""
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(CSV_HEADER)
    rows = 0
    for item in tracked:
        writer.writerow([item.frame, *(f"{value:.6g}" for value in item.row[1:])])
        rows += 1
    return rows
