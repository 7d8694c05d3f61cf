"""How far a command is, on stderr where that is a terminal."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import TextIO

_WIDTH = 24
_REFRESH = 0.2


def duration(seconds: float) -> str:
    """``0:07``, ``12:30``, ``3:05:00``."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


class Progress:
    """A bar with rate and time left.

    Args:
        total: how many frames there will be, as far as is known; asked again and again.
        stream: where to.
        clock: seconds.
    """

    def __init__(
        self,
        total: Callable[[], int | None],
        stream: TextIO | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._total, self._clock = total, clock
        self._stream = stream or sys.stderr
        self._began = clock()
        self._shown = float("-inf")
        self._on = self._stream.isatty()

    def show(self, count: int) -> None:
        """Say that ``count`` frames are done, if that was not said a moment ago."""
        now = self._clock()
        if self._on and now - self._shown >= _REFRESH:
            self._shown = now
            self._write(self._text(count, count / max(now - self._began, 1e-9)))

    def close(self, count: int) -> None:
        """Say what it came to."""
        if self._on:
            seconds = self._clock() - self._began
            self._write(f"{count} frames in {duration(seconds)}, {count / max(seconds, 1e-9):.0f} frames/s\n")

    def _text(self, count: int, rate: float) -> str:
        total = self._total()
        if total is None or total < count:
            return f"{count} frames  {rate:.0f} frames/s"
        bar = "█" * round(_WIDTH * count / max(total, 1))
        left = duration((total - count) / rate) if rate > 0 else "?"
        return f"{bar:░<{_WIDTH}} {count} of {total} frames  {rate:.0f} frames/s  {left} left"

    def _write(self, text: str) -> None:
        self._stream.write(f"\r{text}\x1b[K" if not text.endswith("\n") else f"\r\x1b[K{text}")
        self._stream.flush()
