"""Where things go on the canvas, in pixels: x to the right, y down, from the top left corner."""

from __future__ import annotations

from dataclasses import dataclass

from pfviz_app.settings import Pane

PHONE = 600
"""A window narrower than this many pixels gets viser's sheet of controls at the bottom."""
_SHEET = 434
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

    def inset(self, left: float, top: float, right: float, bottom: float) -> Rect:
        """The rectangle inside, at least one pixel large."""
        width, height = max(self.width - left - right, 1.0), max(self.height - top - bottom, 1.0)
        return Rect(self.x + left, self.y + top, width, height)

    def fitted(self, aspect: float) -> Rect:
        """The largest rectangle of ``aspect`` (width by height) inside, at the top, centred."""
        width = min(self.width, self.height * aspect)
        return Rect(self.x + (self.width - width) / 2, self.y, width, width / aspect)


def arrange(width: float, height: float, pane: Pane, phone: bool = False) -> dict[str, Rect]:
    """The rooms' rectangles on a canvas: side by side when it is wide, one under the other when it is tall.

    On a phone there is one room at a time, above the sheet of controls.
    """
    sheet = min(_SHEET, 0.55 * height) if phone else 0.0
    free = Rect(0, 0, width, height - sheet).inset(*[_MARGIN] * 4)
    if phone and pane == "both":
        pane = "toy"
    if pane != "both":
        return {pane: free}
    if width >= 0.8 * height:
        half = (free.width - _GAP) / 2
        return {
            "toy": Rect(free.x, free.y, half, free.height),
            "tracker": Rect(free.x + half + _GAP, free.y, half, free.height),
        }
    half = (free.height - _GAP) / 2
    return {
        "toy": Rect(free.x, free.y, free.width, half),
        "tracker": Rect(free.x, free.y + half + _GAP, free.width, half),
    }
