"""One decoder and one cache of frames for everybody who watches the same video."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, Self

from pfviz.vision.video import Image, Truth, VideoError, VideoSource


class SharedVideo:
    """Opens a source when the first visitor comes, lends it to all of them, and closes it when the last has left.

    Args:
        open_source: opens the source; called again when visitors come after all had left.
    """

    def __init__(self, open_source: Callable[[], VideoSource]) -> None:
        self._open_source = open_source
        self._source: VideoSource | None = None
        self._visitors = 0
        self._lock = threading.Lock()

    @property
    def visitors(self) -> int:
        """How many handles are open."""
        return self._visitors

    def open(self) -> VideoSource:
        """A handle onto the source, to be closed by whoever asked for it.

        Raises:
            VideoError: if the source cannot be opened.
        """
        with self._lock:
            if self._source is None:
                self._source = self._open_source()
            self._visitors += 1
            return _Handle(self._source, self._leave)

    def _leave(self) -> None:
        with self._lock:
            self._visitors -= 1
            source = None if self._visitors else self._source
            if source is not None:
                self._source = None
                source.close()


class _Handle:
    """A visitor's view of a shared source. Of a camera it begins with the newest frame there was when it was made."""

    def __init__(self, source: VideoSource, leave: Callable[[], None]) -> None:
        self._source, self._leave = source, leave
        self._closing = threading.Lock()
        self._closed = False
        self._first: int = getattr(source, "latest", 0)

    @property
    def name(self) -> str:
        return self._source.name

    @property
    def size(self) -> tuple[int, int]:
        return self._source.size

    @property
    def frame_rate(self) -> float:
        return self._source.frame_rate

    @property
    def frame_count(self) -> int | None:
        return self._source.frame_count

    def read(self, index: int) -> Image:
        if self._closed:
            raise VideoError(f"{self.name}: is closed")
        return self._source.read(self._first + index)

    def truth(self, index: int) -> Truth | None:
        return self._source.truth(index)

    def close(self) -> None:
        with self._closing:
            leaving, self._closed = not self._closed, True
        if leaving:
            self._leave()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def __getattr__(self, name: str) -> Any:
        """What only some sources have, such as a box to begin with."""
        return getattr(self._source, name)
