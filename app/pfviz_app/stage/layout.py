"""Where things go on the canvas, in pixels: x to the right, y down, from the top left corner."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from pfviz_app.settings import Pane

RoomName = Literal["toy", "tracker"]
PHONE = 600
"""A window narrower than this many pixels gets viser's sheet of controls at the bottom."""
_SHEET = 372
_MARGIN = 18
_GAP = 26


@dataclass(frozen=True, slots=True)
class Rect:
    """A rectangle in pixels."""

    x: float
    y: float
    width: float
    height: float

    @property
    def right(self) -> float:
        return self.x + self.width

    @property
    def bottom(self) -> float:
        return self.y + self.height

    @property
    def centre(self) -> tuple[float, float]:
        return self.x + self.width / 2, self.y + self.height / 2

    def holds(self, x: float, y: float) -> bool:
        return self.x <= x <= self.right and self.y <= y <= self.bottom

    def inset(self, left: float, top: float, right: float, bottom: float) -> Rect:
        """The rectangle inside, at least one pixel large."""
        width, height = max(self.width - left - right, 1.0), max(self.height - top - bottom, 1.0)
        return Rect(self.x + left, self.y + top, width, height)

    def fitted(self, aspect: float) -> Rect:
        """The largest rectangle of ``aspect`` (width by height) inside, at the top, centred."""
        width = min(self.width, self.height * aspect)
        return Rect(self.x + (self.width - width) / 2, self.y, width, width / aspect)


def arrange(
    width: float, height: float, pane: Pane, phone: bool = False, rival: bool = False
) -> dict[tuple[RoomName, bool], Rect]:
    """The rooms' rectangles on a canvas: side by side when it is wide, one under the other when it is tall.

    On a phone there is one room at a time, above the sheet of controls.

    Args:
        width: of the canvas.
        height: of the canvas.
        pane: which rooms.
        phone: whether a sheet of controls covers the lower part.
        rival: whether each room is shown a second time, for the filter that is compared with.

    Returns:
        A rectangle for each room's name and whether it is the rival's.
    """
    sheet = min(_SHEET, 0.55 * height) if phone else 0.0
    free = Rect(0, 0, width, height - sheet).inset(*[_MARGIN] * 4)
    if phone and pane == "both":
        pane = "toy"
    if pane != "both":
        rooms: dict[RoomName, Rect] = {pane: free}
    else:
        first, second = _halves(free, beside=width >= 0.8 * height)
        rooms = {"toy": first, "tracker": second}
    if not rival:
        return {(room, False): rect for room, rect in rooms.items()}
    beside = phone or pane != "both"
    cells: dict[tuple[RoomName, bool], Rect] = {}
    for room, rect in rooms.items():
        cells[room, False], cells[room, True] = _halves(rect, beside and rect.width >= 0.8 * rect.height)
    return cells


def _halves(rect: Rect, beside: bool) -> tuple[Rect, Rect]:
    """The rectangle in two, with a gap between."""
    if beside:
        half = (rect.width - _GAP) / 2
        return replace(rect, width=half), Rect(rect.x + half + _GAP, rect.y, half, rect.height)
    half = (rect.height - _GAP) / 2
    return replace(rect, height=half), Rect(rect.x, rect.y + half + _GAP, rect.width, half)
