"""A drawing board: things are put on it by name, in pixels, and it gives the drawing.

The drawing lies in a plane that the camera looks at squarely through a small field of view, so one unit of the scene is
one pixel of the canvas. It can still be orbited.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pfviz.particles import IntArray
from pfviz_app.stage.drawing import Drawing, Frame, Mark, Target, Toy
from pfviz_app.stage.layout import Rect, RoomName
from pfviz_app.stage.lettering import lettered
from pfviz_app.stage.palette import Colours, Rgb, blend

_THICKNESSES = (1.2, 2.6)
_SIZES = (0.5, 0.85, 1.3)
_TEXT_DEPTH = 30.0
_JPEG = (cv2.IMWRITE_JPEG_QUALITY, 90)
Anchor = Literal["left", "centre", "right"]


class Board:
    """What one drawing is made on.

    Args:
        background: the colour of the canvas.

    Attributes:
        background: the colour of the canvas.
        scope: put before every name, so that the same can be drawn twice.
    """

    def __init__(self, background: Rgb) -> None:
        self.background = background
        self.scope = ""
        self._marks: dict[str, Mark] = {}
        self._targets: list[Target] = []
        self._grips: set[str] = set()

    def finish(self, toy: Toy | None, frame: Frame | None) -> Drawing:
        """The drawing, with those who know what its pixels stand for."""
        return Drawing(self._marks, tuple(self._targets), frozenset(self._grips), toy, frame)

    def target(self, room: RoomName, points: ArrayLike, indices: IntArray) -> None:
        """Let what is drawn at ``points (n, 2 or 3)`` be clicked: it stands for the particles at ``indices (n,)``."""
        self._targets.append(Target(room, np.asarray(points, dtype=float)[:, :2], indices, bool(self.scope)))

    def segments(
        self, name: str, points: ArrayLike, colours: Colours | Rgb, thickness: float = 1.5, depth: float = 0.0
    ) -> None:
        """Straight lines: ``points (n, 2, 2 or 3)`` in pixels; ``colours`` one for all or ``(n, 3)``."""
        placed = _placed(points, depth)
        if len(placed):
            self._put(name, _lines(placed, _for_lines(colours), thickness))

    def polyline(
        self,
        name: str,
        points: ArrayLike,
        colour: Rgb,
        thickness: float = 1.5,
        depth: float = 0.0,
        closed: bool = False,
    ) -> None:
        """One line through ``points (n, 2 or 3)``, or several of equal length: ``(m, n, 2 or 3)``."""
        self.segments(name, joined(points, closed), colour, thickness, depth)

    def weighted_segments(
        self,
        name: str,
        points: ArrayLike,
        strengths: ArrayLike,
        colour: Rgb,
        depth: float = 0.0,
        weakest: Rgb | None = None,
    ) -> None:
        """Lines whose ``strengths (n,)`` from 0 to 1 are shown by colour and thickness together.

        A strength of 0 has the colour ``weakest``, by default one close to the background.
        """
        weakest = self._pale(colour, 0.12) if weakest is None else weakest
        strength = np.asarray(strengths, dtype=float)
        mark = _lines(_placed(points, depth), _for_lines(blend(weakest, colour, strength)), 0.0)
        self._in_bins(name, mark, strength, "thickness", _THICKNESSES)

    def points(
        self, name: str, points: ArrayLike, colours: Colours | Rgb, size: float = 8.0, depth: float = 0.0
    ) -> None:
        """Discs of diameter ``size``: ``points (n, 2 or 3)``; ``colours`` one for all or ``(n, 3)``."""
        placed = _placed(points, depth)
        if len(placed):
            self._put(name, _discs(placed, np.asarray(colours, dtype=np.uint8), size))

    def weighted_points(
        self,
        name: str,
        points: ArrayLike,
        strengths: ArrayLike,
        colour: Rgb,
        size: float = 8.0,
        depth: float = 0.0,
        weakest: Rgb | None = None,
    ) -> None:
        """Discs whose ``strengths (n,)`` from 0 to 1 are shown by colour and size together.

        A strength of 0 has the colour ``weakest``, by default one close to the background.
        """
        weakest = self._pale(colour, 0.25) if weakest is None else weakest
        strength = np.asarray(strengths, dtype=float)
        mark = _discs(_placed(points, depth), blend(weakest, colour, strength), 0.0)
        self._in_bins(name, mark, strength, "point_size", [size * factor / 2.0 for factor in _SIZES])

    def _in_bins(
        self, name: str, mark: Mark, strengths: NDArray[np.float64], style: str, values: Sequence[float]
    ) -> None:
        """A mark in several: the stronger, the later ``style`` and the nearer to the viewer."""
        bins = np.minimum((strengths * len(values)).astype(np.int64), len(values) - 1)
        order = np.argsort(bins, kind="stable")
        points, colours = mark.properties["points"][order], mark.properties["colors"][order]
        points[..., 2] += bins[order].reshape(-1, *[1] * (points.ndim - 2))
        stops = np.cumsum(np.bincount(bins, minlength=len(values))).tolist()
        for i, (start, stop) in enumerate(pairwise([0, *stops])):
            if stop > start:
                part = slice(start, stop)
                properties = {"points": points[part], "colors": colours[part], style: values[i]}
                self._put(f"{name}/{i}", Mark(mark.kind, properties))

    def text(
        self,
        name: str,
        text: str,
        x: float,
        y: float,
        colour: Rgb,
        anchor: Anchor = "left",
        size: float = 12.5,
        bold: bool = False,
    ) -> None:
        """One line of text, its middle at height ``y`` and its ``anchor`` at ``x``."""
        self._put(name, _text(text, x, y, colour, anchor, size, bold))

    def handle(self, name: str, x: float, y: float, colour: Rgb) -> None:
        """Something to take hold of."""
        self._put(name, _text("✥", x, y, colour, "centre", 21, True))
        self._grips.add(self.scope + name)

    def rule(self, name: str, left: float, right: float, y: float, colour: Rgb, depth: float = 0.0) -> None:
        """A horizontal hairline."""
        self._put(name, _rule(left, right, y, colour, depth))

    def image(self, name: str, image: NDArray[np.uint8], rect: Rect, depth: float = -12.0) -> None:
        """A BGR or BGRA image that fills ``rect``."""
        self._put(name, _image(image, rect, depth))

    def _put(self, name: str, mark: Mark) -> None:
        self._marks[self.scope + name] = mark

    def _pale(self, colour: Rgb, strength: float) -> Rgb:
        r, g, b = blend(self.background, colour, strength).tolist()
        return r, g, b


@lru_cache(maxsize=2048)
def _text(text: str, x: float, y: float, colour: Rgb, anchor: Anchor, size: float, bold: bool) -> Mark:
    """A line of text. Of what is written in every drawing there is one mark, which need not be sent again."""
    properties, width, _ = _lettering(text, size, colour, bold)
    middle = x + {"left": width / 2.0, "centre": 0.0, "right": -width / 2.0}[anchor]
    return Mark("image", properties, (middle, -y, _TEXT_DEPTH))


@lru_cache(maxsize=512)
def _lettering(text: str, size: float, colour: Rgb, bold: bool) -> tuple[dict[str, Any], float, float]:
    picture, width, height = lettered(text, size, colour, bold)
    return _encoded(picture, width, height), width, height


@lru_cache(maxsize=512)
def _rule(left: float, right: float, y: float, colour: Rgb, depth: float) -> Mark:
    board = Board(colour)
    board.segments("rule", [[[left, y], [right, y]]], colour, 1.0, depth)
    return board.finish(None, None).marks["rule"]


def _lines(placed: NDArray[np.float32], colours: Colours, thickness: float) -> Mark:
    """Segments ``(n, 2, 3)``, each of one colour, in linear light: one for all or ``(n, 3)``."""
    ends = np.empty(placed.shape, np.uint8)
    ends[:] = colours.reshape(-1, 1, 3)
    return Mark("lines", {"points": placed, "colors": ends, "thickness": thickness})


def _discs(placed: NDArray[np.float32], colours: Colours, size: float) -> Mark:
    """Discs at ``(n, 3)``; one colour for all or ``(n, 3)``."""
    each = np.empty(placed.shape, np.uint8)
    each[:] = colours
    return Mark("points", {"points": placed, "colors": each, "point_size": size / 2.0})


def _image(image: NDArray[np.uint8], rect: Rect, depth: float) -> Mark:
    x, y = rect.centre
    return Mark("image", _encoded(image, rect.width, rect.height), (x, -y, depth))


def _encoded(image: NDArray[np.uint8], width: float, height: float) -> dict[str, Any]:
    """The properties of an image's node: BGR images as JPEG, BGRA ones as PNG."""
    format, options = ("png", ()) if image.shape[2] == 4 else ("jpeg", _JPEG)
    data = cv2.imencode(f".{format}", image, options)[1]
    return {"_format": format, "_data": data, "render_width": width, "render_height": height}


def joined(points: ArrayLike, closed: bool = False) -> NDArray[np.float64]:
    """The segments ``(n, 2, d)`` of one line ``(n, d)`` or of several ``(m, n, d)``."""
    lines = np.asarray(points, dtype=float)
    lines = lines[None] if lines.ndim == 2 else lines
    if closed:
        lines = np.concatenate([lines, lines[:, :1]], axis=1)
    return np.stack([lines[:, :-1], lines[:, 1:]], axis=2).reshape(-1, 2, lines.shape[-1])


def arrow_heads(points: ArrayLike, length: float = 7.0) -> NDArray[np.float64]:
    """Two short strokes at the end of each segment: ``(n, 2, 2)`` in, ``(2 n, 2, 2)`` out."""
    segments = np.asarray(points, dtype=float)
    along = segments[:, 0] - segments[:, 1]
    along = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    tips = segments[:, 1]
    ends = [tips + length * (0.92 * along + sign * 0.38 * across) for sign in (1.0, -1.0)]
    return np.concatenate([np.stack([tips, end], axis=1) for end in ends])


def _placed(points: ArrayLike, depth: float) -> NDArray[np.float32]:
    """Pixel coordinates, y down, as scene coordinates, y up, ``depth`` pixels nearer to the viewer."""
    array = np.asarray(points, dtype=float)
    placed = np.empty((*array.shape[:-1], 3), dtype=np.float32)
    placed[..., 0], placed[..., 1] = array[..., 0], -array[..., 1]
    placed[..., 2] = depth + (array[..., 2] if array.shape[-1] == 3 else 0.0)
    return placed


def _for_lines(colours: Colours | Rgb) -> Colours:
    """Colours as line nodes need them: viser takes those of lines, unlike those of points, to be linear light."""
    return _LINEAR[np.asarray(colours, dtype=np.uint8)]


def _linear_light() -> Colours:
    encoded = np.arange(256) / 255.0
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return np.rint(255.0 * linear).astype(np.uint8)


_LINEAR = _linear_light()
