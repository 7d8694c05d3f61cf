"""Whether memory stays flat: over an hour's worth of play, and over a thousand visits.

Takes the numbers of steps and of visits: ``bench_memory.py 14400 1000``. An hour at the app's default pace is 14,400
steps; here they are run as fast as they go, by sessions whose pictures are not drawn. Visits are websocket connections.
"""

from __future__ import annotations

import asyncio
import gc
import sys
import threading
import time
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import msgspec
import websockets
from _timing import machine
from bench_app import _CAMERA
from pfviz_app.commands import Play, Reset
from pfviz_app.picture import Picture
from pfviz_app.served import prepare_video
from pfviz_app.server import App
from pfviz_app.session import Session
from pfviz_app.settings import Settings

from pfviz import kernels

_LOOKS = 6


def megabytes() -> float:
    """What the process holds in memory now, in MB (Linux only)."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 1e6


class Nowhere:
    """A view that draws nothing and counts the steps."""

    def __init__(self) -> None:
        self.steps = 0
        self.ended = threading.Event()

    def draw(self, picture: Picture) -> None:
        self.steps += picture.playing
        if picture.message:
            self.ended.set()

    def resize(self, width: int, height: int) -> None: ...

    def pick(self, x: float, y: float) -> None: ...

    def toy_place(self, x: float, y: float) -> None: ...

    def frame_place(self, x: float, y: float) -> None: ...


def play(steps: int) -> list[tuple[int, float]]:
    """Steps taken and megabytes held, at some times on the way."""
    view, seen = Nowhere(), []
    session = Session(replace(Settings(), speed=1e6), prepare_video("scene:twin", None, 0), view)
    session.start()
    for look in range(1, _LOOKS + 1):
        while view.steps < steps * look / _LOOKS:
            session.post(Play(True))
            view.ended.wait(5.0)
            view.ended.clear()
        seen.append((view.steps, megabytes()))
    session.post(Reset())
    session.close()
    return seen


async def visit(port: int) -> None:
    """Come, wait for the first picture, and leave."""
    name = websockets.Subprotocol(f"viser-v{version('viser')}")
    async with websockets.connect(f"ws://127.0.0.1:{port}", subprotocols=[name], max_size=None) as socket:
        await socket.send(msgspec.msgpack.encode(_CAMERA))
        size = 0
        while size < 50_000:
            size += len(await asyncio.wait_for(socket.recv(), 30.0))


def visits(count: int) -> list[tuple[int, float]]:
    """Visits made and megabytes held, at some times on the way."""
    app, seen = App("127.0.0.1", 8392, Settings(), prepare_video("scene:twin", None, 0)), []
    for number in range(1, count + 1):
        asyncio.run(visit(app.server.get_port()))
        if number % max(count // _LOOKS, 1) == 0:
            deadline = time.monotonic() + 20.0
            while app.sessions and time.monotonic() < deadline:
                time.sleep(0.05)
            gc.collect()
            seen.append((number, megabytes()))
    app.stop()
    return seen


def main() -> None:
    steps, count = (int(word) for word in (*sys.argv[1:], "14400", "1000")[:2])
    kernels.warm_up()
    print(f"{machine()}\n\n| after | MB |\n|---|---|")
    for number, size in play(steps):
        print(f"| {number} steps | {size:.0f} |", flush=True)
    for number, size in visits(count):
        print(f"| {number} visits | {size:.0f} |", flush=True)


if __name__ == "__main__":
    main()
