"""What a session asks a view to draw, and what it asks of the view."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, replace
from typing import Literal, Protocol

from pfviz.particles import FloatArray
from pfviz_app.films import Point, ToyFilm, VideoFilm
from pfviz_app.lane import Lane
from pfviz_app.room import Room
from pfviz_app.settings import ITSELF, Settings
from pfviz_app.share import Shared, changes


@dataclass(frozen=True, slots=True)
class Pick:
    """One particle of the step on screen.

    Attributes:
        room: "toy" or "tracker".
        index: among the particles as they were weighed.
        rival: whether it is one of the lane that is compared with.
    """

    room: Literal["toy", "tracker"]
    index: int
    rival: bool = False


@dataclass(frozen=True, slots=True)
class Picture:
    """All that a view needs to draw.

    Attributes:
        settings: as the visitor has set them.
        lane: both rooms.
        rival: both rooms of the filter that is compared with; None without one.
        t: the time that is shown.
        stage: the last stage of its iteration that is shown; None when all are, and the posterior with them.
        last: the last time recorded.
        chosen: the particle that the visitor has clicked.
        situation: the name of the situation of the gallery that is shown; None for none.
        outline: the corners clicked so far, in frame pixels, of what is to be followed; None when none is being drawn.
        playing: whether the session runs on.
        progress: the part done of something that takes long; None when nothing is being waited for.
        message: what went wrong or has ended, in a sentence; empty when all is well.
    """

    settings: Settings
    lane: Lane
    rival: Lane | None
    t: int
    stage: int | None
    last: int
    chosen: Pick | None
    situation: str | None
    outline: tuple[Point, ...] | None
    playing: bool
    progress: float | None
    message: str

    @property
    def toy(self) -> Room[ToyFilm]:
        return self.lane.toy

    @property
    def tracker(self) -> Room[VideoFilm]:
        return self.lane.tracker

    def of_rival(self) -> Picture | None:
        """The same with the rooms of the filter that is compared with; None without one, or where it has no record."""
        if self.rival is None or self.rival.last < self.t or self.rival.earliest > self.t:
            return None
        chosen = replace(self.chosen, rival=False) if self.chosen and self.chosen.rival else None
        return replace(self, lane=self.rival, rival=None, chosen=chosen)

    @property
    def look(self) -> Hashable:
        """Equal where the drawings of two visitors' pictures are equal."""
        settings = replace(self.settings, speed=Settings.speed)
        rival = None if self.rival is None else self._course(self.rival)
        return settings, self.t, self.stage, self.chosen, self.outline, self._course(self.lane), rival

    def _course(self, lane: Lane) -> Hashable:
        return lane.course(self.t) if lane.earliest <= self.t <= lane.last else None

    @property
    def shared(self) -> Shared:
        """All that it takes to see this again."""
        film = self.toy.film
        kept = self.rival if self.settings.rival == ITSELF else None
        return Shared(
            self.settings,
            self.t,
            self.stage,
            changes(self.lane.log[: self.t]),
            changes((*kept.log, kept.settings)[: self.t + 1]) if kept else (),
            {t: tuple(place.tolist()) for t, place in film.held.items() if t <= self.t},
            self.tracker.film.chosen_start,
            self.tracker.film.setup.public_name,
        )


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

    def toy_place(self, x: float, y: float) -> FloatArray | None:
        """``(k,)``: the place in the toy world that a pixel of the canvas stands for; None where it shows none."""
        ...

    def frame_place(self, x: float, y: float) -> Point | None:
        """The pixel of the video's frame that a pixel of the canvas shows; None where it shows none."""
        ...
