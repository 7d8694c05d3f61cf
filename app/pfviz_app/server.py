"""``pfviz serve``: one server, one session for every visitor."""

from __future__ import annotations

import argparse
import contextlib
import gc
import io
import logging
import signal
import socket
import sys
import threading
import warnings
import webbrowser
from functools import partial

import viser

from pfviz import kernels
from pfviz.particles import FloatArray
from pfviz.worlds import get_world
from pfviz_app.commands import Click, Drag, Resize
from pfviz_app.controls import Controls
from pfviz_app.films import Point, VideoSetup
from pfviz_app.picture import Pick, Picture
from pfviz_app.room import Run
from pfviz_app.sending import send
from pfviz_app.served import video_of
from pfviz_app.session import Session
from pfviz_app.settings import Settings
from pfviz_app.shelf import Shelf
from pfviz_app.stage.drawing import Drawing
from pfviz_app.stage.stage import Stage

log = logging.getLogger(__name__)
_DEFAULT_PORT = 8080
_FAREWELL = "Queued a .* on a closed connection"
"""What viser warns of when a visitor leaves while a picture is drawn; the session ends a moment later."""
_PORTS_TRIED = 50


class Shelves:
    """What the visitors' sessions have made and others can use.

    Attributes:
        runs: steps of filters.
        drawings: of pictures.
    """

    def __init__(self) -> None:
        self.runs: Shelf[Run] = Shelf(256 * 2**20)
        self.drawings: Shelf[Drawing] = Shelf(96 * 2**20)


class Visitor:
    """A visitor's screen and session; satisfies ``View``."""

    def __init__(self, client: viser.ClientHandle, settings: Settings, video: VideoSetup, shelves: Shelves) -> None:
        self._client = client
        self._stage = Stage(client, self._grabbed, shelves.drawings)
        self._stage.resize(client.camera.image_width, client.camera.image_height)
        self.session = Session(settings, video, self, shelves.runs)
        try:
            self._controls = Controls(client, settings, self.session.post, self.session.idle, self._stage.straighten)
        except BaseException:
            self.session.close()
            raise
        client.camera.on_update(self._resized)
        self._resized(client.camera)  # the docks may have changed it meanwhile
        client.scene.on_click()(self._clicked)
        self.session.start()

    def close(self) -> None:
        """The visitor has left."""
        self.session.close()
        self._controls.close()

    def draw(self, picture: Picture) -> None:
        send(partial(self._draw, picture))

    def _draw(self, picture: Picture) -> None:
        with self._client.atomic():  # which wakes viser's loop only once
            try:
                self._stage.draw(picture)
            finally:  # the docks say what is wrong
                self._controls.show(picture)

    def resize(self, width: int, height: int) -> None:
        self._stage.resize(width, height)

    def pick(self, x: float, y: float) -> Pick | None:
        return self._stage.pick(x, y)

    def toy_place(self, x: float, y: float) -> FloatArray | None:
        return self._stage.toy_place(x, y)

    def frame_place(self, x: float, y: float) -> Point | None:
        return self._stage.frame_place(x, y)

    def _grabbed(self, x: float, y: float, end: bool) -> None:
        self.session.post(Drag(x, y, end))

    def _clicked(self, event: viser.SceneClickEvent) -> None:
        camera = event.client.camera
        x, y = event.screen_pos
        self.session.post(Click(x * camera.image_width, y * camera.image_height))

    def _resized(self, camera: viser.CameraHandle) -> None:
        self.session.post(Resize(camera.image_width, camera.image_height))


class App:
    """The server and its visitors."""

    def __init__(self, host: str, port: int, settings: Settings, video: VideoSetup) -> None:
        self._settings, self._video = settings, video
        self._visitors: dict[int, Visitor] = {}
        self._shelves = Shelves()
        self._lock = threading.Lock()
        with contextlib.redirect_stdout(io.StringIO()):
            self.server = viser.ViserServer(host=host, port=port, label="pfviz", verbose=False)
        self.server.on_client_connect(self._enter)
        self.server.on_client_disconnect(self._leave)

    @property
    def sessions(self) -> list[Session]:
        with self._lock:
            return [visitor.session for visitor in self._visitors.values()]

    def _enter(self, client: viser.ClientHandle) -> None:
        try:
            visitor = Visitor(client, self._settings, self._video, self._shelves)
        except Exception as error:
            log.exception("a visitor's session could not start")
            client.add_notification("pfviz cannot start here", str(error), color="red")
            return
        with self._lock:
            self._visitors[client.client_id] = visitor
        if client.client_id not in self.server.get_clients():
            self._leave(client)

    def _leave(self, client: viser.ClientHandle) -> None:
        with self._lock:
            visitor = self._visitors.pop(client.client_id, None)
        if visitor is not None:
            visitor.close()

    def stop(self) -> None:
        """Close every session and the server."""
        with self._lock:
            visitors = list(self._visitors.values())
        for visitor in visitors:
            visitor.close()
        self.server.stop()


def serve(options: argparse.Namespace) -> None:
    """Run the app until it is interrupted.

    Raises:
        ValueError: if the video or the box cannot be used, or the port is taken.
    """
    run_app(_settings(options), video_of(options), options.host, options.port, not options.no_browser)


def run_app(settings: Settings, video: VideoSetup, host: str, port: int | None, open_browser: bool) -> None:
    """Serve until it is interrupted; ``settings`` are what each visitor begins with.

    Raises:
        ValueError: if the port is taken.
    """
    warnings.filterwarnings("ignore", message=_FAREWELL)
    port = _free_port(host, port)
    ended = _ending()  # before it is said that the app runs: who reads that may end it
    threading.Thread(target=warm_up, name="pfviz-compile", daemon=True).start()
    app = App(host, port, settings, video)
    url = f"http://{'localhost' if host in ('127.0.0.1', '0.0.0.0') else host}:{port}"
    print(f"pfviz is running at {url} (Ctrl-C stops it)", flush=True)
    if open_browser:
        threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()
    try:
        ended.wait()
    finally:
        app.stop()


def warm_up() -> None:
    """Compile the kernels, and suit the interpreter to many threads that draw.

    The garbage collector leaves alone what stays, which it would look through again and again. Threads hand the
    interpreter over after a millisecond: viser's loop needs it several times to send one picture.
    """
    sys.setswitchinterval(0.001)
    kernels.warm_up()
    gc.collect()
    gc.freeze()


def _ending() -> threading.Event:
    """Set when the process is interrupted or asked to end, even where it was started with interrupts ignored."""
    ended = threading.Event()
    with contextlib.suppress(ValueError):  # not in the main thread: whoever is decides
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: ended.set())
    return ended


def _settings(options: argparse.Namespace) -> Settings:
    settings = Settings().with_value("world", options.world).with_value("filter", options.filter)
    settings = settings.with_value("toy_particles", get_world(options.world).n_particles)
    for field in ("seed", "system", "observation", "proposal"):
        settings = settings.with_value(field, getattr(options, field))
    if options.particles is not None:
        for field in ("toy_particles", "tracker_particles"):
            settings = settings.with_value(field, options.particles)
    return settings


def _free_port(host: str, port: int | None) -> int:
    """The port asked for if it is free; without one, the first free one from 8080 on, said aloud."""
    if port is not None:
        if not _is_free(host, port):
            raise ValueError(f"--port {port}: already in use on {host}; choose another one")
        return port
    for candidate in range(_DEFAULT_PORT, _DEFAULT_PORT + _PORTS_TRIED):
        if _is_free(host, candidate):
            if candidate != _DEFAULT_PORT:
                print(f"pfviz: port {_DEFAULT_PORT} is in use, so it is {candidate} instead", flush=True)
            return candidate
    raise ValueError(f"no free port from {_DEFAULT_PORT} to {_DEFAULT_PORT + _PORTS_TRIED - 1} on {host}")


def _is_free(host: str, port: int) -> bool:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError:
            return False
    return True
