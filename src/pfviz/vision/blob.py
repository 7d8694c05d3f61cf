"""The Gaussian colour-blob detector, and the proposal that is drawn from its output.

The sources (section 3) down-sample the detector's output to 24 x 18 for frames of 240 x 180, draw a cell, and
add a uniform perturbation of fine scale. So does this, on a grid that is as much finer as the object's size asks for:
the density is piecewise constant and known exactly.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pfviz.model import Components
from pfviz.particles import FloatArray, readonly
from pfviz.vision.colour import decode
from pfviz.vision.shapes import Contour

_COLUMNS, _MOST_COLUMNS = 24, 160
_CELL_SHARE = 0.1
_PEAK_SPREAD = 0.08
_PEAK_WINDOW = 0.35
_SIZE_ON_MAP = 12.0
_SHARPNESS = 6.0
_SURROUND = 1.7
_SURROUND_WEIGHT = 0.5
_PROBABILITY = (1.0 / (1.0 + np.exp(-decode(np.arange(256, dtype=np.uint8))))).astype(np.float32)


@dataclass(frozen=True)
class GridProposal:
    """A piecewise constant density over the image, drawn from exactly.

    Attributes:
        probabilities: ``(rows, columns)``, of the cells; normalised here.
        size: width and height of the image in pixels; the density is zero outside it.
        components: always x and y.

    Raises:
        ValueError: if a probability is negative or none is positive.
    """

    probabilities: FloatArray
    size: tuple[int, int]
    components: Components = (0, 1)

    def __post_init__(self) -> None:
        cells = np.asarray(self.probabilities, dtype=float)
        total = cells.sum()
        if cells.ndim != 2 or not (cells >= 0).all() or not 0 < total < np.inf:
            raise ValueError("probabilities must be a grid of non-negative numbers, not all zero")
        object.__setattr__(self, "probabilities", readonly(cells / total))

    @property
    def cell(self) -> FloatArray:
        """``(2,)``: width and height of a cell in pixels."""
        rows, columns = self.probabilities.shape
        return np.array([self.size[0] / columns, self.size[1] / rows])

    @property
    def density(self) -> FloatArray:
        """``(rows, columns)``: probability per square pixel."""
        return self.probabilities / np.prod(self.cell)

    @property
    def nbytes(self) -> int:
        return self.probabilities.nbytes

    def sample(self, rng: np.random.Generator, count: int) -> FloatArray:
        """``(count, 2)``: positions in pixels; a cell, then a uniform displacement within it."""
        cumulative = np.cumsum(self.probabilities)
        drawn = np.searchsorted(cumulative, rng.random(count) * cumulative[-1], side="right")
        drawn = np.minimum(drawn, cumulative.size - 1)
        rows, columns = np.divmod(drawn, self.probabilities.shape[1])
        return (np.stack([columns, rows], axis=1) + rng.random((count, 2))) * self.cell

    def gated(self, centre: FloatArray, spread: float, share: float) -> GridProposal:
        """A mixture of this density and, with weight ``share``, of the same times a Gaussian window.

        The window has its ``centre (2,)`` and standard deviation ``spread`` in pixels. Where there is nothing within
        it, this density itself.
        """
        rows, columns = self.probabilities.shape
        x, y = ((np.arange(n) + 0.5) * side for n, side in zip((columns, rows), self.cell, strict=True))
        windows = (np.exp(-0.5 * np.square((at - c) / spread)) for at, c in zip((x, y), centre, strict=True))
        across, down = windows
        near = self.probabilities * down[:, None] * across
        total = float(near.sum())
        if not total > 1e-12:
            return self
        return replace(self, probabilities=(1.0 - share) * self.probabilities + share / total * near)

    def log_density(self, proposed: FloatArray) -> FloatArray:
        """``(N,)``: the log-density at ``proposed (N, 2)``; minus infinity outside the image."""
        rows, columns = self.probabilities.shape
        cell = self.cell
        inside = ((proposed >= 0.0) & (proposed < self.size)).all(axis=1)
        cells = np.minimum(np.floor(proposed[inside] / cell).astype(int), [columns - 1, rows - 1])
        result = np.full(len(proposed), -np.inf)
        with np.errstate(divide="ignore"):
            result[inside] = np.log(self.probabilities[cells[:, 1], cells[:, 0]] / np.prod(cell))
        return result


@dataclass(frozen=True)
class BlobDetector:
    """Where is something of the object's colour and size?

    Every pixel has a probability of being the object's rather than the background's. Its mean over the
    object's own silhouette, averaged over all rotations, less a part of the mean over the surround, is the
    response r: it peaks at the object's centre, where a mere colour mask is flat. The density is a mixture of

    - *broad* peaks, a power of r: how much a place looks like the object;
    - *sharp* peaks, the same times a high power of r over its maximum nearby: every peak keeps its share of the
      mass, and becomes about as narrow as the likelihood is, so that few particles are spent on its slopes;
    - a *floor*, the same everywhere: no place is excluded.

    Attributes:
        size: width and height of the frame in pixels.
        shape: rows and columns of the proposal's grid.
        map_scale: pixels of the response map per pixel of the working image.
        kernel: ``(n, n)``, what the response is correlated with.
        offset: ``(2,)``, where the peak lies relative to the object's centre, in pixels of the map.
        sharpness: the power of the response.
        peak_power: the further power of the response relative to its maximum nearby.
        sharp_share: the part of the mass of the peaks that is sharp.
        floor: the mass spread evenly over the image, relative to that of one clearly seen object.
        reference: ``(2, m)``, the response about the object when it was learnt and the same over its maximum nearby,
            which tell how much one such object weighs.
        sharpness: the power of the response.
        peak_power: the further power of the response relative to its maximum nearby.
        sharp_share: the part of the mass of the peaks that is sharp.
        floor: the mass spread evenly over the image, relative to that of one clearly seen object.
        reference: ``(m,)``, the response about the object when it was learnt, which tells how much one such
            object weighs.
    """

    size: tuple[int, int]
    shape: tuple[int, int]
    map_scale: float
    kernel: NDArray[np.float32]
    offset: FloatArray
    reference: FloatArray
    sharpness: float = _SHARPNESS
    peak_power: float = 0.0
    sharp_share: float = 0.5
    floor: float = 0.1

    @classmethod
    def learn(
        cls,
        ratio: NDArray[np.uint8],
        contour: Contour,
        centre: FloatArray,
        working_scale: float,
        size: tuple[int, int],
    ) -> BlobDetector:
        """From the colour ``ratio (h, w)`` of the working image with ``contour`` at ``centre``."""
        map_scale = min(1.0, _SIZE_ON_MAP / (contour.size * working_scale))
        kernel = _kernel(contour.outline() * (working_scale * map_scale))
        plain = cls(size, _grid_shape(size, contour.size), map_scale, kernel, np.zeros(2), np.ones((2, 1)))
        response = plain.response(ratio).astype(float)
        away = _offsets_from(centre * (working_scale * map_scale), response.shape)
        distance = np.hypot(*away)
        about = distance <= _SIZE_ON_MAP
        own, relative = response[about], relative_to_peaks(response)[about]
        power = _peak_power(own, relative, away[:, about])
        offset, _ = _peak(own, relative, away[:, about], power)
        return replace(plain, offset=offset, reference=np.stack([own, relative]), peak_power=power)

    def response(self, ratio: NDArray[np.uint8]) -> NDArray[np.float32]:
        """``(h, w)`` of the response map, between 0 and 1, from the colour ratio of the working image."""
        probability = cv2.LUT(ratio, _PROBABILITY)
        width, height = (max(1, round(side * self.map_scale)) for side in ratio.shape[::-1])
        small = cv2.resize(probability, (width, height), interpolation=cv2.INTER_AREA)
        filtered = cv2.filter2D(small, cv2.CV_32F, self.kernel, borderType=cv2.BORDER_CONSTANT)
        return np.asarray(np.clip(filtered, 0.0, 1.0), dtype=np.float32)

    def cells(self, ratio: NDArray[np.uint8]) -> FloatArray:
        """``(rows, columns)``: the mass of the peaks, in objects like the one that was learnt; offset-corrected."""
        response = self.response(ratio)
        mass = self._mass(response, relative_to_peaks(response)) / self._one_object
        if self.offset.any():
            shift = np.array([[1.0, 0.0, -self.offset[0]], [0.0, 1.0, -self.offset[1]]])
            mass = cv2.warpAffine(mass, shift, mass.shape[::-1])
        rows, columns = self.shape
        area = mass.size / (rows * columns)
        return area * cv2.resize(mass, (columns, rows), interpolation=_interpolation(area)).astype(float)

    def _mass(self, response: NDArray[Any], relative: NDArray[Any]) -> NDArray[Any]:
        """The mixture of broad and sharp peaks, each weighing on its own what it weighs on the reference."""
        broad = response**self.sharpness
        if not self.peak_power:
            return broad
        return broad * (1.0 - self.sharp_share + self.sharp_share * self._blunting * relative**self.peak_power)

    @cached_property
    def _blunting(self) -> float:
        """What the reference weighs in broad peaks, over what it weighs in sharp ones."""
        own, own_relative = self.reference
        return np.sum(own**self.sharpness) / np.sum(own**self.sharpness * own_relative**self.peak_power)

    @cached_property
    def _one_object(self) -> float:
        return max(float(np.sum(self._mass(*self.reference))), 1e-6)

    def detect(self, ratio: NDArray[np.uint8]) -> GridProposal:
        """The proposal for a frame, from the colour ratio of its working image."""
        cells = self.cells(ratio)
        return GridProposal(cells + self.floor / cells.size, self.size)

    def widened(self, factor: float) -> BlobDetector:
        """A detector that is less sure of itself (``factor`` above 1) or surer (below)."""
        powers = {"sharpness": self.sharpness / factor**2, "peak_power": self.peak_power / factor**2}
        return replace(self, **powers, floor=self.floor * factor**2)


def relative_to_peaks(response: NDArray[Any]) -> NDArray[Any]:
    """``(h, w)``: the ``response`` over its maximum within about a third of the object's size; 0 where all is 0."""
    width = 2 * round(_PEAK_WINDOW * _SIZE_ON_MAP) + 1
    peaks = cv2.dilate(response, np.ones((width, width), np.uint8))
    return response / np.maximum(peaks, 1e-6)


def _peak_power(response: FloatArray, relative: FloatArray, away: FloatArray) -> float:
    """The power that makes the peak about as narrow as wanted; arguments as ``_peak``."""
    powers = (0.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
    narrow = (p for p in powers if _peak(response, relative, away, p)[1] <= _PEAK_SPREAD * _SIZE_ON_MAP)
    return next(narrow, powers[-1])


def _peak(response: FloatArray, relative: FloatArray, away: FloatArray, power: float) -> tuple[FloatArray, float]:
    """The centre ``(2,)`` of the sharp mass about the object and its standard deviation, in pixels of the map.

    From the ``response (m,)``, the same ``relative (m,)`` to its maximum nearby, and the way ``away (2, m)`` from the
    object's centre.
    """
    weights = response**_SHARPNESS * relative**power
    if weights.sum() <= 0.0:
        return np.zeros(2), 0.0
    weights = weights / weights.sum()
    centre = away @ weights
    return centre, float(np.sqrt(np.square(away - centre[:, None]) @ weights).mean())


def _interpolation(area: float) -> int:
    """How to resize: averaged where ``area`` pixels become one, interpolated where one becomes several."""
    return cv2.INTER_AREA if area >= 1.0 else cv2.INTER_LINEAR


def _grid_shape(size: tuple[int, int], object_size: float) -> tuple[int, int]:
    """Rows and columns: 24 columns, or up to 96 where a cell would be more than 0.3 of the object."""
    width, height = size
    cell = max(2.0, width / _MOST_COLUMNS, min(width / _COLUMNS, _CELL_SHARE * object_size))
    return max(1, round(height / cell)), max(1, round(width / cell))


def _kernel(outline: FloatArray) -> NDArray[np.float32]:
    """The silhouette averaged over all rotations, minus a part of what surrounds it."""
    radius = int(np.ceil(_SURROUND * np.linalg.norm(outline, axis=1).max())) + 1
    own, grown = _turned_mean(outline, radius), _turned_mean(outline * _SURROUND, radius)
    surround = np.clip(grown - own, 0.0, None)
    return (own / own.sum() - _SURROUND_WEIGHT * surround / surround.sum()).astype(np.float32)


def _turned_mean(outline: FloatArray, radius: int, fine: int = 4, turns: int = 36) -> FloatArray:
    side = (2 * radius + 1) * fine
    total = np.zeros((side, side))
    for angle in np.linspace(0.0, 2.0 * np.pi, turns, endpoint=False):
        cosine, sine = np.cos(angle), np.sin(angle)
        turned = outline @ np.array([[cosine, sine], [-sine, cosine]])
        mask = np.zeros((side, side), np.uint8)
        cv2.fillPoly(mask, [np.rint((turned + radius + 0.5) * fine - 0.5).astype(np.int32)], 1)
        total += mask
    return total.reshape(2 * radius + 1, fine, 2 * radius + 1, fine).mean(axis=(1, 3)) / turns


def _offsets_from(centre: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """``(2, h, w)``: the way in x and y from ``centre`` to the middle of every pixel."""
    rows, columns = np.indices(shape)
    return np.stack([columns + 0.5 - centre[0], rows + 0.5 - centre[1]])
