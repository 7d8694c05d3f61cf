"""The background of the synthetic scenes: a cluttered office, painted once for each seed."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pfviz.particles import FloatArray

Colour = tuple[float, float, float]

_FINE = 4
_WALL, _SKY = (186.0, 196.0, 204.0), (236.0, 214.0, 190.0)
_WOOD, _WOOD_EDGE = (92.0, 132.0, 176.0), (54.0, 82.0, 116.0)
_BOOKS: tuple[Colour, ...] = (
    (70, 62, 58), (120, 96, 60), (86, 120, 66), (52, 70, 140), (150, 150, 148), (62, 108, 150),
    (110, 70, 84), (176, 190, 200), (60, 90, 96), (136, 84, 44), (70, 150, 190), (44, 48, 96),
)  # fmt: skip
_NOTES: tuple[Colour, ...] = ((130, 226, 240), (222, 226, 228), (214, 196, 150), (180, 214, 176))


def paint_office(rng: np.random.Generator, size: tuple[int, int]) -> NDArray[np.float32]:
    """``(h, w, 3)``: an office in BGR, 0 to 255, painted finely, averaged to ``size`` (width, height)."""
    brush = _Brush(np.empty((size[1] * _FINE, size[0] * _FINE, 3), np.float32), rng)
    for paint in (_wall, _window, _pin_board, _shelves, _table, _screen, _papers, _mug, _cables, _pens):
        paint(brush)
    return np.asarray(cv2.resize(brush.canvas, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


@dataclass(frozen=True, slots=True)
class _Brush:
    """Paints on a fine canvas in pixels of the final image."""

    canvas: NDArray[np.float32]
    rng: np.random.Generator

    def polygon(self, points: ArrayLike, colour: ArrayLike) -> None:
        fine = np.rint(np.asarray(points, dtype=float) * _FINE * 16).astype(np.int32)
        cv2.fillPoly(self.canvas, [fine], np.asarray(colour, dtype=float).tolist(), cv2.LINE_8, shift=4)

    def rectangle(self, x: float, y: float, w: float, h: float, colour: ArrayLike) -> None:
        self.polygon([(x, y), (x + w, y), (x + w, y + h), (x, y + h)], colour)

    def line(self, points: ArrayLike, colour: ArrayLike, width: float) -> None:
        fine = np.rint(np.asarray(points, dtype=float) * _FINE * 16).astype(np.int32)
        thickness = max(1, round(width * _FINE))
        cv2.polylines(
            self.canvas,
            [fine],
            False,
            np.asarray(colour, dtype=float).tolist(),
            thickness,
            cv2.LINE_8,
            shift=4,
        )

    def ellipse(self, x: float, y: float, rx: float, ry: float, colour: ArrayLike) -> None:
        angles = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
        self.polygon(np.stack([x + rx * np.cos(angles), y + ry * np.sin(angles)], axis=1), colour)

    def shade(self, points: ArrayLike, depth: float, softness: float) -> None:
        """Darken a soft-edged polygon."""
        mask = np.zeros(self.canvas.shape[:2], np.float32)
        cv2.fillPoly(mask, [np.rint(np.asarray(points, dtype=float) * _FINE).astype(np.int32)], 1.0)
        shade = 1.0 - depth * cv2.GaussianBlur(mask, (0, 0), softness * _FINE)
        np.multiply(self.canvas, shade[..., None], out=self.canvas)

    def jitter(self, colour: ArrayLike, amount: float = 14.0) -> FloatArray:
        return np.clip(np.asarray(colour, dtype=float) + self.rng.uniform(-amount, amount, 3), 0.0, 255.0)


def _wall(brush: _Brush) -> None:
    height, width = brush.canvas.shape[:2]
    x, y = np.linspace(0, 1, width), np.linspace(0, 1, height)[:, None]
    light = 1.06 - 0.22 * x - 0.10 * y + 0.06 * np.exp(-((x - 0.35) ** 2 + (y - 0.3) ** 2) / 0.08)
    brush.canvas[:] = light[..., None] * np.array(_WALL)


def _window(brush: _Brush) -> None:
    x, y, w, h = 10.0, -6.0, 70.0, 76.0
    brush.shade([(x + 3, y), (x + w + 6, y), (x + w + 6, y + h + 5), (x + 3, y + h + 5)], 0.25, 3.0)
    brush.rectangle(x, y, w, h, (232, 236, 238))
    for row in np.linspace(0, 1, 12):
        brush.rectangle(x + 4, y + 4 + row * (h - 9), w - 8, h / 12 + 1, np.array(_SKY) * (0.9 + 0.15 * row))
    _skyline(brush, x + 4, y + h - 5, w - 8)
    brush.rectangle(x + w / 2 - 1.5, y, 3, h, (226, 230, 232))
    brush.rectangle(x, y + 0.52 * h, w, 2.4, (224, 228, 230))
    for slat in np.arange(0.0, brush.rng.uniform(14, 24), 3.2):
        brush.rectangle(x + 2, slat - 1, w - 4, 1.8, (214, 222, 228))
    brush.rectangle(x - 3, y + h - 1, w + 6, 4, (206, 212, 216))


def _skyline(brush: _Brush, x: float, bottom: float, width: float) -> None:
    left = x
    while left < x + width - 1:
        w, h = min(brush.rng.uniform(6, 14), x + width - left), brush.rng.uniform(8, 26)
        brush.rectangle(left, bottom - h, w, h, brush.jitter((168, 160, 150), 12))
        left += w


def _pin_board(brush: _Brush) -> None:
    x, y, w, h = 90.0, 12.0, 42.0, 44.0
    brush.rectangle(x, y, w, h, (70, 98, 126))
    brush.rectangle(x + 1.5, y + 1.5, w - 3, h - 3, (118, 160, 190))
    for _ in range(7):
        nx, ny = x + brush.rng.uniform(3, w - 14), y + brush.rng.uniform(3, h - 15)
        nw, nh = brush.rng.uniform(8, 12), brush.rng.uniform(8, 13)
        tilt = brush.rng.uniform(-1.2, 1.2)
        note = [(nx, ny + tilt), (nx + nw, ny), (nx + nw - tilt, ny + nh), (nx - tilt, ny + nh + tilt)]
        brush.polygon(note, brush.jitter(_NOTES[brush.rng.integers(len(_NOTES))], 8))
        for row in np.arange(2.5, nh - 1, 2.2):
            end = brush.rng.uniform(0.5, 0.9) * nw
            brush.line([(nx + 1.5, ny + row), (nx + end, ny + row)], (120, 112, 108), 0.4)


def _shelves(brush: _Brush) -> None:
    left, right = 142.0, 234.0
    for board in (42.0, 84.0):
        brush.shade([(left, board), (right, board), (right + 3, board + 9), (left + 3, board + 9)], 0.35, 2.5)
        _row_of_books(brush, left + 2, right - 2, board)
        brush.rectangle(left, board, right - left, 3.2, _WOOD)
        brush.rectangle(left, board + 2.4, right - left, 0.8, _WOOD_EDGE)


def _row_of_books(brush: _Brush, left: float, right: float, board: float) -> None:
    x, rng = left, brush.rng
    while x < right - 4:
        w, h = min(rng.uniform(3.2, 8.5), right - x), rng.uniform(19, 32)
        if rng.random() < 0.12:
            x += w
            continue
        lean = rng.uniform(-3, 3) if rng.random() < 0.15 else 0.0
        colour = brush.jitter(_BOOKS[rng.integers(len(_BOOKS))])
        brush.polygon([(x, board), (x + w, board), (x + w + lean, board - h), (x + lean, board - h)], colour)
        brush.line([(x, board), (x + lean, board - h)], colour * 0.6, 0.5)
        band = rng.uniform(0.2, 0.7) * h
        brush.rectangle(x + 0.8 + lean / 2, board - band, max(w - 1.6, 0.8), rng.uniform(1, 3), colour * 0.5 + 110)
        x += w


def _table(brush: _Brush) -> None:
    width, height = 240.0, 180.0
    top = 126.0
    brush.shade([(0, top - 8), (width, top - 8), (width, top), (0, top)], 0.3, 3.0)
    brush.rectangle(0, top, width, height - top, _WOOD)
    for _ in range(46):
        y = top + (height - top) * brush.rng.random() ** 0.8
        start, length = brush.rng.uniform(-30, width), brush.rng.uniform(20, 110)
        tone = np.array(_WOOD) * brush.rng.uniform(0.86, 1.08)
        brush.line(
            [(start, y), (start + length / 2, y + brush.rng.uniform(-0.8, 0.8)), (start + length, y)],
            tone,
            0.6,
        )
    brush.rectangle(0, top, width, 1.2, np.array(_WOOD) * 1.2)
    rows = slice(int(top * _FINE), None)
    fade = np.linspace(0.86, 1.08, brush.canvas.shape[0] - rows.start)
    brush.canvas[rows] *= fade[:, None, None].astype(np.float32)


def _screen(brush: _Brush) -> None:
    x, y, w, h = brush.rng.uniform(14, 26), 80.0, 62.0, 40.0
    brush.shade([(x - 2, 128), (x + w + 10, 128), (x + w + 16, 138), (x + 4, 138)], 0.4, 3.0)
    brush.polygon([(x + 24, 130), (x + 38, 130), (x + 36, y + h - 2), (x + 26, y + h - 2)], (60, 58, 56))
    brush.ellipse(x + 31, 131, 15, 3, (64, 62, 60))
    brush.rectangle(x, y, w, h, (48, 46, 44))
    brush.rectangle(x + 2, y + 2, w - 4, h - 5, (88, 72, 52))
    for row in np.arange(y + 5, y + h - 6, 3.0):
        indent, length = 4 + 4 * brush.rng.integers(0, 3), brush.rng.uniform(8, 34)
        colour = brush.jitter(((170, 190, 140), (150, 190, 220), (200, 180, 160))[brush.rng.integers(3)], 10)
        brush.line([(x + indent, row), (x + indent + length, row)], colour, 0.8)


def _papers(brush: _Brush) -> None:
    for _ in range(4):
        cx, cy = brush.rng.uniform(20, 225), brush.rng.uniform(142, 174)
        angle, w, h = brush.rng.uniform(-0.5, 0.5), brush.rng.uniform(26, 36), brush.rng.uniform(12, 17)
        along = np.array([np.cos(angle), 0.45 * np.sin(angle)])
        down = np.array([-np.sin(angle) - 0.25, 0.9 * np.cos(angle)])
        corner = np.array([cx, cy])
        sheet = np.array([corner, corner + w * along, corner + w * along + h * down, corner + h * down])
        brush.shade(sheet + np.array([1.0, 1.6]), 0.3, 1.2)
        brush.polygon(sheet, brush.jitter((226, 230, 232), 8))
        for row in np.arange(0.2, 0.9, 0.17):
            start = corner + 0.1 * w * along + row * h * down
            brush.line([start, start + brush.rng.uniform(0.4, 0.8) * w * along], (150, 146, 142), 0.5)


def _mug(brush: _Brush) -> None:
    x, y = brush.rng.uniform(112, 214), brush.rng.uniform(126, 134)
    colour = np.array((150.0, 118.0, 70.0)) if brush.rng.random() < 0.5 else np.array((92.0, 128.0, 108.0))
    brush.shade([(x, y + 8), (x + 20, y + 8), (x + 26, y + 14), (x + 4, y + 14)], 0.45, 1.8)
    brush.ellipse(x + 13.5, y + 3, 4.5, 4.5, colour * 0.8)
    brush.ellipse(x + 13.5, y + 3, 2.6, 2.6, np.array(_WOOD) * 0.8)
    brush.rectangle(x, y - 4, 12, 14, colour)
    brush.ellipse(x + 6, y + 10, 6, 2.4, colour)
    brush.rectangle(x + 1.5, y - 3, 2, 13, colour * 0.5 + 110)
    brush.ellipse(x + 6, y - 4, 6, 2.2, colour * 0.5 + 100)
    brush.ellipse(x + 6, y - 3.8, 5, 1.6, (30, 42, 60))


def _cables(brush: _Brush) -> None:
    for _ in range(2):
        knots = np.stack([np.linspace(-5, 245, 6), brush.rng.uniform(136, 176, 6)], axis=1)
        t = np.linspace(0, 5, 60)
        first = np.minimum(t.astype(int), 4)
        part = (t - first)[:, None]
        smooth = part * part * (3 - 2 * part)
        curve = knots[first] * (1 - part) + knots[first + 1] * part
        curve[:, 1] = (knots[first] * (1 - smooth) + knots[first + 1] * smooth)[:, 1]
        brush.line(curve + np.array([0.6, 1.4]), np.array(_WOOD) * 0.7, 1.4)
        brush.line(curve, (56, 54, 52), 1.1)


def _pens(brush: _Brush) -> None:
    for colour in ((150, 80, 50), (60, 160, 190), (70, 70, 70)):
        x, y, angle = brush.rng.uniform(20, 220), brush.rng.uniform(146, 174), brush.rng.uniform(-0.6, 0.6)
        along = 17 * np.array([np.cos(angle), 0.6 * np.sin(angle)])
        start, shadow = np.array([x, y]), np.array([0.5, 1.2])
        brush.line([start + shadow, start + along + shadow], np.array(_WOOD) * 0.65, 1.6)
        brush.line([start, start + along], colour, 1.6)
