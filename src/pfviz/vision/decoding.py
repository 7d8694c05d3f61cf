"""Files as sources of frames, decoded ahead in a process of their own (``pfviz.vision.decoder``)."""

from __future__ import annotations

import json
import os
import stat
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Sequence
from concurrent.futures import Future
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import IO, Any, Self, TypeVar

import numpy as np

from pfviz.vision import decoder
from pfviz.vision.images import common_size
from pfviz.vision.limits import Limits, display_name
from pfviz.vision.video import DEFAULT_FRAME_RATE, EndOfVideo, FrameCache, Image, Truth, VideoError

T = TypeVar("T")

_AHEAD = 4
_AHEAD_BYTES = 48 * 2**20
_LONGEST_LINE = 10_000
_ENVIRONMENT = {
    "OPENCV_FFMPEG_CAPTURE_OPTIONS": f"protocol_whitelist;file|format_whitelist;{decoder.DEMUXERS}",
    "OPENCV_FFMPEG_LOGLEVEL": "-8",
    "OPENBLAS_NUM_THREADS": "1",
    "MALLOC_ARENA_MAX": "2",
}


class DecoderProcess:
    """The decoder, seen from here. Any thread may ask for frames; one thread takes the answers.

    Attributes:
        opened: what the decoder says of the file, when it has opened it.
    """

    def __init__(self, task: dict[str, Any], limits: Limits, shown: str, cache: FrameCache) -> None:
        self._limits, self._shown, self._cache = limits, shown, cache
        self._lock = threading.Lock()
        self._coming: dict[int, Future[Image]] = {}
        self._failure: str | None = None
        self._late = self._closed = False
        self._sign = time.monotonic()
        self.opened: Future[dict[str, Any]] = Future()
        self.end: tuple[int, str | None] | None = None
        self._process = _start(limits, shown)
        assert self._process.stdin is not None and self._process.stdout is not None
        self._requests, self._answers = self._process.stdin, self._process.stdout
        self._thread = threading.Thread(target=self._receive, name="pfviz-frames", daemon=True)
        self._thread.start()
        self._send(task)

    @property
    def failed(self) -> bool:
        """Whether the process has ended."""
        return self._failure is not None

    def ask(self, index: int) -> Future[Image]:
        """The frame ``index`` that will come.

        Raises:
            VideoError: if the decoder has failed.
        """
        with self._lock:
            if self._failure is not None:
                raise VideoError(self._failure)
            if index in self._coming:
                return self._coming[index]
            if not self._coming:
                self._sign = time.monotonic()
            future = self._coming[index] = Future()
            self._send({"read": index})
        return future

    def wait_for(self, future: Future[T]) -> T:
        """The future's result; if there is no sign of life for too long, the decoder is ended.

        Raises:
            EndOfVideo: if there is no such frame.
            VideoError: if the decoder fails.
        """
        while True:
            patience = self._limits.patience - (time.monotonic() - self._sign)
            try:
                return future.result(max(patience, 0.05))
            except TimeoutError:
                if time.monotonic() - self._sign > self._limits.patience:
                    self._late = True
                    self._process.kill()

    def close(self) -> None:
        """End the process and wait until it is gone. Whoever still waits for a frame gets an error."""
        self._closed = True
        self._process.kill()
        self._process.wait()
        with suppress(OSError):
            self._requests.close()
        if threading.current_thread() is not self._thread:
            self._thread.join()

    def _send(self, request: dict[str, Any]) -> None:
        with suppress(OSError, ValueError):  # it has ended, which the receiving thread finds out too
            self._requests.write(json.dumps(request).encode() + b"\n")
            self._requests.flush()

    def _receive(self) -> None:
        """Take answers until there are no more, then let nobody wait in vain."""
        try:
            for line in iter(partial(self._answers.readline, _LONGEST_LINE), b""):
                self._sign = time.monotonic()
                self._take(json.loads(line))
            trouble = self._last_words()
        except Exception:  # whatever a decoder that was taken over may send
            trouble = self._last_words() if self._late else "the decoder cannot be understood"
        self._process.kill()
        self._answers.close()
        self._fail(f"{self._shown}: {trouble}")

    def _take(self, answer: dict[str, Any]) -> None:
        if "frame" in answer:
            index = int(answer["frame"])
            image = _received(self._answers, answer["shape"], self._limits.max_pixels)
            self._cache.put(index, image)
            self._arrived(index).set_result(image)
        elif "opened" in answer:
            self.opened.set_result(answer)
        elif "end" in answer:
            note = answer["note"]
            self.end = int(answer["count"]), None if note is None else display_name(note)
            self._arrived(int(answer["end"])).set_exception(EndOfVideo(end_of(self._shown, *self.end)))
        elif "fail" in answer:
            self._fail(f"{self._shown}: {display_name(str(answer['fail']))}")

    def _arrived(self, index: int) -> Future[Image]:
        with self._lock:
            return self._coming.pop(index)

    def _last_words(self) -> str:
        """Why the process ended."""
        code = self._process.wait()
        if self._closed:
            return "is closed"
        if self._late:
            return f"gave no frame within {self._limits.patience:g} seconds (patience)"
        return f"the decoder crashed on it ({f'signal {-code}' if code < 0 else f'code {code}'})"

    def _fail(self, failure: str) -> None:
        with self._lock:
            self._failure = self._failure or failure
            waiting = [*self._coming.values(), self.opened]
            self._coming.clear()
        for future in waiting:
            if not future.done():
                future.set_exception(VideoError(self._failure))


def _start(limits: Limits, shown: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-P", decoder.__file__]
    pipe, nowhere = subprocess.PIPE, subprocess.DEVNULL
    environment = os.environ | _ENVIRONMENT | {"OPENCV_IO_MAX_IMAGE_PIXELS": str(limits.max_pixels)}
    try:
        return subprocess.Popen(
            command, stdin=pipe, stdout=pipe, stderr=nowhere, env=environment, start_new_session=True
        )
    except OSError as error:
        raise VideoError(f"{shown}: the decoder cannot be started ({error.strerror})") from None


def _received(stream: IO[bytes], shape: Sequence[int], max_pixels: int) -> Image:
    height, width = (int(length) for length in shape)
    if not (height > 0 and width > 0 and height * width <= max_pixels):
        raise ValueError(f"a frame of {width} x {height} pixels")
    image = np.empty((height, width, 3), np.uint8)
    rest = image.data.cast("B")
    while rest:
        got = stream.readinto(rest)  # pyright: ignore[reportAttributeAccessIssue]
        if not got:
            raise ValueError("a frame that breaks off")
        rest = rest[got:]
    return image


def end_of(shown: str, count: int, note: str | None) -> str:
    """That a video is over, and why if that was too early."""
    return f"{shown}: ends early after {count} frames, {note}" if note else f"{shown}: ends after {count} frames"


class GuardedVideo:
    """Something that frames are decoded from, in another process and ahead. Threads may share it.

    Where reading goes on frame by frame, the next few are asked for before they are needed. Recent frames are kept.

    Raises:
        VideoError: if it cannot be decoded.
    """

    def __init__(
        self,
        shown: str,
        task: dict[str, Any],
        limits: Limits,
        frame_rate: float | None = None,
        cache_bytes: int | None = None,
    ) -> None:
        self.name = os.path.basename(shown.rstrip("/" + os.sep)) or shown
        self._limits = limits
        self._cut = False
        self._cache = FrameCache(cache_bytes)
        task = task | {"max_pixels": limits.max_pixels, "max_memory": limits.max_memory, "patience": limits.patience}
        self._decoder = DecoderProcess(task, limits, shown, self._cache)
        self._finalizer = weakref.finalize(self, self._decoder.close)
        try:
            opened = self._decoder.wait_for(self._decoder.opened)
        except BaseException:
            self.close()
            raise
        width, height = opened["opened"]
        self.size: tuple[int, int] = (int(width), int(height))
        self.frame_rate: float = float(frame_rate or opened["rate"] or DEFAULT_FRAME_RATE)
        self._announced: int | None = opened["count"]
        self._ahead = int(np.clip(_AHEAD_BYTES // (3 * width * height), 1, _AHEAD))

    @property
    def frame_count(self) -> int | None:
        if self._decoder.end is not None:
            return self._decoder.end[0]
        return None if self._announced is None else min(self._announced, self._limits.max_frames)

    @property
    def failed(self) -> bool:
        """Whether the decoder has ended and no more frames come."""
        return self._decoder.failed

    @property
    def end_note(self) -> str | None:
        """Why the video ended too early, once that is known; None if it did not."""
        if self._cut:
            return f"no more than {self._limits.max_frames} frames are used (max_frames)"
        return self._decoder.end[1] if self._decoder.end else None

    def read(self, index: int) -> Image:
        self._check(index)
        coming = self._soon(index)
        if index == 0 or index - 1 in self._cache:
            self._ask_ahead(index)
        return self._decoder.wait_for(coming)

    def truth(self, index: int) -> Truth | None:
        return None

    def close(self) -> None:
        self._finalizer()
        self._cache.clear()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _soon(self, index: int) -> Future[Image]:
        """The frame, kept or asked for."""
        image = self._cache.get(index)
        if image is None:
            return self._decoder.ask(index)
        kept: Future[Image] = Future()
        kept.set_result(image)
        return kept

    def _check(self, index: int) -> None:
        if index < 0:
            raise EndOfVideo(f"{self.name}: there is no frame {index}")
        if self._decoder.end is not None and index >= self._decoder.end[0]:
            raise EndOfVideo(end_of(self.name, *self._decoder.end))
        if index >= self._limits.max_frames:
            self._cut = True
            raise EndOfVideo(end_of(self.name, self._limits.max_frames, self.end_note))

    def _ask_ahead(self, index: int) -> None:
        """Ask for the next few frames, without waiting for them."""
        last = min(index + self._ahead, (self.frame_count or self._limits.max_frames) - 1)
        with suppress(VideoError):  # whoever needs one of them will hear of it
            for following in range(index + 1, last + 1):
                if following not in self._cache:
                    self._decoder.ask(following)


def open_video(path: Path, limits: Limits | None = None, cache_bytes: int | None = None) -> GuardedVideo:
    """A video file.

    Raises:
        VideoError: if it is missing, not a regular file, empty, too large, or not a video that can be decoded.
    """
    limits = limits or Limits()
    shown = display_name(path)
    check_file(path, limits)
    return GuardedVideo(shown, {"video": str(path.absolute())}, limits, None, cache_bytes)


def open_images(
    shown: str,
    paths: Sequence[Path],
    limits: Limits | None = None,
    frame_rate: float | None = None,
    cache_bytes: int | None = None,
) -> GuardedVideo:
    """Image files, one a frame, called ``shown``.

    Raises:
        VideoError: if one of them is no image, is too large or of another size than the first.
    """
    limits = limits or Limits()
    common_size(paths[: limits.max_frames], limits)
    task = {"images": [str(path.absolute()) for path in paths]}
    return GuardedVideo(shown, task, limits, frame_rate, cache_bytes)


def check_file(path: Path, limits: Limits) -> None:
    """Refuse what need not be opened to see that it is not a video.

    Raises:
        VideoError: see ``open_video``.
    """
    shown = display_name(path)
    try:
        status = path.stat()
    except (OSError, ValueError):
        raise VideoError(f"{shown}: no such file") from None
    if stat.S_ISDIR(status.st_mode):
        raise VideoError(f"{shown}: is a folder, not a video file")
    if not stat.S_ISREG(status.st_mode):
        raise VideoError(f"{shown}: is not a regular file (a camera is named camera:N)")
    if status.st_size == 0:
        raise VideoError(f"{shown}: the file is empty")
    if status.st_size > limits.max_bytes:
        raise VideoError(f"{shown}: {status.st_size} bytes are too many (max_bytes is {limits.max_bytes})")
    if not os.access(path, os.R_OK):
        raise VideoError(f"{shown}: not readable (permission denied)")
