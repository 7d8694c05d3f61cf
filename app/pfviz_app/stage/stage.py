"""The whole picture: both rooms, their titles, and where they lie on the canvas."""

from __future__ import annotations

import math
from typing import Any

import viser

from pfviz.filters import FILTERS
from pfviz_app.room import Room
from pfviz_app.session import Pick, Picture
from pfviz_app.stage.board import Board
from pfviz_app.stage.layout import PHONE, Rect, arrange
from pfviz_app.stage.lettering import fitted
from pfviz_app.stage.palette import DARK, LIGHT, Palette
from pfviz_app.stage.toy_1d import Toy1d
from pfviz_app.stage.toy_2d import Toy2d
from pfviz_app.stage.tracker import TrackerStage

_TITLE = 46


class Stage:
    """Draws pictures on one visitor's scene."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        self.board = Board(client)
        self._toys = {1: Toy1d(self.board), 2: Toy2d(self.board)}
        self._tracker = TrackerStage(self.board)
        self._size: tuple[int, int] = (0, 0)
        self._phone = client.camera.image_width < PHONE

    def resize(self, width: int, height: int) -> None:
        """Lay out for a canvas of this size, in pixels."""
        if (width, height) != self._size and width > 0 and height > 0:
            self._size = (width, height)
            self.board.fit_camera(width, height)

    def pick(self, x: float, y: float) -> Pick | None:
        """The particle drawn at a pixel of the canvas."""
        return self.board.pick(x, y)

    def draw(self, picture: Picture) -> None:
        """Show the picture, as one update."""
        palette = DARK if picture.settings.dark else LIGHT
        rooms = arrange(*self._size, picture.settings.pane, self._phone)
        with self._client.atomic():
            self.board.begin(palette.background)
            if "toy" in rooms:
                rect, film = rooms["toy"], picture.toy.film
                self._title("toy", rect, film.world.title, _facts(picture, picture.toy, ""), palette)
                toy = self._toys[film.world.model.dynamics.dimension]
                toy.draw(rect.inset(0, _TITLE, 0, 0), picture, palette)
            if "tracker" in rooms:
                rect, film = rooms["tracker"], picture.tracker.film
                self._title("tracker", rect, film.setup.title, _facts(picture, picture.tracker, " px"), palette)
                self._tracker.draw(rect.inset(0, _TITLE, 0, 0), picture, palette)
            self.board.finish()

    def _title(self, room: str, rect: Rect, title: str, facts: str, palette: Palette) -> None:
        ink, width = palette.ink, rect.width
        self.board.text(f"{room}/title", fitted(title, 15, width, True), rect.x, rect.y + 10, ink, size=15, bold=True)
        self.board.text(f"{room}/facts", fitted(facts, 12.5, width), rect.x, rect.y + 32, ink)


def _facts(picture: Picture, room: Room[Any], unit: str) -> str:
    if not picture.t:
        return f"t = 0 · {FILTERS[picture.settings.filter].title} · the prior"
    record, outcome = room.trace[picture.t], room.outcome(picture.t)
    parts = [
        f"t = {picture.t}",
        FILTERS[outcome.filter_name].title,
        f"ESS {record.effective_sample_size:.1f} of {len(record.posterior)}",
    ]
    if math.isfinite(outcome.error):
        parts.append(f"error {outcome.error:.2f}{unit}")
    if record.condition == "degenerate":
        parts.append("all weights zero: kept as they were")
    return " · ".join(parts)
