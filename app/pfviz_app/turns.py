"""Taking turns: many visitors on few cores."""

from __future__ import annotations

import threading
import time
from collections import deque


class Turns:
    """At most ``limit`` at once, first come, first served.

    Threads that all want the interpreter at once hand it over thousands of times a second, and whoever asks again first
    gets it. Taking turns they get more done in all, and all get the same.

    Attributes:
        limit: how many at once.
    """

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self._free = limit
        self._waiting: deque[threading.Event] = deque()
        self._lock = threading.Lock()

    def __enter__(self) -> None:
        with self._lock:
            if self._free and not self._waiting:
                self._free -= 1
                return
            turn = threading.Event()
            self._waiting.append(turn)
        turn.wait()

    def __exit__(self, *exception: object) -> None:
        with self._lock:
            if self._waiting:
                self._waiting.popleft().set()
            else:
                self._free += 1


class Allowance:
    """A share of the time for what may as well be done later, by all visitors together.

    Attributes:
        share: of the time, from 0 to 1.
    """

    def __init__(self, share: float) -> None:
        self.share = share
        self._next = 0.0

    @property
    def left(self) -> bool:
        """Whether it may be done now."""
        return time.monotonic() >= self._next

    def spend(self, seconds: float) -> None:
        """Say how long it took: as much later there is time again as makes that the share."""
        self._next = max(self._next, time.monotonic()) + seconds / self.share
