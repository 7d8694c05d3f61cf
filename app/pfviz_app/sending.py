"""Sending to a page from a thread of one's own."""

from __future__ import annotations

from collections.abc import Callable

_STUMBLE = "deque mutated during iteration"
_TRIES = 5


def send(action: Callable[[], None]) -> None:
    """Do what sends something to a page; once more where viser stumbles, which does no harm.

    viser wakes its event loop from whichever thread sends. Where the loop wakes by itself at that very moment, asyncio
    raises an error after the message was queued: about once in a hundred thousand pictures.

    Args:
        action: may be done twice.
    """
    for attempt in range(_TRIES):
        try:
            return action()
        except RuntimeError as error:
            if _STUMBLE not in str(error) or attempt == _TRIES - 1:
                raise
