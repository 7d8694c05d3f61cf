"""What one visitor's session has made, kept for the others who would make the very same."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Generic, Protocol, TypeVar


class Sized(Protocol):
    """What can say how much memory it keeps alive."""

    @property
    def nbytes(self) -> int: ...


T = TypeVar("T", bound=Sized)


class Shelf(Generic[T]):
    """What was used latest, up to so many bytes. Whatever is put here must never change.

    Args:
        limit_bytes: beyond which what was not used for longest is let go.
    """

    def __init__(self, limit_bytes: int) -> None:
        self._limit_bytes = limit_bytes
        self._kept: OrderedDict[Hashable, T] = OrderedDict()
        self._nbytes = 0
        self._being_made: dict[Hashable, threading.Event] = {}
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self._kept)

    @property
    def nbytes(self) -> int:
        """How much memory is kept alive."""
        return self._nbytes

    def get(self, key: Hashable, make: Callable[[], T]) -> T:
        """What belongs to ``key``; it is made if it is not here. Whoever else wants it meanwhile waits for it.

        Args:
            key: equal keys must stand for equal things.
            make: may raise whatever it likes: nothing is kept then, and those who wait try it themselves.
        """
        while True:
            with self._lock:
                if key in self._kept:
                    self._kept.move_to_end(key)
                    return self._kept[key]
                made = self._being_made.get(key)
                if made is None:
                    self._being_made[key] = threading.Event()
            if made is None:
                return self._make(key, make)
            made.wait()

    def _make(self, key: Hashable, make: Callable[[], T]) -> T:
        try:
            thing = make()
            with self._lock:
                self._kept[key] = thing
                self._nbytes += thing.nbytes
                while self._nbytes > self._limit_bytes and len(self._kept) > 1:
                    _, old = self._kept.popitem(last=False)
                    self._nbytes -= old.nbytes
            return thing
        finally:
            with self._lock:
                self._being_made.pop(key).set()
