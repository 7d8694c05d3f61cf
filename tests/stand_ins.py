"""Stand-ins for what the app meets in the world: a small video whose truth is known, a screen, a command line."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from pfviz_app.cli import main
from pfviz_app.films import VideoSetup
from pfviz_app.picture import Pick, Picture
from pfviz_app.room import Run
from pfviz_app.session import Session
from pfviz_app.settings import Settings
from pfviz_app.shelf import Shelf

from pfviz.particles import FloatArray
from pfviz.vision.tracker import TrackerModel, learn_tracker
from pfviz.vision.video import EndOfVideo, Image, Truth, VideoError, silence_opencv

ROOT = Path(__file__).resolve().parents[1]
SIZE = (96, 72)
DISC_BOX = (12.0, 26.0, 20.0, 20.0)

silence_opencv()  # FFmpeg asks how much it may say only once, at its first video; here that may be one of the tests'


def centre(index: int) -> tuple[float, float]:
    """Where the disc is in frame ``index``."""
    return 22.0 + 1.5 * index, 36.0


@lru_cache(maxsize=64)
def disc_frame(index: int) -> Image:
    """A red disc that moves to the right on a grey ground with a few marks."""
    image = np.full((SIZE[1], SIZE[0], 3), 205, np.uint8)
    cv2.rectangle(image, (60, 6), (90, 20), (120, 140, 90), -1)
    cv2.line(image, (0, 66), (95, 60), (90, 90, 90), 2)
    x, y = centre(index)
    cv2.circle(image, (round(16 * x), round(16 * y)), 16 * 10, (40, 40, 200), -1, cv2.LINE_AA, shift=4)
    image.flags.writeable = False
    return image


@lru_cache(maxsize=1)
def disc_model() -> TrackerModel:
    """The tracker's model of the disc, learnt from frame 0."""
    return learn_tracker(disc_frame(0), DISC_BOX)


@dataclass
class DiscVideo:
    """The disc as a video source. Reading frame ``broken`` fails."""

    name: str = "disc"
    size: tuple[int, int] = SIZE
    frame_rate: float = 30.0
    frame_count: int | None = 30
    broken: int | None = None
    closed: int = 0
    reads: list[int] = field(default_factory=list)

    def read(self, index: int) -> Image:
        self.reads.append(index)
        if index == self.broken:
            raise VideoError("disc: the disc drive is on fire")
        if self.frame_count is not None and index >= self.frame_count:
            raise EndOfVideo(f"there is no frame {index}")
        return disc_frame(index)

    def truth(self, index: int) -> Truth | None:
        return (*centre(index), 0.0, 1.0)

    def close(self) -> None:
        self.closed += 1

    def __enter__(self) -> DiscVideo:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


DISC_OUTLINE = [(22 + 10 * np.cos(a), 36 + 10 * np.sin(a)) for a in np.linspace(0, 2 * np.pi, 12, endpoint=False)]


def write_positions(path: Path, columns: str = "frame,cx,cy") -> Path:
    """Where the disc is, a little off, as a CSV file of 60 frames."""
    rng = np.random.default_rng(0)
    rows = [f"{i},{centre(i)[0] + rng.normal(0, 0.3)},{36 + rng.normal(0, 0.3)}" for i in range(60)]
    path.write_text("\n".join([columns, *rows]) + "\n")
    return path


def disc_setup(open_video: Callable[[], DiscVideo] = DiscVideo, start_frame: int = 0) -> VideoSetup:
    return VideoSetup(open_video, disc_model(), start_frame, "Video: disc")


def write_disc_video(path: Path, frames: int = 12) -> Path:
    """The disc as an MP4 file."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 25.0, SIZE)
    for index in range(frames):
        writer.write(disc_frame(index))
    writer.release()
    return path


class Screen:
    """A view that remembers what it was told to draw. While ``open`` is not set, drawing waits.

    Particle x of the toy lies at pixel (x, y) for every y; left of it there is nothing. A pixel also stands for the
    same place in the toy's world, and in the frame where it is not negative.
    """

    def __init__(self) -> None:
        self.drawn: list[Picture] = []
        self.sizes: list[tuple[int, int]] = []
        self.open = threading.Event()
        self.open.set()
        self.fault: Exception | None = None
        self._changed = threading.Condition()

    def draw(self, picture: Picture) -> None:
        assert self.open.wait(60.0)
        fault, self.fault = self.fault, None
        if fault is not None:
            raise fault
        with self._changed:
            self.drawn.append(picture)
            self._marked = self.sizes[-1] if self.sizes else None
            self._changed.notify_all()

    def resize(self, width: int, height: int) -> None:
        self.sizes.append((width, height))

    def pick(self, x: float, y: float) -> Pick | None:
        return Pick("toy", int(x)) if x >= 0 else None

    def toy_place(self, x: float, y: float) -> FloatArray | None:
        return np.array([x])

    def frame_place(self, x: float, y: float) -> tuple[float, float] | None:
        return (x, y) if min(x, y) >= 0 else None

    def wait_for(self, condition: Callable[[Picture], bool], timeout: float = 60.0) -> Picture:
        """The first picture drawn from now on, or the last one, for which ``condition`` holds."""
        with self._changed:
            assert self._changed.wait_for(lambda: bool(self.drawn) and condition(self.drawn[-1]), timeout)
            return self.drawn[-1]

    def wait_for_size(self, size: tuple[int, int], timeout: float = 60.0) -> Picture:
        """The first picture drawn after being resized to ``size``."""
        self.wait_for(lambda _: self._marked == size, timeout)
        return self.drawn[-1]


class Visit:
    """A session on a stand-in screen; ``do`` returns when its commands have been carried out and drawn."""

    def __init__(self, settings: Settings, video: VideoSetup | None = None, runs: Shelf[Run] | None = None) -> None:
        self.screen = Screen()
        self.session = Session(settings, video or disc_setup(), self.screen, runs)
        self._marks = itertools.count(1)
        self.session.start()

    def do(self, *commands) -> Picture:
        for command in commands:
            self.session.post(command)
        return self.settled()

    def settled(self) -> Picture:
        from pfviz_app.commands import Resize

        mark = (next(self._marks), 1)
        self.session.post(Resize(*mark))
        return self.screen.wait_for_size(mark)

    def __enter__(self) -> Visit:
        return self

    def __exit__(self, *exception: object) -> None:
        self.screen.open.set()
        self.session.close()


@dataclass(frozen=True)
class Outcome:
    """What a command line did."""

    code: int
    out: str
    err: str


def run_here(capfd: pytest.CaptureFixture[str], *words: object) -> Outcome:
    """``pfviz words...`` in this process."""
    capfd.readouterr()
    code = 0
    try:
        main([str(word) for word in words])
    except SystemExit as exit_:
        code = exit_.code if isinstance(exit_.code, int) else 1
    captured = capfd.readouterr()
    return Outcome(code, captured.out, captured.err)


def environment() -> dict[str, str]:
    """Of a process that finds this checkout first, wherever it runs."""
    paths = [str(ROOT / "src"), str(ROOT / "app"), os.environ.get("PYTHONPATH", "")]
    return os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths)), "PYTHONUNBUFFERED": "1"}


def run_there(*words: object, cwd: Path | None = None) -> Outcome:
    """``python -m pfviz_app words...`` in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-m", "pfviz_app", *map(str, words)],
        capture_output=True,
        text=True,
        encoding="utf-8",
        env=environment(),
        cwd=cwd,
        timeout=300,
        check=False,
    )
    return Outcome(done.returncode, done.stdout, done.stderr)


def message_of(outcome: Outcome) -> str:
    """The text of the one-line error that ``outcome`` must be."""
    assert outcome.code == 2, outcome
    assert outcome.out == "", outcome
    assert outcome.err.endswith("\n") and outcome.err.count("\n") == 1, outcome
    prefix = "pfviz: error: "
    assert outcome.err.startswith(prefix), outcome
    return outcome.err.removeprefix(prefix).strip()


def listing(folder: Path) -> Sequence[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))
