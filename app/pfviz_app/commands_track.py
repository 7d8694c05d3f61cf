"""``pfviz track``: an object through a video, as CSV, as JSON Lines, as an annotated video, as a contact sheet."""

from __future__ import annotations

import argparse
import csv
import json
import math
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import fields
from pathlib import Path
from types import FrameType
from typing import Any, TextIO

import cv2
import numpy as np

from pfviz import kernels
from pfviz.filters import Filter, make_filter
from pfviz.vision.drawing import ContactSheet, VideoWriter, draw_track
from pfviz.vision.limits import display_name
from pfviz.vision.track import CSV_HEADER, TrackedFrame, track
from pfviz.vision.tracker import TrackerModel
from pfviz.vision.video import VideoError, VideoSource, end_note, open_source
from pfviz_app.outputs import check_outputs, replacing
from pfviz_app.progress import Progress
from pfviz_app.start_box import learn_object
from pfviz_app.video_options import assumptions_of, limits_of

Sink = Callable[[TrackedFrame], None]

_SHEETS = (".png", ".jpg", ".jpeg", ".webp")


def run_track(options: argparse.Namespace) -> None:
    """Run the command.

    Raises:
        ValueError: for whatever the user got wrong, and where the video breaks; the frames before are kept.
        SystemExit: with code 130, if it was interrupted; what was done until then is kept.
    """
    outputs = {"--csv": options.csv, "--output": options.output, "--contact-sheet": options.contact_sheet}
    check_outputs(outputs, options.force, options.source)
    kernels.warm_up()
    with ExitStack() as stack:
        source = stack.enter_context(open_source(options.source, limits_of(options), options.frame_rate))
        assumed = assumptions_of(options)
        frames = options.start_frame, options.learn_frame
        model = learn_object(source, options.box, options.polygon, *frames, assumed)
        model = model.with_noise(options.system, options.observation, options.proposal)
        interrupts = stack.enter_context(_interrupts())
        sinks = list(_sinks(stack, options, model, source))
        filter_ = assumed.looking(make_filter(options.filter, options.particles))
        count, trouble = _run(source, model, filter_, options, sinks, interrupts)
        if interrupts and not count:
            _say("interrupted before the first frame")
            raise KeyboardInterrupt
        note = end_note(source)
    names = ", ".join(display_name(name) for name in outputs.values() if name)
    kept = f"; they are kept in {names}" if names else ""
    if trouble:
        raise VideoError(f"{trouble}, after {count} frames{kept}")
    if interrupts:
        _say(f"interrupted after {count} frames{kept}")
        raise SystemExit(128 + interrupts[0])
    if note:
        _say(f"{display_name(options.source)} ended early, after {source.frame_count} frames: {note}")


def _run(
    source: VideoSource,
    model: TrackerModel,
    filter_: Filter,
    options: argparse.Namespace,
    sinks: list[Sink],
    interrupts: list[int],
) -> tuple[int, VideoError | None]:
    """Track until the video ends or breaks, or somebody interrupts.

    Returns:
        How many frames that were, and what was wrong with the video after them.

    Raises:
        VideoError: if there was not even one frame.
    """
    progress = Progress(lambda: source.frame_count and max(source.frame_count - options.start_frame, 0))
    count, trouble = 0, None
    try:
        for tracked in track(source, model, filter_, options.seed, options.start_frame):
            for sink in sinks:
                sink(tracked)
            count += 1
            progress.show(count)
            if interrupts:
                break
    except VideoError as error:
        if count == 0:
            raise
        trouble = error
    progress.close(count)
    return count, trouble


@contextmanager
def _interrupts() -> Iterator[list[int]]:
    """The signals that came so far. The first asks to end after the frame that is worked on; another one raises."""
    seen: list[int] = []

    def note(number: int, _: FrameType | None) -> None:
        if seen:
            raise KeyboardInterrupt
        seen.append(number)

    before: dict[int, Any] = {}
    with suppress(ValueError):  # not in the main thread: whoever is decides
        before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield seen
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _sinks(stack: ExitStack, options: argparse.Namespace, model: TrackerModel, source: VideoSource) -> Iterator[Sink]:
    """Where the frames go, as the options say; a table on stdout where they say nothing."""
    writer = sheet = None
    if options.csv:
        partial = stack.enter_context(replacing(Path(options.csv)))
        yield _csv_rows(stack.enter_context(partial.open("w", encoding="utf-8", newline="")))
    if options.output:
        writer = stack.enter_context(VideoWriter(options.output, source.size, source.frame_rate))
    if options.contact_sheet:
        sheet = stack.enter_context(_contact_sheet(Path(options.contact_sheet)))
    if writer or sheet:
        yield lambda tracked: _draw(tracked, model, writer, sheet)
    if options.json:
        yield lambda tracked: print(json.dumps(json_row(tracked), allow_nan=False), flush=True)
    elif not (options.csv or options.output or options.contact_sheet):
        yield _csv_rows(sys.stdout)


def _csv_rows(stream: TextIO) -> Sink:
    """Writes ``CSV_HEADER`` now and a row a frame."""
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(CSV_HEADER)
    return lambda tracked: writer.writerow([tracked.frame, *(f"{value:.6g}" for value in tracked.row[1:])])


def json_row(tracked: TrackedFrame) -> dict[str, Any]:
    """The columns of the CSV, whether the object is tracked or lost, and what else is known of the estimate.

    What is not a number is null.
    """
    row: dict[str, Any] = dict(zip(CSV_HEADER, tracked.row, strict=True))
    row |= {"state": tracked.status, "presence": tracked.presence.probability}
    for field in fields(tracked.estimate):
        if field.name not in ("x", "y", "rotation", "scale", "box"):
            row[field.name] = np.asarray(getattr(tracked.estimate, field.name)).tolist()
    return {key: None if isinstance(value, float) and not math.isfinite(value) else value for key, value in row.items()}


def _draw(tracked: TrackedFrame, model: TrackerModel, writer: VideoWriter | None, sheet: ContactSheet | None) -> None:
    """Draw a frame once for all that want it."""
    if sheet is not None and not sheet.wants_next:
        sheet.skip()
        sheet = None
    if writer is None and sheet is None:
        return
    drawn = draw_track(tracked.image, model, tracked.record, tracked.estimate)
    if writer is not None:
        writer.write(drawn)
    if sheet is not None:
        sheet.add(drawn, f"{tracked.frame}{'' if tracked.status == 'tracked' else '  lost'}")


@contextmanager
def _contact_sheet(path: Path) -> Iterator[ContactSheet]:
    """Written when the block is over, as the kind of image that the name ends in."""
    suffix = path.suffix.lower()
    if suffix not in _SHEETS:
        raise ValueError(
            f"--contact-sheet {display_name(path)}: expected the name of an image that ends in {', '.join(_SHEETS)}"
        )
    sheet = ContactSheet()
    yield sheet
    coded = cv2.imencode(suffix, sheet.picture())[1]
    with replacing(path) as partial:
        partial.write_bytes(coded.tobytes())


def _say(text: str) -> None:
    print(f"pfviz: {text}", file=sys.stderr)
