"""Where frames come from: video files, cameras and synthetic scenes, behind one protocol."""

from __future__ import annotations

import os
from collections import OrderedDict
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol, Self, runtime_checkable

import cv2
import numpy as np
from numpy.typing import NDArray

from pfviz.names import UnknownName

Image = NDArray[np.uint8]
Truth = tuple[float, float, float, float]
Box = tuple[float, float, float, float]

DEFAULT_FRAME_RATE = 30.0
_CACHE_BYTES = 64 * 2**20


class VideoError(ValueError):
    """A video that cannot be used; the message is one line that names it and says what is wrong."""


class EndOfVideo(IndexError):
    """A frame past the last one was asked for. Not a failure: it is how a stream says that it is over."""


@runtime_checkable
class VideoSource(Protocol):
    """A numbered sequence of frames of one size."""

    @property
    def name(self) -> str:
        """What to call it on screen and in messages."""
        ...

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        ...

    @property
    def frame_rate(self) -> float:
        """Frames per second."""
        ...

    @property
    def frame_count(self) -> int | None:
        """How many frames there are, as far as is known; None for a camera. Less when a file ends early."""
        ...

    def read(self, index: int) -> Image:
        """Frame ``index`` (0-based) as a BGR image ``(height, width, 3)``, not to be written to.

        Raises:
            EndOfVideo: if the index is past the last frame.
            VideoError: if the source cannot be read any more.
        """
        ...

    def truth(self, index: int) -> Truth | None:
        """The target's true ``(x, y, rotation, scale)`` where known; the last two relative to frame 0."""
        ...

    def close(self) -> None:
        """Give back what the source holds."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(self, *exception: object) -> None: ...


def frames(source: VideoSource, start: int = 0) -> Iterator[tuple[int, Image]]:
    """The frames of ``source`` from ``start`` to its end, each with its index."""
    index = start
    while True:
        try:
            image = source.read(index)
        except EndOfVideo:
            return
        yield index, image
        index += 1


def open_source(text: str | os.PathLike[str]) -> VideoSource:
    """The source that ``text`` names: a video file, ``camera:N``, or ``scene:NAME`` (``scene:NAME:SEED``).

    Raises:
        VideoError: if there is no such source or it has no frames.
    """
    name = os.fspath(text)
    if name.startswith("camera:"):
        return Camera(_camera_number(name))
    if name.startswith("scene:"):
        from pfviz.vision.scenes import make_scene

        try:
            return make_scene(name.removeprefix("scene:"))
        except UnknownName as error:
            raise VideoError(str(error)) from None
    return VideoFile(name)


def suggested_box(source: VideoSource, index: int = 0) -> Box | None:
    """The target's box ``(x, y, width, height)`` at frame ``index`` where the source knows it."""
    box = getattr(source, "box", None)
    return None if box is None else box(index)


def _camera_number(name: str) -> int:
    number = name.removeprefix("camera:")
    if not number.isdecimal():
        raise VideoError(f"'{name}' is not a camera: expected camera:N with N = 0, 1, ...")
    return int(number)


class _FrameCache:
    """The most recently used frames, up to a number of bytes."""

    def __init__(self, limit_bytes: int = _CACHE_BYTES) -> None:
        self._limit = limit_bytes
        self._frames: OrderedDict[int, Image] = OrderedDict()

    def get(self, index: int) -> Image | None:
        if index in self._frames:
            self._frames.move_to_end(index)
        return self._frames.get(index)

    def put(self, index: int, image: Image) -> Image:
        image.flags.writeable = False
        self._frames[index] = image
        while len(self._frames) > max(2, self._limit // image.nbytes):
            self._frames.popitem(last=False)
        return image

    def clear(self) -> None:
        self._frames.clear()


def silence_opencv() -> None:
    """Keep OpenCV and its FFmpeg from writing on stderr: our errors say what is wrong, once."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)


def _capture(source: str | int, backend: int) -> cv2.VideoCapture:
    silence_opencv()
    return cv2.VideoCapture(source, backend)


def _frame_rate(capture: cv2.VideoCapture) -> float:
    rate = capture.get(cv2.CAP_PROP_FPS)
    return rate if np.isfinite(rate) and 1.0 <= rate <= 1000.0 else DEFAULT_FRAME_RATE


class VideoFile:
    """A video file, decoded by OpenCV.

    Reading on is fast. Going back seeks, and checks by the time stamp that the frame is the one that stood
    there before; where the container seeks inexactly, the file is decoded again from its beginning.

    Raises:
        VideoError: if the file is missing, empty, a folder, not a video, or has no frame that decodes.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path = Path(path)
        self.name = self._path.name
        self._cache = _FrameCache()
        self._times: list[float] = []
        self._capture = self._open()
        self._next = 0
        self._count = int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT))
        self._end: int | None = None
        self.frame_rate = _frame_rate(self._capture)
        try:
            height, width = self.read(0).shape[:2]
        except EndOfVideo:
            self.close()
            raise VideoError(f"{self._path}: no frame of this video can be decoded") from None
        self.size = (width, height)

    def _open(self) -> cv2.VideoCapture:
        path = self._path
        if not path.exists():
            raise VideoError(f"{path}: no such file")
        if path.is_dir():
            raise VideoError(f"{path}: is a folder, not a video file")
        if path.is_file() and path.stat().st_size == 0:
            raise VideoError(f"{path}: the file is empty")
        if not os.access(path, os.R_OK):
            raise VideoError(f"{path}: not readable (permission denied)")
        capture = _capture(str(path), cv2.CAP_FFMPEG)
        if not capture.isOpened():
            raise VideoError(f"{path}: not a video file that can be decoded")
        return capture

    @property
    def frame_count(self) -> int | None:
        if self._end is not None:
            return self._end
        return max(self._count, len(self._times)) if self._count > 0 else None

    def read(self, index: int) -> Image:
        if index < 0:
            raise EndOfVideo(f"{self.name}: there is no frame {index}")
        cached = self._cache.get(index)
        if cached is not None:
            return cached
        if self._end is None or index < self._end:
            self._seek(index)
            image = self._decode()
            if image is not None:
                return self._cache.put(index, image)
        raise EndOfVideo(f"{self.name}: there is no frame {index}, the video ends after {self._end} frames")

    def truth(self, index: int) -> Truth | None:
        return None

    def close(self) -> None:
        self._capture.release()
        self._cache.clear()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _seek(self, index: int) -> None:
        """Bring the decoder to where the next frame is ``index`` (or to the end, if that comes first)."""
        if index < self._next and not self._jump(index):
            self._capture.release()
            self._capture = self._open()
            self._next = 0
        while self._next < index and self._grab():
            pass

    def _jump(self, index: int) -> bool:
        """Seek to a frame that was read before; whether the frame before it proved to be the right one."""
        before = index - 1
        if before < 0 or not self._capture.set(cv2.CAP_PROP_POS_FRAMES, before) or not self._capture.grab():
            return False
        self._next = index
        return abs(self._capture.get(cv2.CAP_PROP_POS_MSEC) - self._times[before]) < 0.5

    def _grab(self) -> bool:
        if not self._capture.grab():
            self._end = self._next
            return False
        if self._next == len(self._times):
            self._times.append(self._capture.get(cv2.CAP_PROP_POS_MSEC))
        self._next += 1
        return True

    def _decode(self) -> Image | None:
        if not self._grab():
            return None
        decoded, image = self._capture.retrieve()
        return np.asarray(image, dtype=np.uint8) if decoded else None


class Camera:
    """A camera. Its frames are numbered as they are read, and only recent ones can be read again.

    Raises:
        VideoError: if the camera cannot be opened or gives no frame.
    """

    frame_count = None

    def __init__(self, number: int) -> None:
        self.name = f"camera:{number}"
        self._cache = _FrameCache()
        self._capture = _capture(number, cv2.CAP_ANY)
        self._next = 0
        if not self._capture.isOpened():
            raise VideoError(f"{self.name}: there is no such camera, or it is in use")
        self.frame_rate = _frame_rate(self._capture)
        height, width = self.read(0).shape[:2]
        self.size = (width, height)

    def read(self, index: int) -> Image:
        cached = self._cache.get(index)
        if cached is not None:
            return cached
        if index < self._next:
            raise VideoError(f"{self.name}: frame {index} is no longer kept, a camera cannot go back so far")
        while self._next <= index:
            read, image = self._capture.read()
            if not read:
                raise VideoError(f"{self.name}: the camera gives no more frames")
            self._cache.put(self._next, np.asarray(image, dtype=np.uint8))
            self._next += 1
        latest = self._cache.get(index)
        assert latest is not None
        return latest

    def truth(self, index: int) -> Truth | None:
        return None

    def close(self) -> None:
        self._capture.release()
        self._cache.clear()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
