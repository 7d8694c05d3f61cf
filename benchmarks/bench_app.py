"""How fast the app draws: steps a second for each visitor, and from a slider to the new picture; both rooms play.

Visitors are plain websocket connections in a process of their own; no browser takes part.
"""

from __future__ import annotations

import asyncio
import multiprocessing
import threading
import time
from dataclasses import replace
from importlib.metadata import version
from statistics import median

import msgspec
import numpy as np
import websockets
from _timing import machine
from pfviz_app.commands import Play, Set
from pfviz_app.picture import Picture
from pfviz_app.server import App, Visitor, prepare_video
from pfviz_app.settings import Settings

from pfviz import kernels

_CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (0.0, -1.0, 0.0),
    "fov": 0.1,
    "near": 1.0,
    "far": 1000.0,
    "image_height": 850,
    "image_width": 780,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}
_SECONDS = 4.0


def visit(port: int, count: int, stop: multiprocessing.synchronize.Event) -> None:
    """Connect ``count`` visitors and read whatever they are sent until ``stop`` is set."""

    async def one() -> None:
        name = websockets.Subprotocol(f"viser-v{version('viser')}")
        async with websockets.connect(f"ws://127.0.0.1:{port}", subprotocols=[name], max_size=None) as socket:
            await socket.send(msgspec.msgpack.encode(_CAMERA))
            while not stop.is_set():
                try:
                    await asyncio.wait_for(socket.recv(), 0.2)
                except TimeoutError:
                    continue

    async def everyone() -> None:
        await asyncio.gather(*(one() for _ in range(count)))

    asyncio.run(everyone())


def measure(visitors: int, speed: float) -> tuple[list[float], list[float]]:
    """Drawn steps a second of each visitor, and seconds from a slider to the picture."""
    drawn: dict[int, list[float]] = {}
    seen: dict[tuple[int, float], float] = {}
    original = Visitor.draw

    def draw(self: Visitor, picture: Picture) -> None:
        original(self, picture)
        drawn.setdefault(id(self), []).append(time.perf_counter())
        seen.setdefault((id(self), picture.settings.observation), time.perf_counter())

    Visitor.draw = draw
    app = App("127.0.0.1", 8391, replace(Settings(), speed=speed), prepare_video("scene:twin", None, 0))
    context = multiprocessing.get_context("spawn")
    stop = context.Event()
    crowd = context.Process(target=visit, args=(app.server.get_port(), visitors, stop), daemon=True)
    crowd.start()
    while len(app.sessions) < visitors:
        time.sleep(0.05)
    time.sleep(1.0)
    for times in drawn.values():
        times.clear()
    for session in app.sessions:
        session.post(Play(True))
    waits = _slide(app, seen)
    time.sleep(_SECONDS)
    rates = [len(times) / (times[-1] - times[0]) for times in drawn.values() if len(times) > 1]
    stop.set()
    crowd.join(5.0)
    app.stop()
    Visitor.draw = original
    return rates, waits


def _slide(app: App, seen: dict[tuple[int, float], float]) -> list[float]:
    """Move a slider of every visitor ten times; the seconds until it shows."""
    began: dict[float, float] = {}
    for value in np.linspace(0.8, 1.25, 10):
        began[float(value)] = time.perf_counter()
        for session in app.sessions:
            session.post(Set("observation", float(value)))
        time.sleep(0.25)
    time.sleep(0.5)
    return [seen[key] - began[key[1]] for key in list(seen) if key[1] in began]


def main() -> None:
    kernels.warm_up()
    print(f"Both rooms playing, 24 and 400 particles, RB-SS-HS-SIR. {machine()}; {threading.active_count()} threads.\n")
    print("| visitors | steps/s wished for | drawn/s, median | slowest visitor | slider to picture, median | p95 |")
    print("|---|---|---|---|---|---|")
    for visitors, speed in ((1, 30.0), (10, 30.0), (30, 15.0)):
        rates, waits = measure(visitors, speed)
        p95 = float(np.quantile(waits, 0.95))
        print(
            f"| {visitors} | {speed:g} | {median(rates):.1f} | {min(rates):.1f} | "
            f"{1e3 * median(waits):.0f} ms | {1e3 * p95:.0f} ms |"
        )


if __name__ == "__main__":
    main()
