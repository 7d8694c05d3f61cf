"""One decoder and one cache of frames for everybody who watches the same video."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Self

from pfviz.vision.video import Image, Truth, VideoError, VideoSource


class SharedVideo:
    """Opens a source when the first visitor comes, lends it to all of them, and closes it when the last has left.

    Where the source has failed, who comes next gets a new one.

    Args:
        open_source: opens the source; called again when visitors come after all had left.
    """

    def __init__(self, open_source: Callable[[], VideoSource]) -> None:
        self._open_source = open_source
        self._lent: _Lent | None = None
        self._lock = threading.Lock()

    @property
    def visitors(self) -> int:
        """How many handles onto the present source are open."""
        return self._lent.visitors if self._lent else 0

    def open(self) -> VideoSource:
        """A handle onto the source, to be closed by whoever asked for it.

        Raises:
            VideoError: if the source cannot be opened.
        """
        with self._lock:
            if self._lent is None or getattr(self._lent.source, "failed", False):
                self._lent = _Lent(self._open_source())
            self._lent.visitors += 1
            return _Handle(self._lent.source, partial(self._leave, self._lent))

    def _leave(self, lent: _Lent) -> None:
        with self._lock:
            lent.visitors -= 1
            if lent.visitors == 0:
                lent.source.close()
                self._lent = None if self._lent is lent else self._lent


@dataclass(slots=True)
class _Lent:
    """A source and how many visitors have a handle onto it."""

    source: VideoSource
    visitors: int = 0


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
