"""Where frames come from: files, images, cameras and synthetic scenes, behind one protocol."""

from __future__ import annotations

import glob
import os
import threading
from collections import OrderedDict
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol, Self, runtime_checkable

import cv2
import numpy as np
from numpy.typing import NDArray

from pfviz.names import UnknownName
from pfviz.vision.limits import Limits, display_name

Image = NDArray[np.uint8]
Truth = tuple[float, float, float, float]
Box = tuple[float, float, float, float]

DEFAULT_FRAME_RATE = 30.0
CACHE_BYTES = 128 * 2**20
UPLOAD_CACHE_BYTES = 32 * 2**20


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


def open_source(
    text: str | os.PathLike[str], limits: Limits | None = None, frame_rate: float | None = None
) -> VideoSource:
    """The source that ``text`` names.

    That is a video file, an image, a folder of images, a pattern that matches images (``frames/*.png``), ``camera:N``,
    ``scene:NAME`` or ``scene:NAME:SEED``. Files are decoded in a process of their own, ahead of what is read.

    Args:
        text: the name.
        limits: what a file may cost.
        frame_rate: of images, in frames per second; 30 if not given.

    Raises:
        VideoError: if there is no such source, it has no frames, or it goes beyond the limits.
    """
    name = os.fspath(text)
    if name.startswith("camera:"):
        return Camera(_camera_number(name), (limits or Limits()).max_frames)
    if name.startswith("scene:"):
        from pfviz.vision.scenes import make_scene

        try:
            return make_scene(name.removeprefix("scene:"))
        except UnknownName as error:
            raise VideoError(str(error)) from None
    return _open_files(name, limits or Limits(), frame_rate)


def open_upload(
    path: str | os.PathLike[str], limits: Limits | None = None, cache_bytes: int = UPLOAD_CACHE_BYTES
) -> VideoSource:
    """A video or image file that a stranger sent, whatever its name looks like.

    Args:
        path: the file.
        limits: what it may cost.
        cache_bytes: of frames that are kept.

    Raises:
        VideoError: if it is not a regular file, goes beyond the limits or cannot be decoded.
    """
    file = Path(path)
    if file.is_symlink():
        raise VideoError(f"{display_name(file)}: is a link, not a file")
    return _open_file(file, limits or Limits(), None, cache_bytes)


def _open_files(name: str, limits: Limits, frame_rate: float | None) -> VideoSource:
    from pfviz.vision.decoding import open_images
    from pfviz.vision.images import images_in, images_matching

    if os.path.isdir(name):
        return open_images(display_name(name), images_in(Path(name)), limits, frame_rate)
    if glob.has_magic(name) and not os.path.exists(name):
        return open_images(display_name(name), images_matching(name), limits, frame_rate)
    return _open_file(Path(name), limits, frame_rate)


def _open_file(path: Path, limits: Limits, frame_rate: float | None, cache_bytes: int | None = None) -> VideoSource:
    """A video, or an image as a video of one frame; the content decides, not the name."""
    from pfviz.vision.decoding import check_file, open_images, open_video
    from pfviz.vision.images import image_size

    check_file(path, limits)
    if image_size(path) is not None:
        return open_images(display_name(path), [path], limits, frame_rate, cache_bytes)
    return open_video(path, limits, cache_bytes)


def end_note(source: VideoSource) -> str | None:
    """Why ``source`` ended too early, where it did and knows why."""
    return getattr(source, "end_note", None)


def suggested_box(source: VideoSource, index: int = 0) -> Box | None:
    """The target's box ``(x, y, width, height)`` at frame ``index`` where the source knows it."""
    box = getattr(source, "box", None)
    return None if box is None else box(index)


def _camera_number(name: str) -> int:
    number = name.removeprefix("camera:")
    if not number.isdecimal():
        raise VideoError(f"'{name}' is not a camera: expected camera:N with N = 0, 1, ...")
    return int(number)


class FrameCache:
    """The most recently used frames, up to a number of bytes. Threads may share it."""

    def __init__(self, limit_bytes: int | None = None) -> None:
        self._limit = CACHE_BYTES if limit_bytes is None else limit_bytes
        self._bytes = 0
        self._frames: OrderedDict[int, Image] = OrderedDict()
        self._lock = threading.Lock()

    @property
    def nbytes(self) -> int:
        """What the frames take."""
        return self._bytes

    def __contains__(self, index: int) -> bool:
        return index in self._frames

    def get(self, index: int) -> Image | None:
        """Frame ``index`` if it is still there."""
        with self._lock:
            if index in self._frames:
                self._frames.move_to_end(index)
            return self._frames.get(index)

    def put(self, index: int, image: Image) -> Image:
        """Keep ``image``, which can no longer be written to, and drop the least recently used beyond the limit.

        Two are kept whatever their size.
        """
        image.flags.writeable = False
        with self._lock:
            dropped = self._frames.pop(index, None)
            self._bytes += image.nbytes - (0 if dropped is None else dropped.nbytes)
            self._frames[index] = image
            while self._bytes > self._limit and len(self._frames) > 2:
                self._bytes -= self._frames.popitem(last=False)[1].nbytes
        return image

    def clear(self) -> None:
        """Drop them all."""
        with self._lock:
            self._frames.clear()
            self._bytes = 0


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


class Camera:
    """A camera. Its frames are numbered as they are read, and only recent ones can be read again.

    Threads may share it. It ends after ``max_frames``.

    Raises:
        VideoError: if the camera cannot be opened or gives no frame.
    """

    frame_count = None

    def __init__(self, number: int, max_frames: int = 1_000_000) -> None:
        self.name = f"camera:{number}"
        self._max_frames = max_frames
        self._cache = FrameCache()
        self._lock = threading.Lock()
        self._capture = _capture(number, cv2.CAP_ANY)
        self._next = 0
        if not self._capture.isOpened():
            raise VideoError(f"{self.name}: there is no such camera, or it is in use")
        self.frame_rate = _frame_rate(self._capture)
        height, width = self.read(0).shape[:2]
        self.size = (width, height)

    @property
    def latest(self) -> int:
        """The index of the newest frame."""
        return self._next - 1

    def read(self, index: int) -> Image:
        cached = self._cache.get(index)
        if cached is not None:
            return cached
        if index >= self._max_frames:
            raise EndOfVideo(f"{self.name}: ends after {self._max_frames} frames (max_frames)")
        with self._lock:
            return self._read_on(index)

    def _read_on(self, index: int) -> Image:
        """The newest frame, which has to be ``index``, unless another thread has just read that."""
        while self._next <= index:
            read, image = self._capture.read()
            if not read:
                raise VideoError(f"{self.name}: the camera gives no more frames")
            self._cache.put(self._next, np.asarray(image, dtype=np.uint8))
            self._next += 1
        kept = self._cache.get(index)
        if kept is None:
            raise VideoError(f"{self.name}: frame {index} is no longer kept, a camera cannot go back so far")
        return kept

    def truth(self, index: int) -> Truth | None:
        return None

    def close(self) -> None:
        with self._lock:
            self._capture.release()
        self._cache.clear()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
