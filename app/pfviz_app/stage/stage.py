"""What one visitor sees, and what its pixels stand for."""

from __future__ import annotations

from collections.abc import Callable

import viser

from pfviz.particles import FloatArray
from pfviz_app.films import Point
from pfviz_app.picture import Pick, Picture
from pfviz_app.shelf import Shelf
from pfviz_app.stage.composition import compose
from pfviz_app.stage.drawing import Drawing
from pfviz_app.stage.layout import PHONE
from pfviz_app.stage.screen import Screen


class Stage:
    """Shows pictures to one visitor.

    Args:
        client: the visitor.
        on_grab: told the pixel to which something is dragged, and whether that was the end of it.
        drawings: those that others who look at the very same have made.
    """

    def __init__(
        self, client: viser.ClientHandle, on_grab: Callable[[float, float, bool], None], drawings: Shelf[Drawing]
    ) -> None:
        self._screen, self._drawings = Screen(client, on_grab), drawings
        self._drawing: Drawing | None = None
        self._size: tuple[int, int] = (0, 0)
        self._phone = client.camera.image_width < PHONE

    def resize(self, width: int, height: int) -> None:
        """Lay out for a canvas of this size, in pixels."""
        if (width, height) != self._size and width > 0 and height > 0:
            self._size = (width, height)
            self._screen.fit_camera(width, height)

    def straighten(self) -> None:
        """Look squarely at the picture again."""
        self._screen.fit_camera(*self._size)

    def draw(self, picture: Picture) -> None:
        """Show the picture. Whoever calls makes it one update."""
        look = (picture.look, self._size, self._phone)
        self._drawing = self._drawings.get(look, lambda: compose(picture, self._size, self._phone))
        self._screen.show(self._drawing)

    def pick(self, x: float, y: float) -> Pick | None:
        """The particle drawn at a pixel of the canvas."""
        return self._drawing.pick(x, y) if self._drawing else None

    def toy_place(self, x: float, y: float) -> FloatArray | None:
        """The place in the toy world that a pixel of the canvas stands for; None where it shows none."""
        return self._drawing.toy.place(x, y) if self._drawing and self._drawing.toy else None

    def frame_place(self, x: float, y: float) -> Point | None:
        """The pixel of the frame that a pixel of the canvas shows; None where it shows none."""
        return self._drawing.frame.place(x, y) if self._drawing and self._drawing.frame else None
