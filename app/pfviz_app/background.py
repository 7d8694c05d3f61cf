"""Making a file that takes long beside a visitor's session, which goes on meanwhile."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

import viser

from pfviz_app.sending import send

log = logging.getLogger(__name__)

_ROOM = threading.BoundedSemaphore(1)
"""Of all visitors so many are made at once; others wait."""
_PATIENCE, _PERIOD = 0.2, 0.5
Tell = Callable[[float], None]


class Cancelled(Exception):
    """Nobody wants it any more."""


class Background:
    """Makes files for one visitor, one at a time, and sends them.

    Args:
        client: the visitor's page.
        show: told whether something is being made.
    """

    def __init__(self, client: viser.ClientHandle, show: Callable[[bool], None]) -> None:
        self._client, self._show = client, show
        self._thread: threading.Thread | None = None
        self._cancelled = threading.Event()

    def begin(self, name: str, make: Callable[[Tell], bytes]) -> None:
        """Return at once; the file comes later.

        Args:
            name: of the file.
            make: its content; tells again and again which part of it is done, and ends with what that raises.

        Raises:
            ValueError: if another one is being made.
        """
        if self._thread is not None and self._thread.is_alive():
            raise ValueError("The one before is still being made: wait until it comes, or cancel it.")
        self._cancelled = threading.Event()
        self._thread = threading.Thread(
            target=self._work, args=(name, make, self._cancelled), name="pfviz-making", daemon=True
        )
        self._thread.start()

    def cancel(self) -> None:
        """Give up what is being made, if anything is; returns at once."""
        self._cancelled.set()

    def join(self, timeout: float | None = None) -> None:
        """Wait until nothing is being made."""
        if self._thread is not None:
            self._thread.join(timeout)

    def _work(self, name: str, make: Callable[[Tell], bytes], cancelled: threading.Event) -> None:
        notice = self._client.add_notification(f"Making {name} …", "", loading=True, with_close_button=False)
        shown_at = 0.0

        def tell(share: float) -> None:
            nonlocal shown_at
            if cancelled.is_set():
                raise Cancelled
            if time.monotonic() - shown_at > _PERIOD:
                shown_at = time.monotonic()
                send(lambda: setattr(notice, "body", f"{share:.0%}"))

        try:
            send(lambda: self._show(True))
            content = _in_turn(make, tell)
            send(lambda: self._client.send_file_download(name, content, save_immediately=True))
        except Cancelled:
            pass
        except Exception as error:
            if not isinstance(error, ValueError):
                log.exception("%s cannot be made", name)
            trouble = str(error)
            if not cancelled.is_set():
                send(lambda: self._client.add_notification(f"{name} cannot be made", trouble, color="red") and None)
        finally:
            send(notice.remove)
            send(lambda: self._show(False))


def _in_turn(make: Callable[[Tell], bytes], tell: Tell) -> bytes:
    """What ``make`` makes, when those who came before have theirs."""
    while not _ROOM.acquire(timeout=_PATIENCE):
        tell(0.0)
    try:
        tell(0.0)
        return make(tell)
    finally:
        _ROOM.release()
