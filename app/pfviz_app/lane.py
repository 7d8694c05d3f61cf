"""A lane: both rooms under one set of settings. A comparison has two lanes on the same data and random numbers."""

from __future__ import annotations

from contextlib import nullcontext

from pfviz import kernels
from pfviz_app.films import ToyFilm, VideoFilm
from pfviz_app.room import Room, Run
from pfviz_app.settings import Settings
from pfviz_app.shelf import Shelf


class Lane:
    """Two rooms in lock-step, and the settings under which each of their steps was run.

    Attributes:
        toy: the room of the toy world.
        tracker: the room of the video.
    """

    def __init__(
        self, settings: Settings, toy_film: ToyFilm, tracker_film: VideoFilm, runs: Shelf[Run] | None = None
    ) -> None:
        self._settings = settings
        self._plain = not kernels.compiled_ready()
        self._log: list[Settings] = []
        s, noises, belief = settings, settings.noises, self._belief(settings)
        toy_model, tracker_model = toy_film.model(**noises), tracker_film.model(**noises)
        self.toy = Room(toy_film, s.filter, toy_model, s.toy_particles, s.seed, belief, runs)
        self.tracker = Room(tracker_film, s.filter, tracker_model, s.tracker_particles, s.seed, belief, runs)

    def _belief(self, settings: Settings) -> str:
        """What the rooms' models are made of, and how their numbers are rounded."""
        return f"{settings.noises}, {self._plain}"

    @property
    def rooms(self) -> tuple[Room[ToyFilm], Room[VideoFilm]]:
        return self.toy, self.tracker

    @property
    def settings(self) -> Settings:
        """Under which the next step is run."""
        return self._settings

    @property
    def plain(self) -> bool:
        """Whether it runs on the NumPy twins, because the kernels were not compiled when it began."""
        return self._plain

    @property
    def log(self) -> tuple[Settings, ...]:
        """The settings of the steps at t = 1, 2, ..."""
        return tuple(self._log)

    @property
    def last(self) -> int:
        """The last time recorded in both rooms."""
        return min(room.trace.last for room in self.rooms)

    @property
    def earliest(self) -> int:
        """The earliest time that can be shown: 0, unless the first records had to be forgotten."""
        first = max(room.trace.first for room in self.rooms)
        return 0 if first == 1 else first

    def course(self, t: int) -> tuple[object, ...]:
        """What tells apart all that can be seen of the rooms at time ``t``."""
        return (self._settings if t == 0 else None, self.earliest, *(room.course(t) for room in self.rooms))

    def configure(self, settings: Settings) -> None:
        """Use other settings from the next step on."""
        if settings == self._settings:
            return
        self._settings = settings
        for room, count in ((self.toy, settings.toy_particles), (self.tracker, settings.tracker_particles)):
            room.configure(settings.filter, room.film.model(**settings.noises), count, self._belief(settings))

    def step(self) -> None:
        """One step in both rooms, or in neither.

        Raises:
            EndOfVideo: when a film is over.
        """
        try:
            with kernels.use_numpy() if self._plain else nullcontext():
                self.tracker.step()
                self.toy.step()
            self._log.append(self._settings)
        finally:
            self.rewind(self.last)

    def rewind(self, t: int) -> None:
        """Forget what came after time ``t``."""
        for room in self.rooms:
            room.rewind(t)
        del self._log[t:]

    def fork(self, t: int) -> Lane:
        """A lane with the same records up to time ``t``, which goes its own way from there."""
        other = object.__new__(Lane)
        other._settings, other._plain, other._log = self._settings, self._plain, self._log[:t]
        other.toy, other.tracker = self.toy.fork(t), self.tracker.fork(t)
        return other
