"""One visitor's session: a worker thread that alone changes settings, traces and what is drawn.

Imports no viser: it draws through a ``View``, which the app and the tests supply.
"""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from typing import Any, Literal, Protocol

from pfviz import kernels
from pfviz.vision.video import EndOfVideo
from pfviz.worlds import get_world
from pfviz_app.commands import Click, Close, Command, Open, Play, Reset, Resize, Seek, Set, Step, Walk, merged
from pfviz_app.films import ToyFilm, VideoFilm, VideoSetup
from pfviz_app.room import Room
from pfviz_app.settings import SettingError, Settings, decode

log = logging.getLogger(__name__)

_RUNNING = {"filter", "toy_particles", "tracker_particles", "system", "observation", "proposal"}
"""Settings that change how a step is run."""


@dataclass(frozen=True, slots=True)
class Pick:
    """One particle of the step on screen.

    Attributes:
        room: "toy" or "tracker".
        index: among the particles as they were weighed.
    """

    room: Literal["toy", "tracker"]
    index: int


@dataclass(frozen=True, slots=True)
class Picture:
    """All that a view needs to draw.

    Attributes:
        settings: as the visitor has set them.
        toy: the toy room.
        tracker: the tracker's room.
        t: the time that is shown.
        stage: the last stage of its iteration that is shown; None when all are, and the posterior with them.
        last: the last time recorded.
        chosen: the particle that the visitor has clicked.
        playing: whether the session runs on.
        message: what went wrong or has ended, in a sentence; empty when all is well.
    """

    settings: Settings
    toy: Room[ToyFilm]
    tracker: Room[VideoFilm]
    t: int
    stage: int | None
    last: int
    chosen: Pick | None
    playing: bool
    message: str


class View(Protocol):
    """What a session draws on."""

    def draw(self, picture: Picture) -> None:
        """Show the picture."""
        ...

    def resize(self, width: int, height: int) -> None:
        """Lay out for a canvas of this size, in pixels."""
        ...

    def pick(self, x: float, y: float) -> Pick | None:
        """What was drawn at this pixel of the canvas."""
        ...


class Session:
    """A visitor's rooms and playhead, worked by one thread from a queue of commands."""

    def __init__(self, settings: Settings, video: VideoSetup, view: View) -> None:
        self._settings = settings
        self._video = video
        self._view = view
        self._queue: queue.SimpleQueue[Command] = queue.SimpleQueue()
        self._tracker_film = VideoFilm(video)
        self._playing = False
        self._message = ""
        self._t = 0
        self._stage: int | None = None
        self._chosen: Pick | None = None
        self._due = 0.0
        self._closed = False
        self._start_rooms()
        self._thread = threading.Thread(target=self._work, name="pfviz-session", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def post(self, command: Command) -> None:
        """Ask for something; returns at once, from any thread."""
        self._queue.put(command)

    def close(self) -> None:
        """End the session and wait until everything it held is freed."""
        self.post(Close())
        if self._thread.ident is None:
            self._tracker_film.close()
        elif threading.current_thread() is not self._thread:
            self._thread.join(timeout=10.0)

    def idle(self) -> bool:
        """Whether nothing is asked for that has not been begun; if not, another picture will be drawn."""
        return self._queue.empty()

    @property
    def alive(self) -> bool:
        return self._thread.is_alive()

    def _work(self) -> None:
        self._attempt(self._draw)
        while not self._closed:
            for command in self._next_commands():
                self._attempt(self._obey, command)
            if self._playing and time.monotonic() >= self._due:
                self._due = time.monotonic() + 1.0 / self._settings.speed
                self._attempt(self._advance)
            if not self._closed:
                self._attempt(self._draw)
        self._tracker_film.close()

    def _attempt(self, action: Any, *arguments: Any) -> None:
        """Do it; if it fails, pause and say why. The session goes on, and reset works."""
        try:
            action(*arguments)
        except Exception as error:
            log.exception("a session's step failed")
            self._playing = False
            self._message = f"Paused: {error}"
            with suppress(Exception):
                self._draw()

    def _next_commands(self) -> list[Command]:
        """What has been asked for; waits for it, but while playing no longer than until the next step."""
        wait = max(self._due - time.monotonic(), 0.0) if self._playing else None
        commands: list[Command] = []
        with suppress(queue.Empty):
            commands.append(self._queue.get(timeout=wait))
            while True:
                commands.append(self._queue.get_nowait())
        return merged(commands)

    def _obey(self, command: Command) -> None:
        match command:
            case Set(field, value):
                self._unless_refused(self._set, field, value)
            case Play(on):
                self._play(not self._playing if on is None else on)
            case Step(count):
                self._playing = False
                self._step(count)
            case Walk(count):
                self._playing = False
                self._walk(count)
            case Seek(t):
                self._playing = False
                self._seek(t)
            case Click(x, y):
                self._chosen = self._view.pick(x, y)
            case Open(code):
                self._unless_refused(self._open, code)
            case Reset():
                self._start_rooms()
            case Resize(width, height):
                self._view.resize(width, height)
            case Close():
                self._closed = True

    def _unless_refused(self, action: Callable[..., None], *arguments: Any) -> None:
        """Do what a visitor wishes, or say what is wrong with the wish: nothing is lost by it."""
        try:
            action(*arguments)
        except SettingError as error:
            self._message = str(error)

    def _set(self, field: str, value: Any) -> None:
        settings = self._settings.with_value(field, value)
        if settings == self._settings:
            return
        self._settings = settings
        if field == "world":
            self._settings = replace(settings, toy_particles=get_world(settings.world).n_particles)
        if field in ("world", "seed"):
            self._start_rooms()
        elif field in _RUNNING:
            self._configure_rooms()
            self._redo()

    def _open(self, code: str) -> None:
        """Bring back what was shared: its settings, and its film up to its time."""
        self._settings, t = decode(code)
        self._playing = False
        self._start_rooms()
        self._step(t)

    def _play(self, on: bool) -> None:
        if on and self._ended:
            self._start_rooms()
        self._playing, self._due = on, time.monotonic()

    def _step(self, count: int) -> None:
        if count < 0:
            self._seek(self._t + count)
        for _ in range(count):
            if not self._advance():
                break

    def _start_rooms(self) -> None:
        s = self._settings
        self._message, self._t, self._stage, self._chosen = "", 0, None, None
        self._plain = not kernels.compiled_ready()
        film = ToyFilm(get_world(s.world), s.seed)
        noises = (s.system, s.observation, s.proposal)
        self._toy = Room(film, s.filter, film.model(*noises), s.toy_particles, s.seed)
        tracker_model = self._tracker_film.model(*noises)
        self._tracker = Room(self._tracker_film, s.filter, tracker_model, s.tracker_particles, s.seed)

    def _configure_rooms(self) -> None:
        s = self._settings
        noises = (s.system, s.observation, s.proposal)
        self._toy.configure(s.filter, self._toy.film.model(*noises), s.toy_particles)
        self._tracker.configure(s.filter, self._tracker_film.model(*noises), s.tracker_particles)

    def _redo(self) -> None:
        """Run the step on screen once more, with the settings as they are now and the same random numbers.

        What was recorded after it is forgotten. While playing, the settings hold from the next step on.
        """
        if self._t == 0:
            self._start_rooms()
        elif self._playing or self._t == self._earliest:
            self._rewind(self._t)
        else:
            self._seek(self._t - 1)
            self._rewind(self._t)
            self._advance()

    def _advance(self) -> bool:
        """One step on, if there is one: replayed from the record, or run where nothing is recorded yet."""
        self._message = ""
        if self._t == self._last:
            try:
                with kernels.use_numpy() if self._plain else nullcontext():
                    self._tracker.step()
                    self._toy.step()
            except EndOfVideo:
                self._playing, self._message = (
                    False,
                    f"The film ends here, at step {self._t}. Play starts it again.",
                )
                return False
            finally:
                self._rewind(self._last)
        self._t, self._stage, self._chosen = self._t + 1, None, None
        return True

    def _rewind(self, t: int) -> None:
        """Forget what came after time ``t``, in both rooms."""
        self._toy.rewind(t)
        self._tracker.rewind(t)

    def _walk(self, count: int) -> None:
        """Stage by stage: forward into the next iteration after the posterior, back into the last one."""
        for _ in range(abs(count)):
            stages = max(len(room.trace[self._t].stages) for room in (self._toy, self._tracker)) if self._t else 0
            if count > 0 and (self._stage is None or not stages):
                self._stage = 0 if self._advance() else None
            elif count > 0 and self._stage is not None:
                self._stage = self._stage + 1 if self._stage + 1 < stages else None
            elif self._stage is None and stages:
                self._stage = stages - 1
            elif self._stage:
                self._stage -= 1
            else:
                self._seek(self._t - 1)

    def _seek(self, t: int) -> None:
        self._stage = self._chosen = None
        self._t = min(max(t, self._earliest), self._last)
        self._message = ""

    @property
    def _earliest(self) -> int:
        """The earliest time that can be shown: 0, unless the first records had to be forgotten."""
        first = max(self._toy.trace.first, self._tracker.trace.first)
        return 0 if first == 1 else first

    @property
    def _last(self) -> int:
        return min(self._toy.trace.last, self._tracker.trace.last)

    @property
    def _ended(self) -> bool:
        lengths = (self._toy.film.length, self._tracker_film.length)
        return any(length is not None and self._t >= length for length in lengths)

    def _draw(self) -> None:
        self._view.draw(
            Picture(
                self._settings,
                self._toy,
                self._tracker,
                self._t,
                self._stage,
                self._last,
                self._chosen,
                self._playing,
                self._message,
            )
        )
