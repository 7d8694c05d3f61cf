"""The whole picture: both rooms, their titles, and where they lie on the canvas."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import viser

from pfviz.filters import FILTERS
from pfviz.particles import FloatArray
from pfviz_app.picture import Pick, Picture
from pfviz_app.room import Room
from pfviz_app.stage.board import Board
from pfviz_app.stage.layout import PHONE, Rect, RoomName, arrange
from pfviz_app.stage.lettering import fitted
from pfviz_app.stage.palette import DARK, LIGHT, Palette
from pfviz_app.stage.toy_1d import Toy1d
from pfviz_app.stage.toy_2d import Toy2d
from pfviz_app.stage.tracker import TrackerStage

_TITLE = 46


class Stage:
    """Draws pictures on one visitor's scene, and knows what a pixel of it stands for."""

    def __init__(self, client: viser.ClientHandle, on_grab: Callable[[float, float, bool], None]) -> None:
        self._client = client
        self.board = Board(client, on_grab)
        self._toys = {1: Toy1d(self.board), 2: Toy2d(self.board)}
        self._trackers = {rival: TrackerStage(self.board) for rival in (False, True)}
        self._rival_toys = {1: Toy1d(self.board), 2: Toy2d(self.board)}
        self._toy: Toy1d | Toy2d | None = None
        self._size: tuple[int, int] = (0, 0)
        self._phone = client.camera.image_width < PHONE

    def resize(self, width: int, height: int) -> None:
        """Lay out for a canvas of this size, in pixels."""
        if (width, height) != self._size and width > 0 and height > 0:
            self._size = (width, height)
            self.board.fit_camera(width, height)

    def straighten(self) -> None:
        """Look squarely at the picture again."""
        self.board.fit_camera(*self._size)

    def pick(self, x: float, y: float) -> Pick | None:
        """The particle drawn at a pixel of the canvas."""
        return self.board.pick(x, y)

    def toy_place(self, x: float, y: float) -> FloatArray | None:
        """The place in the toy world that a pixel of the canvas stands for."""
        return None if self._toy is None else self._toy.place(x, y)

    def frame_place(self, x: float, y: float) -> tuple[float, float] | None:
        """The pixel of the frame that a pixel of the canvas shows."""
        return self._trackers[False].place(x, y)

    def draw(self, picture: Picture) -> None:
        """Show the picture, as one update."""
        palette = DARK if picture.settings.dark else LIGHT
        rival = picture.of_rival()
        cells = arrange(*self._size, picture.settings.pane, self._phone, picture.rival is not None)
        self._toy = None
        with self._client.atomic():
            self.board.begin(palette.background)
            for (room, is_rival), rect in cells.items():
                self.board.scope = "rival." if is_rival else ""
                shown = rival if is_rival else picture
                if shown is not None:
                    self._room(room, is_rival, rect, shown, palette.of_rival() if is_rival else palette)
            self.board.scope = ""
            self.board.finish()

    def _room(self, room: RoomName, is_rival: bool, rect: Rect, picture: Picture, palette: Palette) -> None:
        inside = rect.inset(0, _TITLE, 0, 0)
        if room == "tracker":
            title = picture.tracker.film.setup.title
            self._title(room, rect, title, _facts(picture, picture.tracker, " px"), palette, is_rival)
            self._trackers[is_rival].draw(inside, picture, palette)
            return
        world = picture.toy.film.world
        self._title(room, rect, world.title, _facts(picture, picture.toy, ""), palette, is_rival)
        toy = (self._rival_toys if is_rival else self._toys)[world.model.dynamics.dimension]
        toy.draw(inside, picture, palette)
        if not is_rival:
            self._toy = toy
            if picture.settings.truth and picture.t:
                x, y = toy.pixel(picture.toy.film.truth(picture.t))
                self.board.handle("toy/grab", x, y, palette.truth)

    def _title(self, room: str, rect: Rect, title: str, facts: str, palette: Palette, is_rival: bool) -> None:
        ink, width = palette.rival if is_rival else palette.ink, rect.width
        self.board.text(f"{room}/title", fitted(title, 15, width, True), rect.x, rect.y + 10, ink, size=15, bold=True)
        self.board.text(f"{room}/facts", fitted(facts, 12.5, width), rect.x, rect.y + 32, ink)


def _facts(picture: Picture, room: Room[Any], unit: str) -> str:
    if not picture.t:
        return f"t = 0 · {FILTERS[picture.lane.settings.filter].title} · the prior"
    record, outcome = room.trace[picture.t], room.outcome(picture.t)
    parts = [
        f"t = {picture.t}",
        FILTERS[outcome.filter_name].title,
        f"ESS {record.effective_sample_size:.1f} of {len(record.posterior)}",
    ]
    if math.isfinite(outcome.error):
        parts.append(f"error {outcome.error:.2f}{unit}")
    if outcome.lost:
        parts.insert(1, "LOST, looking for it")
    if record.condition == "degenerate":
        parts.append("all weights zero: kept as they were")
    return " · ".join(parts)
