"""``pfviz track``: an object through a video, as CSV, as JSON Lines, as an annotated video."""

from __future__ import annotations

import argparse
import csv
import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TextIO

from pfviz import kernels
from pfviz.filters import make_filter
from pfviz.vision.drawing import VideoWriter, draw_track
from pfviz.vision.track import CSV_HEADER, TrackedFrame, track
from pfviz.vision.tracker import DEFAULT_MODEL, TrackerModel
from pfviz.vision.video import VideoSource, open_source
from pfviz_app.start_box import learn_from_start

Sink = Callable[[TrackedFrame], None]


def run_track(options: argparse.Namespace) -> None:
    """Run the command."""
    kernels.warm_up()
    with ExitStack() as stack:
        source = stack.enter_context(open_source(options.source))
        model = learn_from_start(source, options.box, options.start_frame, options.model or DEFAULT_MODEL)
        sinks = list(_sinks(stack, options, model, source))
        progress = _Progress(source, options.start_frame)
        count = 0
        for tracked in track(source, model, _filter(options), options.seed, options.start_frame):
            for sink in sinks:
                sink(tracked)
            count += 1
            progress.show(count)
        progress.close(count)


def _filter(options: argparse.Namespace):
    return make_filter(options.filter, options.particles)


def _sinks(stack: ExitStack, options: argparse.Namespace, model: TrackerModel, source: VideoSource) -> Iterator[Sink]:
    """Where the frames go, as the options say; a table on stdout where they say nothing."""
    if options.csv:
        yield _csv_rows(stack.enter_context(_replacing(Path(options.csv))))
    if options.output:
        writer = stack.enter_context(VideoWriter(options.output, source.size, source.frame_rate))
        yield lambda tracked: writer.write(draw_track(tracked.image, model, tracked.record, tracked.estimate))
    if options.json:
        yield lambda tracked: print(json.dumps(dict(zip(CSV_HEADER, tracked.row, strict=True))))
    elif not (options.csv or options.output):
        yield _csv_rows(sys.stdout)


def _csv_rows(stream: TextIO) -> Sink:
    """Writes ``CSV_HEADER`` now and a row a frame."""
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(CSV_HEADER)
    return lambda tracked: writer.writerow([tracked.frame, *(f"{value:.6g}" for value in tracked.row[1:])])


@contextmanager
def _replacing(path: Path) -> Iterator[TextIO]:
    """A text file that appears under its name when it is complete, or not at all."""
    if path.is_dir():
        raise ValueError(f"{path}: is a folder, expected the name of a CSV file to write")
    if not path.parent.is_dir():
        raise ValueError(f"{path}: there is no folder '{path.parent}' to write to")
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        with partial.open("w", encoding="utf-8", newline="") as stream:
            yield stream
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


class _Progress:
    """A progress bar on stderr, where that is a terminal."""

    def __init__(self, source: VideoSource, start_frame: int) -> None:
        self._source, self._start = source, start_frame
        self._began = time.monotonic()
        self._shown = 0.0
        self._on = sys.stderr.isatty()

    def show(self, count: int) -> None:
        now = time.monotonic()
        if not self._on or now - self._shown < 0.2:
            return
        self._shown = now
        rate = count / max(now - self._began, 1e-9)
        total = self._source.frame_count
        if total is None:
            text = f"{count} frames"
        else:
            share = min(count / max(total - self._start, 1), 1.0)
            bar = "█" * round(24 * share)
            text = f"{bar:░<24} {count} of {total - self._start} frames"
        print(f"\r{text}  {rate:.0f} frames/s   ", end="", file=sys.stderr, flush=True)

    def close(self, count: int) -> None:
        if self._on:
            seconds = time.monotonic() - self._began
            print(f"\r{count} frames in {seconds:.1f} s{' ' * 40}", file=sys.stderr)
