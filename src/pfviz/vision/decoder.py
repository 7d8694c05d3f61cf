"""The program that decodes. It runs in a process of its own, which a hostile file may crash, hang or fill.

It imports nothing of pfviz, so that it starts fast. Requests come on standard input, answers go to standard output, one
JSON object a line; a frame's pixels follow its line as they are.

- ``{"video": PATH}`` or ``{"images": [PATH, ...]}`` with ``max_pixels``, ``max_memory`` (bytes) and ``patience``
  (seconds) come first, answered by ``{"opened": [width, height], "rate": r | null, "count": n | null}``.
- ``{"read": i}`` is answered by ``{"frame": i, "shape": [height, width]}``, or ``{"end": i, "count": n, "note": s}``
  where the video is over, the note saying why if that was too early.
- ``{"alive": n}`` may come at any time, and ``{"fail": why}`` is the last answer.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any, BinaryIO, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]

DEMUXERS = (
    "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpegts,mpeg,mpegvideo,flv,live_flv,asf,ogg,gif,apng,mxf,ivf,obu,"
    "h264,hevc,m4v,mjpeg,dv,nut,wtv,rm,yuv4mpegpipe,dirac,vc1"
)
"""FFmpeg's names of containers that hold a video; none of them is a list of other files or addresses."""

_HEARTBEAT = 0.5
_FAR = 48
_STAMP_TOLERANCE = 0.5
_THREADS = 4
_SHORT = 0.03
_NO_MEMORY = -4  # cv::Error::StsNoMem


class Unreadable(ValueError):
    """What is wrong with the file, without its name."""


class Reader(Protocol):
    """Frames by their number."""

    size: tuple[int, int]
    rate: float | None
    count: int | None
    note: str | None

    def read(self, index: int) -> Image | None:
        """Frame ``index``, or None where the video is over; ``count`` and ``note`` then say where and why."""
        ...


def _first_size(reader: Reader, trouble: str) -> tuple[int, int]:
    """Width and height of the first frame, which all others must have.

    Raises:
        Unreadable: saying ``trouble``, if there is none.
    """
    first = reader.read(0)
    if first is None:
        raise Unreadable(trouble)
    return first.shape[1], first.shape[0]


class VideoReader:
    """A video file, decoded by FFmpeg through OpenCV.

    Reading on is fast. Other frames are sought, and checked by the time stamp of the frame before; where the
    container seeks inexactly, the file is decoded again from its beginning.

    Raises:
        Unreadable: if it is not a video, has no frame that decodes, or too many pixels.
    """

    def __init__(self, path: str, max_pixels: int, alive: Callable[[int], None] = lambda _: None) -> None:
        self._path, self._max_pixels, self._alive = path, max_pixels, alive
        self._times: list[float] = []
        self._next = 0
        self._latest: tuple[int, Image] | None = None
        self._capture = self._open()
        rate = self._capture.get(cv2.CAP_PROP_FPS)
        self.rate: float | None = float(rate) if np.isfinite(rate) and 1.0 <= rate <= 1000.0 else None
        self._promised = int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT))
        self.count: int | None = self._promised if self._promised > 0 else None
        self.note: str | None = None
        self._end: int | None = None
        self.size: tuple[int, int] = (0, 0)
        self.size = _first_size(self, "no frame of this video can be decoded")

    def _open(self) -> cv2.VideoCapture:
        threads = min(_THREADS, os.cpu_count() or 1)
        capture = cv2.VideoCapture(self._path, cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, threads])
        if not capture.isOpened():
            raise Unreadable("not a video file that can be decoded")
        width, height = (int(capture.get(p)) for p in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
        _check_pixels(width, height, self._max_pixels)
        return capture

    def read(self, index: int) -> Image | None:
        if self._latest is not None and self._latest[0] == index:
            return self._latest[1]
        if self._end is not None and index >= self._end:
            return None
        self._seek(index)
        image = self._decode()
        if image is not None:
            self._latest = (index, image)
        return image

    def _seek(self, index: int) -> None:
        """Bring the capture to where the next frame is ``index`` (or to the end, if that comes first)."""
        known_and_far = self._next + _FAR < index <= len(self._times)
        if index < self._next or known_and_far:
            self._jump(index)
        while self._next < index and self._grab():
            self._alive(self._next)

    def _jump(self, index: int) -> None:
        """Seek to a frame that was read before, or to the beginning if the frame before it proves another."""
        before = index - 1
        if before >= 0 and self._capture.set(cv2.CAP_PROP_POS_FRAMES, before) and self._capture.grab():
            stamp = self._capture.get(cv2.CAP_PROP_POS_MSEC)
            if abs(stamp - self._times[before]) < _STAMP_TOLERANCE:
                self._next = index
                return
        self._capture.release()
        self._capture = self._open()
        self._next = 0

    def _grab(self) -> bool:
        if not self._capture.grab():
            self._finish(self._next)
            return False
        if self._next == len(self._times):
            self._times.append(self._capture.get(cv2.CAP_PROP_POS_MSEC))
        self._next += 1
        return True

    def _decode(self) -> Image | None:
        if not self._grab():
            return None
        decoded, image = self._capture.retrieve()
        if not decoded:
            return None
        _check_pixels(image.shape[1], image.shape[0], self._max_pixels)
        if self.size != (0, 0) and image.shape[1::-1] != self.size:
            self._finish(self._next - 1, f"frame {self._next - 1} is of another size")
            return None
        return np.ascontiguousarray(image, dtype=np.uint8)

    def _finish(self, count: int, note: str | None = None) -> None:
        if note is None and self._is_short(count):
            note = f"{self._promised} frames were announced: the file is damaged or cut short"
        self._end, self.count, self.note = count, count, note

    def _is_short(self, count: int) -> bool:
        """Whether both frames and time are missing of what was announced; often either alone is only estimated."""
        if self.rate is None or not self._times:
            return False
        seconds = (self._times[-1] - self._times[0]) / 1000.0
        few = self._promised - count > max(2.0, _SHORT * self._promised)
        return few and seconds < (1.0 - _SHORT) * self._promised / self.rate - 2.0 / self.rate


class ImageReader:
    """Image files of one size, one a frame.

    Raises:
        Unreadable: if the first of them cannot be decoded.
    """

    def __init__(self, paths: Sequence[str]) -> None:
        self._paths = paths
        self.rate: float | None = None
        self.count: int | None = len(paths)
        self.note: str | None = None
        self.size: tuple[int, int] = (0, 0)
        self.size = _first_size(self, "the image cannot be decoded")

    def read(self, index: int) -> Image | None:
        if self.count is not None and index >= self.count:
            return None
        image = _decoded(self._paths[index])
        if image is not None and (self.size == (0, 0) or image.shape[1::-1] == self.size):
            return image
        self.count, self.note = index, f"image {index} cannot be decoded or is of another size"
        return None


def _decoded(path: str) -> Image | None:
    try:
        coded = np.fromfile(os.fsencode(path), dtype=np.uint8)
        image = cv2.imdecode(coded, cv2.IMREAD_COLOR) if coded.size else None
    except OSError:
        return None
    except cv2.error as error:
        if _needs_memory(error):
            raise
        return None
    return None if image is None else np.ascontiguousarray(image, dtype=np.uint8)


def _needs_memory(error: Exception) -> bool:
    return isinstance(error, MemoryError) or getattr(error, "code", 0) == _NO_MEMORY


def _check_pixels(width: int, height: int, most: int) -> None:
    if width * height > most:
        raise Unreadable(f"{width} x {height} pixels are too many (max_pixels is {most})")


def confine(max_memory: int) -> None:
    """Let this process have no more than ``max_memory`` bytes, write no files, dump no core, where the system can."""
    try:
        import resource
    except ImportError:
        return
    limits = {"RLIMIT_AS": max_memory, "RLIMIT_FSIZE": 0, "RLIMIT_CORE": 0}
    for name, value in limits.items():
        with contextlib.suppress(ValueError, OSError, AttributeError):
            resource.setrlimit(getattr(resource, name), (value, value))


def lengthen_leash(patience: float) -> None:
    """Have the system end this process if it uses much more processor time than ``patience`` from now on.

    The parent ends it sooner; this is for when there is no parent any more.
    """
    try:
        import resource
    except ImportError:
        return
    _, hard = resource.getrlimit(resource.RLIMIT_CPU)
    soft = int(time.process_time() + _THREADS * patience + 60.0)
    with contextlib.suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_CPU, (soft, hard))


def usable_path(path: str) -> str:
    """A name of the file that OpenCV takes: one that is not UTF-8 becomes that of an open file."""
    try:
        path.encode("utf-8")
    except UnicodeEncodeError:
        return f"/dev/fd/{os.open(os.fsencode(path), os.O_RDONLY)}"
    return path


class _Answers:
    """What is written to the parent."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self._last = time.monotonic()

    def send(self, answer: dict[str, Any], pixels: Image | None = None) -> None:
        self._stream.write(json.dumps(answer).encode() + b"\n")
        if pixels is not None:
            self._stream.write(pixels.data)
        self._stream.flush()
        self._last = time.monotonic()

    def alive(self, index: int) -> None:
        """Tell the parent now and then that there is progress."""
        if time.monotonic() - self._last > _HEARTBEAT:
            self.send({"alive": index})


def open_reader(task: dict[str, Any], alive: Callable[[int], None]) -> Reader:
    """What the first request asks for."""
    if "images" in task:
        return ImageReader(task["images"])
    return VideoReader(usable_path(task["video"]), task["max_pixels"], alive)


def serve(requests: BinaryIO, answers: _Answers) -> None:
    """Answer requests until there are no more.

    Raises:
        Unreadable: if the file cannot be used.
    """
    task = json.loads(requests.readline())
    confine(task["max_memory"])
    lengthen_leash(task["patience"])
    reader = open_reader(task, answers.alive)
    answers.send({"opened": reader.size, "rate": reader.rate, "count": reader.count})
    for line in requests:
        lengthen_leash(task["patience"])
        index = json.loads(line)["read"]
        image = reader.read(index)
        if image is None:
            answers.send({"end": index, "count": reader.count, "note": reader.note})
        else:
            answers.send({"frame": index, "shape": image.shape[:2]}, image)


def main() -> None:
    """Run the program. Whatever the libraries print goes nowhere."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    answers = _Answers(os.fdopen(os.dup(1), "wb"))
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    try:
        serve(sys.stdin.buffer, answers)
    except BrokenPipeError:
        pass
    except Unreadable as error:
        answers.send({"fail": str(error)})
    except (MemoryError, cv2.error) as error:
        trouble = "decoding it needs more memory than max_memory" if _needs_memory(error) else "it cannot be decoded"
        answers.send({"fail": trouble})


if __name__ == "__main__":
    main()
