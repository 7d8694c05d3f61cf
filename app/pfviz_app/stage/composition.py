"""The whole picture: both rooms, their titles, and where they lie on the canvas."""

from __future__ import annotations

import math
from typing import Any

from pfviz.filters import FILTERS
from pfviz_app.picture import Picture
from pfviz_app.room import Room
from pfviz_app.stage.board import Board
from pfviz_app.stage.drawing import Drawing
from pfviz_app.stage.layout import Rect, RoomName, arrange
from pfviz_app.stage.lettering import fitted
from pfviz_app.stage.palette import DARK, LIGHT, Palette
from pfviz_app.stage.toy_1d import Toy1d
from pfviz_app.stage.toy_2d import Toy2d
from pfviz_app.stage.tracker import TrackerStage

_TITLE = 46
_TOYS: dict[int, type[Toy1d | Toy2d]] = {1: Toy1d, 2: Toy2d}


def compose(picture: Picture, size: tuple[int, int], phone: bool) -> Drawing:
    """The picture on a canvas of ``size``, in pixels.

    Args:
        picture: of which only what ``picture.look`` tells apart is used.
        size: of the canvas.
        phone: whether a sheet of controls covers the lower part.
    """
    palette = DARK if picture.settings.dark else LIGHT
    cells = arrange(*size, picture.settings.pane, phone, picture.rival is not None)
    board = Board(palette.background)
    toy = _toy(board, cells, picture, palette, False)
    frame = _tracker(board, cells, picture, palette, False)
    rival = picture.of_rival()
    if rival is not None:
        board.scope = "rival."
        _toy(board, cells, rival, palette.of_rival(), True)
        _tracker(board, cells, rival, palette.of_rival(), True)
    return board.finish(toy, frame)


Cells = dict[tuple[RoomName, bool], Rect]


def _toy(board: Board, cells: Cells, picture: Picture, palette: Palette, is_rival: bool) -> Toy1d | Toy2d | None:
    rect, film = cells.get(("toy", is_rival)), picture.toy.film
    if rect is None:
        return None
    _title(board, "toy", rect, film.world.title, _facts(picture, picture.toy, ""), palette, is_rival)
    toy = _TOYS[film.world.model.dynamics.dimension](board)
    toy.draw(rect.inset(0, _TITLE, 0, 0), picture, palette)
    if picture.settings.truth and picture.t and not is_rival:
        board.handle("toy/grab", *toy.pixel(film.truth(picture.t)), palette.truth)
    return toy


def _tracker(board: Board, cells: Cells, picture: Picture, palette: Palette, is_rival: bool) -> TrackerStage | None:
    rect, title = cells.get(("tracker", is_rival)), picture.tracker.film.setup.title
    if rect is None:
        return None
    _title(board, "tracker", rect, title, _facts(picture, picture.tracker, " px"), palette, is_rival)
    tracker = TrackerStage(board)
    tracker.draw(rect.inset(0, _TITLE, 0, 0), picture, palette)
    return tracker


def _title(board: Board, room: str, rect: Rect, title: str, facts: str, palette: Palette, is_rival: bool) -> None:
    ink, width = palette.rival if is_rival else palette.ink, rect.width
    board.text(f"{room}/title", fitted(title, 15, width, True), rect.x, rect.y + 10, ink, size=15, bold=True)
    board.text(f"{room}/facts", fitted(facts, 12.5, width), rect.x, rect.y + 32, ink)


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
