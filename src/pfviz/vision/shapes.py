"""Closed spline outlines, and where the states of the tracker put them in the image.

The state of the tracker begins with the position of the outline's centre in pixels. In the shape space of similarities
it is ``(x, y, rotation, log_scale)``: the angle in radians by which the outline has turned since the start (x to the
right, y down, so a positive angle turns clockwise on the screen), and the logarithm of its size relative to the start.
The space of translations has ``(x, y)`` alone. The planar affine space adds a stretch, ``(p, q)``: the outline is first
transformed by the exponential of the symmetric matrix ``[[p, q], [q, -p]]``, which keeps its area, then scaled and
turned. By the polar decomposition every affine map that does not mirror is one of these, and zeros are the start.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pfviz.particles import FloatArray, readonly

STATE_NAMES = ("x", "y", "rotation", "log_scale", "stretch_p", "stretch_q")
DEFAULT_SHAPE = "similarity"
SHAPES = {"translation": 2, "similarity": 4, "affine": 6}
DEFAULT_POINTS = 32
_CONTROL_POINTS = 16
_DENSE = 24
_PER_SEGMENT = 4
_BASIS = np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6.0


def transforms(states: FloatArray, factor: float = 1.0) -> FloatArray:
    """``(N, 2, 3)``: the maps of ``states (N, k)``, k = 2, 4 or 6, from the outline's own frame to the image.

    ``factor`` is the size of the image's pixels relative to the state's: 0.5 for an image of half the size.
    """
    matrices = np.zeros((len(states), 2, 3))
    matrices[:, :, 2] = factor * states[:, :2]
    if states.shape[1] == 2:
        matrices[:, 0, 0] = matrices[:, 1, 1] = factor
        return matrices
    scale = factor * np.exp(states[:, 3])
    cosine, sine = scale * np.cos(states[:, 2]), scale * np.sin(states[:, 2])
    matrices[:, 0, 0], matrices[:, 0, 1] = cosine, -sine
    matrices[:, 1, 0], matrices[:, 1, 1] = sine, cosine
    if states.shape[1] == 6:
        matrices[:, :, :2] = matrices[:, :, :2] @ stretches(states[:, 4:])
    return matrices


def stretches(stretch: FloatArray) -> FloatArray:
    """``(N, 2, 2)``: the exponentials of the symmetric matrices ``[[p, q], [q, -p]]`` of ``stretch (N, 2)``."""
    p, q = stretch.T
    amount = np.hypot(p, q)
    even, odd = np.cosh(amount), np.sinh(amount) / np.where(amount > 0.0, amount, 1.0)
    odd = np.where(amount > 0.0, odd, 1.0)
    return np.stack([even + odd * p, odd * q, odd * q, even - odd * p], axis=-1).reshape(-1, 2, 2)


def apply(matrices: FloatArray, points: FloatArray) -> FloatArray:
    """``(N, L, 2)``: ``points (L, 2)`` put into the image by ``matrices (N, 2, 3)``."""
    return points @ matrices[:, :, :2].transpose(0, 2, 1) + matrices[:, None, :, 2]


@dataclass(frozen=True)
class Contour:
    """A closed cubic B-spline about the origin, sampled at points of equal spacing along it.

    Attributes:
        control_points: ``(m, 2)``, of the periodic uniform cubic B-spline, in pixels, relative to the centre.
        count: how many sample points (L).
        points: ``(L, 2)``, equally spaced in arc length.
        normals: ``(L, 2)``, of unit length, pointing outward.
    """

    control_points: FloatArray
    count: int = DEFAULT_POINTS

    def __post_init__(self) -> None:
        control = np.asarray(self.control_points, dtype=float)
        if control.ndim != 2 or control.shape[1] != 2 or len(control) < 4 or not np.isfinite(control).all():
            raise ValueError(f"control_points must be at least 4 finite points (m, 2), got shape {control.shape}")
        if self.count < 4:
            raise ValueError(f"count must be at least 4, got {self.count}")
        if signed_area(control) < 0:
            control = control[::-1]
        object.__setattr__(self, "control_points", readonly(control))
        points, normals = _sample(control, self.count)
        object.__setattr__(self, "_points", readonly(points))
        object.__setattr__(self, "_normals", readonly(normals))

    @property
    def points(self) -> FloatArray:
        return self._points  # type: ignore[attr-defined]

    @property
    def normals(self) -> FloatArray:
        return self._normals  # type: ignore[attr-defined]

    @cached_property
    def size(self) -> float:
        """The side of the square of equal area, in pixels."""
        return float(np.sqrt(abs(signed_area(self.outline(8)))))

    @cached_property
    def _polygon(self) -> FloatArray:
        return readonly(self.outline())

    def outline(self, per_segment: int = _PER_SEGMENT) -> FloatArray:
        """``(m * per_segment, 2)``: a polygon close to the spline, to draw or to fill."""
        return _evaluate(self.control_points, _parameters(len(self.control_points), per_segment))

    def outlines(self, states: FloatArray, per_segment: int = _PER_SEGMENT, factor: float = 1.0) -> FloatArray:
        """``(N, m * per_segment, 2)``: the polygon in the image for each of ``states (N, k)``."""
        polygon = self._polygon if per_segment == _PER_SEGMENT else self.outline(per_segment)
        return apply(transforms(np.atleast_2d(states), factor), polygon)

    def bounding_box(self, state: FloatArray) -> tuple[float, float, float, float]:
        """``(x, y, width, height)`` of the outline in the image, for ``state (k,)``."""
        outline = self.outlines(state)[0]
        low, high = outline.min(axis=0), outline.max(axis=0)
        return float(low[0]), float(low[1]), float(high[0] - low[0]), float(high[1] - low[1])


def contour_from_box(width: float, height: float, roundness: float = 2.5, count: int = DEFAULT_POINTS) -> Contour:
    """The superellipse inscribed in a box: an ellipse for ``roundness`` 2, nearer to the box the larger it
    is.

    Raises:
        ValueError: if a side is not positive.
    """
    if not (width > 0 and height > 0):
        raise ValueError(f"a box must have positive sides, got {width:g} x {height:g}")
    angles = np.linspace(0.0, 2.0 * np.pi, 128, endpoint=False)
    unit = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    shape = np.sign(unit) * np.abs(unit) ** (2.0 / roundness)
    return _fit(shape * [width / 2.0, height / 2.0], count)


def contour_from_polygon(polygon: ArrayLike, count: int = DEFAULT_POINTS) -> tuple[Contour, FloatArray]:
    """A smooth outline through a clicked ``polygon (n, 2)``, and its centroid ``(2,)`` in the image.

    Raises:
        ValueError: if there are fewer than three points, or they enclose no area.
    """
    vertices = np.asarray(polygon, dtype=float)
    if vertices.ndim != 2 or vertices.shape[1] != 2 or len(vertices) < 3 or not np.isfinite(vertices).all():
        raise ValueError(f"an outline needs at least 3 points (n, 2), got shape {vertices.shape}")
    if abs(signed_area(vertices)) < 1.0:
        raise ValueError("an outline must enclose some area, got points on a line")
    centre = centroid(vertices)
    return _fit(vertices - centre, count), centre


def contour_from_mask(mask: NDArray[np.uint8], count: int = DEFAULT_POINTS) -> tuple[Contour, FloatArray]:
    """The outline of the largest part of ``mask (h, w)``, and its centroid ``(2,)`` in the image.

    Raises:
        ValueError: if the mask is empty.
    """
    found, _ = cv2.findContours((mask > 0).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not found:
        raise ValueError("the mask is empty, so it has no outline")
    border = max(found, key=cv2.contourArea)[:, 0].astype(float)
    if len(border) < 3 or abs(signed_area(border)) < 1.0:
        raise ValueError("the mask is too small to have an outline")
    contour, centre = contour_from_polygon(border, count)
    grown = (contour.size + 1.0) / contour.size  # findContours walks the centres of the border pixels
    return Contour(contour.control_points * grown, count), centre


def signed_area(polygon: FloatArray) -> float:
    """Twice halved shoelace sum: positive where the polygon runs clockwise on the screen (y down)."""
    x, y = polygon.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def centroid(polygon: FloatArray) -> FloatArray:
    """``(2,)``: the centre of mass of the area inside ``polygon (n, 2)``."""
    reference = polygon.mean(axis=0)
    x, y = (polygon - reference).T
    cross = x * np.roll(y, -1) - y * np.roll(x, -1)
    sums = np.array([np.sum((x + np.roll(x, -1)) * cross), np.sum((y + np.roll(y, -1)) * cross)])
    return reference + sums / (3.0 * np.sum(cross))


def _parameters(segments: int, per_segment: int) -> FloatArray:
    return np.arange(segments * per_segment) / per_segment


def _weights(parameters: FloatArray, derivative: bool = False) -> FloatArray:
    """``(n, 4)``: the weights of the four control points at work at each parameter."""
    u = np.mod(parameters, 1.0)
    one, zero = np.ones_like(u), np.zeros_like(u)
    powers = [zero, one, 2 * u, 3 * u * u] if derivative else [one, u, u * u, u**3]
    return np.stack(powers, axis=1) @ _BASIS


def _evaluate(control: FloatArray, parameters: FloatArray, derivative: bool = False) -> FloatArray:
    """``(n, 2)``: the periodic spline, or its derivative, at ``parameters`` between 0 and m."""
    first = np.floor(parameters).astype(int)
    indices = (first[:, None] + np.arange(-1, 3)) % len(control)
    return np.einsum("nj,njc->nc", _weights(parameters, derivative), control[indices])


def _sample(control: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Points equally spaced in arc length along the spline, and the outward normals there."""
    parameters = _parameters(len(control), _DENSE)
    dense = _evaluate(control, parameters)
    steps = np.linalg.norm(np.roll(dense, -1, axis=0) - dense, axis=1)
    length = np.concatenate([[0.0], np.cumsum(steps)])
    wanted = np.arange(count) * length[-1] / count
    at = np.interp(wanted, length, np.append(parameters, len(control)))
    tangents = _evaluate(control, at, derivative=True)
    normals = np.stack([tangents[:, 1], -tangents[:, 0]], axis=1)
    return _evaluate(control, at), normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _fit(polygon: FloatArray, count: int) -> Contour:
    """The spline closest (least squares) to a closed ``polygon``, which may be coarse or fine."""
    closed = np.vstack([polygon, polygon[:1]])
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    wanted = np.linspace(0.0, length[-1], 16 * _CONTROL_POINTS, endpoint=False)
    target = np.stack([np.interp(wanted, length, column) for column in closed.T], axis=1)
    parameters = wanted / length[-1] * _CONTROL_POINTS
    design = np.zeros((len(parameters), _CONTROL_POINTS))
    columns = (np.floor(parameters).astype(int)[:, None] + np.arange(-1, 3)) % _CONTROL_POINTS
    design[np.arange(len(parameters))[:, None], columns] = _weights(parameters)
    control, *_ = np.linalg.lstsq(design, target, rcond=None)
    return Contour(readonly(control), count)
