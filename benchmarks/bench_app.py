"""How fast the app draws: steps a second for each visitor, and from a slider to the new picture; both rooms play.

Visitors are plain websocket connections in a process of their own, which count the pictures that reach them; no browser
takes part. They come one after the other, as a class does. Those who look at the same share the work; those who differ
have a seed each.
"""

from __future__ import annotations

import asyncio
import multiprocessing
import time
from collections.abc import MutableSequence
from dataclasses import replace
from importlib.metadata import version
from multiprocessing.synchronize import Event
from statistics import median

import msgspec
import numpy as np
import websockets
import zstandard
from _timing import machine
from pfviz_app.commands import Play, Set
from pfviz_app.picture import Picture
from pfviz_app.served import prepare_video
from pfviz_app.server import App, Visitor, warm_up
from pfviz_app.settings import Settings

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
_BETWEEN = 0.1
"""Seconds between one visitor's start and the next one's."""
_FACTS = b"toy.facts"
Counts = MutableSequence[int]


def visit(port: int, counts: Counts, stop: Event) -> None:
    """Connect as many visitors as there are ``counts``, and count the pictures each is sent until ``stop`` is set."""

    async def one(number: int) -> None:
        name = websockets.Subprotocol(f"viser-v{version('viser')}")
        async with websockets.connect(f"ws://127.0.0.1:{port}", subprotocols=[name], max_size=None) as socket:
            await socket.send(msgspec.msgpack.encode(_CAMERA))
            while not stop.is_set():
                try:
                    counts[number] += _is_picture(await asyncio.wait_for(socket.recv(decode=False), 0.2))
                except TimeoutError:
                    continue

    async def everyone() -> None:
        await asyncio.gather(*(one(number) for number in range(len(counts))))

    asyncio.run(everyone())


def _is_picture(window: bytes) -> bool:
    """Whether a window of messages has the line that says what time it is: it changes with every step."""
    size = int.from_bytes(window[8:16], "little")
    return _FACTS in zstandard.decompress(window[16 : 16 + size])


def measure(visitors: int, speed: float, alike: bool) -> tuple[list[float], list[float]]:
    """Steps a second that reach each visitor, and seconds from a slider to the picture."""
    seen: dict[tuple[int, float], float] = {}
    original = Visitor.draw

    def draw(self: Visitor, picture: Picture) -> None:
        original(self, picture)
        seen.setdefault((id(self), picture.settings.observation), time.perf_counter())

    Visitor.draw = draw
    app = App("127.0.0.1", 8391, replace(Settings(), speed=speed), prepare_video("scene:twin", None, 0))
    context = multiprocessing.get_context("spawn")
    stop, counts = context.Event(), context.Array("q", visitors, lock=False)
    crowd = context.Process(target=visit, args=(app.server.get_port(), counts, stop), daemon=True)
    crowd.start()
    while len(app.sessions) < visitors:
        time.sleep(0.05)
    time.sleep(1.0)
    for seed, session in enumerate(app.sessions):
        if not alike:
            session.post(Set("seed", seed))
        session.post(Play(True))
        time.sleep(_BETWEEN)
    before, began = list(counts), time.perf_counter()
    time.sleep(_SECONDS)
    elapsed = time.perf_counter() - began
    rates = [(after - first) / elapsed for first, after in zip(before, list(counts), strict=True)]
    waits = _slide(app, seen)
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
    warm_up()
    print(f"Both rooms playing, 24 and 400 particles, RB-SS-HS-SIR. {machine()}.\n")
    print("| visitors | steps/s wished for | reach each, median | slowest visitor | slider to picture, median | p95 |")
    print("|---|---|---|---|---|---|")
    together = ((1, 30.0), (1, 40.0), (10, 15.0), (30, 15.0), (60, 15.0))
    runs = [(*run, True) for run in together] + [(10, 15.0, False), (30, 15.0, False)]
    for visitors, speed, alike in runs:
        rates, waits = measure(visitors, speed, alike)
        who = f"{visitors}{'' if alike else ', all different'}"
        print(
            f"| {who} | {speed:g} | {median(rates):.1f} | {min(rates):.1f} | "
            f"{1e3 * median(waits):.0f} ms | {1e3 * float(np.quantile(waits, 0.95)):.0f} ms |",
            flush=True,
        )


if __name__ == "__main__":
    main()
