"""One visitor's session: a worker thread that alone changes settings, traces and what is drawn.

Imports no viser: it draws through a ``View``, which the app and the tests supply.
"""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from pfviz.names import UnknownName
from pfviz.particles import FloatArray
from pfviz.vision.video import EndOfVideo, end_note
from pfviz.worlds import get_world
from pfviz_app.commands import (
    Arrange,
    Ask,
    Click,
    Close,
    Command,
    Drag,
    Keep,
    Load,
    Open,
    Outline,
    Play,
    Reset,
    Resize,
    Seek,
    Select,
    Set,
    Step,
    Walk,
    merged,
)
from pfviz_app.films import Point, Start, ToyFilm, VideoFilm, VideoSetup
from pfviz_app.lane import Lane
from pfviz_app.picture import Picture, View
from pfviz_app.room import Run
from pfviz_app.scenarios import find_scenario
from pfviz_app.settings import ITSELF, NOBODY, RUNNING, SettingError, Settings
from pfviz_app.share import CORNER_DIGITS, PLACE_DIGITS, Shared, decode
from pfviz_app.shelf import Shelf
from pfviz_app.turns import Turns

log = logging.getLogger(__name__)
T = TypeVar("T")

_PROGRESS_PERIOD = 0.25
_ARREARS = 0.1
"""Seconds that a film on its way may be late and still catch up."""
_TURNS = Turns(1)
"""Of all sessions so many step and draw at once."""
_TASTE = ("dark", "speed", "arrows", "truth", "exact", "ancestry", "overlay")
"""Settings that a situation of the gallery leaves as the visitor likes them."""


class Session:
    """A visitor's rooms and playhead, worked by one thread from a queue of commands.

    Args:
        settings: to begin with.
        video: what the tracker's room shows.
        view: what is drawn on.
        runs: steps that other visitors have run.
    """

    def __init__(self, settings: Settings, video: VideoSetup, view: View, runs: Shelf[Run] | None = None) -> None:
        self._settings = settings
        self._runs = runs
        self._view = view
        self._queue: queue.SimpleQueue[Command] = queue.SimpleQueue()
        self._waiting: list[Command] = []
        self._tracker_film = VideoFilm(video)
        self._playing = False
        self._due = 0.0
        self._closed = False
        self._grip: FloatArray | None = None
        self._outline: tuple[Point, ...] | None = None
        self._situation: str | None = None
        self._progress: float | None = None
        self._drawn_at = 0.0
        self._start()
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
        return self._queue.empty() and not self._waiting

    @property
    def alive(self) -> bool:
        return self._thread.is_alive()

    def _work(self) -> None:
        self._attempt(self._draw)
        while not self._closed:
            for command in self._next_commands():
                self._attempt(self._obey, command)
            if not self._closed:
                with _TURNS:
                    self._play_on()
        self._tracker_film.close()

    def _play_on(self) -> None:
        """The next step, if it is due, and the picture."""
        now = time.monotonic()
        if self._playing and now >= self._due:
            self._due = max(self._due + 1.0 / self._settings.speed, now - _ARREARS)
            self._attempt(self._advance)
        self._attempt(self._draw)

    def _attempt(self, action: Any, *arguments: Any) -> None:
        """Do it; if it fails, pause and say why. The session goes on, and reset works."""
        try:
            action(*arguments)
        except Exception as error:
            log.exception("a session's step failed")
            self._playing, self._progress = False, None
            self._message = f"Paused: {error}"
            with suppress(Exception):
                self._draw()

    def _next_commands(self) -> list[Command]:
        """What has been asked for; waits for it, but while playing no longer than until the next step."""
        wait = max(self._due - time.monotonic(), 0.0) if self._playing else None
        if not self._waiting:
            with suppress(queue.Empty):
                self._waiting.append(self._queue.get(timeout=wait))
        self._fetch()
        commands, self._waiting = merged(self._waiting), []
        return commands

    def _fetch(self) -> None:
        with suppress(queue.Empty):
            while True:
                self._waiting.append(self._queue.get_nowait())

    def _interrupted(self) -> bool:
        """Whether something has been asked for meanwhile that ends what takes long."""
        self._fetch()
        return any(not isinstance(command, Resize | Click | Drag) for command in self._waiting)

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
                self._click(x, y)
            case Drag(x, y, end):
                self._drag(x, y, end)
            case Keep():
                self._keep()
            case Select(left, top, right, bottom):
                self._unless_refused(self._select, (left, top), (right, bottom))
            case Outline():
                self._unless_refused(self._draw_outline)
            case Load(path, name):
                self._unless_refused(self._load, path, name)
            case Open(code):
                self._unless_refused(self._open, code)
            case Arrange(name):
                self._unless_refused(self._arrange, name)
            case Ask(answer):
                self._unless_refused(answer, self._picture)
            case Reset():
                self._restart()
            case Resize(width, height):
                self._view.resize(width, height)
            case Close():
                self._closed = True

    def _unless_refused(self, action: Callable[..., None], *arguments: Any) -> None:
        """Do what a visitor wishes, or say what is wrong with the wish: nothing is lost by it."""
        try:
            action(*arguments)
        except (SettingError, UnknownName) as error:
            self._message = str(error)

    def _set(self, field: str, value: Any) -> None:
        settings = self._settings.with_value(field, value)
        if settings == self._settings:
            return
        self._settings = settings
        if field in (*RUNNING, "world", "seed", "rival"):
            self._situation = None
        if field == "world":
            self._settings = replace(settings, toy_particles=get_world(settings.world).n_particles)
        if field in ("world", "seed"):
            self._restart()
        elif field == "rival":
            self._compare()
        elif field in RUNNING:
            self._redo()

    # The lanes

    def _start(self, first: Settings | None = None, rival: Settings | None = None, film: ToyFilm | None = None) -> None:
        """Begin at time 0, with these settings for the first step, by default those of now."""
        s = first or self._settings
        self._message, self._t, self._stage, self._chosen, self._grip = "", 0, None, None, None
        film = film or ToyFilm(get_world(s.world), s.seed)
        self._lane = Lane(s, film, self._tracker_film, self._runs)
        rival = rival or self._rival_settings(s)
        self._rival = Lane(rival, film, self._tracker_film, self._runs) if rival else None

    def _restart(self) -> None:
        self._outline = None
        kept = self._rival.settings if self._rival and self._settings.rival == ITSELF else None
        s = self._settings
        if kept and kept.world != s.world:
            kept = replace(kept, world=s.world, toy_particles=s.toy_particles)
        self._start(rival=kept and replace(kept, seed=s.seed))

    def _rival_settings(self, settings: Settings) -> Settings | None:
        """Those of the filter that is compared with, which are ours but for the filter."""
        if settings.rival == NOBODY:
            return None
        return settings if settings.rival == ITSELF else replace(settings, filter=settings.rival)

    @property
    def _lanes(self) -> tuple[Lane, ...]:
        return (self._lane,) if self._rival is None else (self._lane, self._rival)

    def _keep(self) -> None:
        """Compare with what is recorded now, whatever it was compared with before."""
        self._settings, self._situation = self._settings.with_value("rival", ITSELF), None
        self._compare()

    def _compare(self) -> None:
        """Run the filter that is compared with from the start, under the settings that each step was run with."""
        s, chosen = self._settings, self._chosen
        self._chosen = None if chosen and chosen.rival else chosen
        if s.rival == NOBODY:
            self._rival = None
        elif s.rival == ITSELF:
            self._rival = self._lane.fork(self._lane.last)
        else:
            log = self._lane.log[: self._t]
            script = [replace(settings, filter=s.rival) for settings in log]
            self._rival = None
            first = script[0] if script else replace(s, filter=s.rival)
            rival = Lane(first, self._lane.toy.film, self._tracker_film, self._runs)
            self._run(rival, script)
            rival.configure(replace(s, filter=s.rival))
            self._rival, self._t = rival, min(self._t, rival.last)

    def _run(self, lane: Lane, script: Sequence[Settings]) -> None:
        """Steps under these settings."""
        for settings in self._until_interrupted(script):
            lane.configure(settings)
            lane.step()

    def _until_interrupted(self, steps: Sequence[T]) -> Iterator[T]:
        """One after the other; shows how far it is, and stops when something else is asked for."""
        try:
            for done, step in enumerate(steps):
                if self._interrupted():
                    self._message = f"Interrupted at step {done} of {len(steps)}."
                    break
                yield step
                self._show_progress((done + 1) / len(steps))
        finally:
            self._progress = None

    def _show_progress(self, share: float) -> None:
        if time.monotonic() - self._drawn_at > _PROGRESS_PERIOD:
            self._progress = share
            self._draw()

    def _redo(self) -> None:
        """Run the step on screen once more, with the settings as they are now and the same random numbers.

        What was recorded after it is forgotten. While playing, the settings hold from the next step on. A lane that is
        kept to compare with stays as it is.
        """
        lanes = self._lanes if self._settings.rival != ITSELF else (self._lane,)
        if self._t == 0:
            kept = self._rival if len(lanes) < len(self._lanes) else None
            self._start(film=self._lane.toy.film)
            self._rival = kept or self._rival
            return
        self._lane.configure(self._settings)
        rival = self._rival_settings(self._settings)
        if self._rival and rival and self._rival in lanes:
            self._rival.configure(rival)
        self._rerun(lanes)

    def _rerun(self, lanes: Sequence[Lane]) -> None:
        if self._playing or self._t == self._earliest:
            for lane in lanes:
                lane.rewind(self._t)
            return
        self._seek(self._t - 1)
        for lane in lanes:
            lane.rewind(self._t)
        self._advance()

    # Time

    def _play(self, on: bool) -> None:
        if on and self._ended:
            self._restart()
        self._playing, self._due = on, time.monotonic()

    def _step(self, count: int) -> None:
        if count < 0:
            self._seek(self._t + count)
        for _ in range(count):
            if not self._advance():
                break

    def _advance(self) -> bool:
        """One step on, if there is one: replayed from the record, or run where nothing is recorded yet."""
        self._message = ""
        if self._grip is not None and self._t < self._lane.toy.film.length:
            for lane in self._lanes:
                lane.rewind(self._t)
            self._lane.toy.film.hold(self._t + 1, self._grip)
        try:
            if self._lane.last == self._t:
                self._lane.step()
            if self._rival and self._rival.last == self._t:
                self._step_rival(self._rival)
        except EndOfVideo:
            self._playing = False
            note = end_note(self._tracker_film.source)
            self._message = (
                f"The film ends here, at step {self._t}{(note and f' ({note})') or ''}. Play starts it again."
            )
            return False
        self._t, self._stage, self._chosen = self._t + 1, None, None
        return True

    def _step_rival(self, rival: Lane) -> None:
        """Under the settings of our own step; a lane that is kept goes on under its own."""
        if self._settings.rival != ITSELF:
            rival.configure(replace(self._lane.log[self._t], filter=self._settings.rival))
        rival.step()

    def _walk(self, count: int) -> None:
        """Stage by stage: forward into the next iteration after the posterior, back into the last one."""
        for _ in range(abs(count)):
            stages = self._stages
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
    def _stages(self) -> int:
        """How many stages the iteration on screen has, where it has most."""
        rooms = [room for lane in self._lanes for room in lane.rooms]
        return max(len(room.trace[self._t].stages) for room in rooms) if self._t else 0

    @property
    def _earliest(self) -> int:
        return max(lane.earliest for lane in self._lanes)

    @property
    def _last(self) -> int:
        return min(lane.last for lane in self._lanes)

    @property
    def _ended(self) -> bool:
        lengths = (self._lane.toy.film.length, self._tracker_film.length)
        return any(length is not None and self._t >= length for length in lengths)

    # What a visitor takes hold of

    def _click(self, x: float, y: float) -> None:
        if self._outline is None:
            self._chosen = self._view.pick(x, y)
        elif (place := self._view.frame_place(x, y)) is not None:
            self._outline = (*self._outline, place)

    def _drag(self, x: float, y: float, end: bool) -> None:
        """Put the target where the pointer is: in the step on screen, or while playing in every step to come."""
        place, film = self._place(x, y), self._lane.toy.film
        if end or self._playing:
            self._grip = None if end else place
        if place is None or self._playing or self._t <= self._earliest:
            return
        if not np.array_equal(place, film.held.get(self._t, ())):
            film.hold(self._t, place)
            self._rerun(self._lanes)

    def _place(self, x: float, y: float) -> FloatArray | None:
        """The place in the toy's world at a pixel, as exactly as a share code says it; None where it shows none."""
        place, dimension = self._view.toy_place(x, y), self._lane.toy.film.world.model.dynamics.dimension
        if place is None or len(place) != dimension or not np.isfinite(place).all():
            return None
        return np.round(place, PLACE_DIGITS)

    def _select(self, *corners: Point) -> None:
        """Follow what lies between two opposite corners, from the frame on screen on."""
        places = [self._view.frame_place(*corner) for corner in corners]
        if places[0] is None or places[1] is None:
            raise SettingError("Draw the rectangle inside the video, about what is to be followed.")
        self._follow((places[0], places[1]))

    def _draw_outline(self) -> None:
        """Begin to click an outline, or follow what it encloses."""
        corners, self._outline = self._outline, None
        if corners is None:
            self._playing, self._outline = False, ()
            self._message = "Click along the outline of what is to be followed, then press the button again."
        elif len(corners) < 3:
            raise SettingError(f"An outline needs at least 3 corners, got {len(corners)}.")
        else:
            self._follow(corners)

    def _follow(self, outline: tuple[Point, ...]) -> None:
        film = self._tracker_film
        corners = tuple((round(x, CORNER_DIGITS), round(y, CORNER_DIGITS)) for x, y in outline)
        try:
            self._tracker_film = film.following(Start(film.frame_index(self._t), corners))
        except ValueError as error:
            raise SettingError(f"There is nothing to follow there: {error}") from None
        self._playing = False
        self._restart()
        self._message = "This is its outline. Play follows it."

    def _load(self, path: Path, name: str) -> None:
        """Another video, shown at its first frame."""
        try:
            film = VideoFilm.uploaded(path, name, self._tracker_film.setup)
        except ValueError as error:
            raise SettingError(str(error)) from None
        self._tracker_film.close()
        self._tracker_film, self._playing, self._outline = film, False, None
        self._restart()
        self._message = "Now mark what to follow: press Select in the picture and drag a rectangle about it."

    # What is opened

    def _open(self, code: str) -> None:
        """Bring back what was shared, step by step."""
        shared, note = decode(code).brought_to(self._tracker_film.setup.public_name)
        world = get_world(shared.settings.world)
        if any(len(place) != world.model.dynamics.dimension for place in shared.held.values()):
            raise SettingError("the share code puts the target where this world has no room for it")
        film = self._tracker_film
        if shared.start != film.chosen_start:
            film = self._found(shared.start)
        self._settings, self._tracker_film, self._playing, self._situation = shared.settings, film, False, None
        toy_film = ToyFilm(world, shared.settings.seed, {t: np.array(place) for t, place in shared.held.items()})
        self._start(replace(shared.at(1), rival=shared.settings.rival), shared.rival_at(1), toy_film)
        self._catch_up(shared)
        self._message = f"{note} {self._message}".strip()

    def _found(self, start: Start | None) -> VideoFilm:
        try:
            return self._tracker_film.following(start)
        except (ValueError, EndOfVideo) as error:
            raise SettingError(f"the share code follows something that is not in this video: {error}") from None

    def _catch_up(self, shared: Shared) -> None:
        """Run all lanes to the time that was shared."""
        try:
            for t in self._until_interrupted(range(1, shared.t + 1)):
                self._configure(shared, t)
                if not self._advance():
                    break
        finally:
            self._configure(shared, self._t + 1)
            self._lane.configure(self._settings)
        if self._t == shared.t and self._t and shared.stage is not None:
            self._stage = min(shared.stage, self._stages - 1)

    def _configure(self, shared: Shared, t: int) -> None:
        """Let all lanes run step ``t`` as it was shared."""
        own = shared.at(t)
        self._lane.configure(own)
        if self._rival:
            self._rival.configure(shared.rival_at(t) or self._rival_settings(own) or own)

    def _arrange(self, name: str) -> None:
        """Show a situation of the gallery, but the way this visitor likes to look at things."""
        scenario = find_scenario(name)
        own = {field: getattr(self._settings, field) for field in _TASTE}
        self._settings, self._playing = replace(scenario.settings, **own), False
        self._start()
        self._situation = name
        self._catch_up(Shared(self._settings, scenario.t or 0))

    @property
    def _picture(self) -> Picture:
        return Picture(
            self._settings,
            self._lane,
            self._rival,
            self._t,
            self._stage,
            self._last,
            self._chosen,
            self._situation,
            self._outline,
            self._playing,
            self._progress,
            self._message,
        )

    def _draw(self) -> None:
        self._drawn_at = time.monotonic()
        self._view.draw(self._picture)
