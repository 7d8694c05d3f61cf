"""How well an outline fits a frame: edges along its normals, colours inside and around it, its look a frame ago."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from pfviz.kernels import (
    EdgeMap,
    normalised,
    patch_correlations,
    patch_values,
    region_affinities,
    scan_contours,
    scan_offsets_numpy,
    weighted_sums,
)
from pfviz.particles import FloatArray, readonly
from pfviz.vision.colour import CODE_STEPS, CODE_ZERO, HSV_BINS
from pfviz.vision.shapes import Contour


def pixel_centred(transforms: FloatArray) -> FloatArray:
    """``(N, 2, 3)``: the same transforms where the middle of the first pixel is at 0 instead of 1/2."""
    centred = np.array(transforms)
    centred[:, :, 2] -= 0.5
    return centred


@dataclass(frozen=True)
class ContourLikelihood:
    """The contour likelihood of CONDENSATION (Isard & Blake 1998).

    Along each of L normals the edge nearest to the outline is sought, up to ``search`` pixels either way. The
    squared distance d to it costs ``d^2 / 2 sigma^2``, and a normal without an edge as much as one at
    ``search``: with a ``sigma`` that is not much smaller, a part that is hidden does not decide everything.
    Normals are taken as independent. They are not, so the sum is multiplied by ``temper``: with ``n / L`` they
    count as n independent ones.

    Attributes:
        points: ``(L, 2)``, of the outline about its centre, in frame pixels.
        normals: ``(L, 2)``, of unit length.
        search: half the length of a normal, in pixels of the working image.
        sigma: standard deviation of an edge about the outline, in pixels of the working image.
        temper: the exponent of the product over the normals.
    """

    points: FloatArray
    normals: FloatArray
    search: int
    sigma: float
    temper: float

    @cached_property
    def cost(self) -> FloatArray:
        """``(search + 2,)``: the log-likelihood of a normal by its edge's distance; last, that of no edge."""
        distances = np.arange(self.search + 2).clip(max=self.search)
        return readonly(-self.temper * 0.5 * np.square(distances / self.sigma))

    def log_likelihood(self, transforms: FloatArray, edges: EdgeMap) -> FloatArray:
        """``(N,)``: for outlines put by ``transforms (N, 2, 3)`` into the image of these ``edges``."""
        return scan_contours(edges, pixel_centred(transforms), self.points, self.normals, self.cost)

    def edge_offsets(self, transforms: FloatArray, edges: EdgeMap) -> NDArray[np.int64]:
        """``(N, L)``: where along each normal the nearest edge lies, in working pixels, outward positive.

        ``search + 1`` where there is none.
        """
        return scan_offsets_numpy(edges, pixel_centred(transforms), self.points, self.normals, self.search)

    def with_noise(self, factor: float) -> ContourLikelihood:
        return replace(self, sigma=self.sigma * factor)


@dataclass(frozen=True)
class ColourLikelihood:
    """Inside the outline the object's colours are expected, just outside it the background's.

    The log-ratio of the two colour models is averaged over points inside and over points just outside; the
    log- likelihood is ``strength`` times the difference. Neighbouring pixels tell the same, so ``strength``
    stands for how many of them count as independent. Beyond the frame's border nothing is known, and the
    ratio is zero.

    Attributes:
        points: ``(M, 2)``, about the outline's centre, in frame pixels.
        weights: ``(M,)``, positive inside (sum 1), negative outside (sum -1).
        strength: how many independent pixels the regions count as.
    """

    points: FloatArray
    weights: FloatArray
    strength: float

    @classmethod
    def around(cls, contour: Contour, strength: float, inside: int = 48, band: float = 0.15) -> ColourLikelihood:
        """Points spread evenly inside ``contour``, and one outside each of its normals.

        ``band`` is how far outside, relative to the contour's size.
        """
        interior = _interior_points(contour, inside, 0.5 * band * contour.size)
        rim = contour.points - band * contour.size * contour.normals * 0.7
        interior = np.vstack([interior, rim])
        exterior = contour.points + band * contour.size * contour.normals
        weights = np.concatenate(
            [np.full(len(interior), 1 / len(interior)), np.full(len(exterior), -1 / len(exterior))]
        )
        return cls(readonly(np.vstack([interior, exterior])), readonly(weights), strength)

    def log_likelihood(self, transforms: FloatArray, ratio: NDArray[np.uint8]) -> FloatArray:
        """``(N,)``: for outlines put by ``transforms (N, 2, 3)`` into the image of the colour ``ratio (h,
        w)``.

        ``ratio`` must have a margin of one pixel of the code for zero on every side.
        """
        sums = weighted_sums(ratio, _in_margin(transforms), self.points, self.weights)
        return self.strength / CODE_STEPS * (sums - CODE_ZERO * self.weights.sum())

    def with_noise(self, factor: float) -> ColourLikelihood:
        return replace(self, strength=self.strength / factor**2)


@dataclass(frozen=True)
class HistogramLikelihood:
    """The colour likelihood of Pérez et al. (2002): colour histograms of the object's regions, compared as wholes.

    ``p(y | x) ∝ exp(-strength D^2)`` with ``D^2 = 1 - sum_b sqrt(q*_b q_b(x))``, the Bhattacharyya distance between a
    region's histogram where the hypothesis puts it and that learnt, averaged over the regions. Two halves of the object
    tell which way it is turned, which one histogram cannot. The histograms are those of points spread evenly over the
    region, so that a large object costs no more than a small one; what is outside the frame is like nothing.

    Attributes:
        points: ``(M, 2)``, about the outline's centre, in frame pixels, region by region.
        starts: ``(R + 1,)``, where in ``points`` each region starts; last, M.
        references: ``(R, B)``, the histograms learnt.
        strength: the lambda above.
    """

    points: FloatArray
    starts: NDArray[np.int64]
    references: FloatArray
    strength: float

    @classmethod
    def learn(
        cls, contour: Contour, bins: NDArray[np.uint8], transform: FloatArray, strength: float, points: int = 128
    ) -> HistogramLikelihood:
        """From the ``bins (h + 2, w + 2)`` of an image where ``transform (2, 3)`` puts the ``contour``.

        The regions are the halves of the object on either side of the middle of its longer axis.
        """
        interior = _interior_points(contour, points, 0.02 * contour.size)
        along = interior @ np.linalg.svd(interior, full_matrices=False)[2][0]
        halves = [part for part in (interior[along < 0.0], interior[along >= 0.0]) if len(part)]
        starts = np.cumsum([0, *(len(part) for part in halves)])
        ordered = np.vstack(halves)
        values = patch_values(bins, _in_margin(transform[None])[0], ordered)
        regions = [values[a:b] for a, b in pairwise(starts)]
        references = [np.bincount(region, minlength=256)[:HSV_BINS] / len(region) for region in regions]
        return cls(readonly(ordered), starts.astype(np.int64), readonly(np.array(references)), strength)

    def squared_distance(self, transforms: FloatArray, bins: NDArray[np.uint8]) -> FloatArray:
        """``(N,)``: D^2 for outlines put by ``transforms (N, 2, 3)`` into the image of these ``bins (h + 2, w + 2)``.

        ``bins`` must have a margin of one pixel of ``NO_BIN`` on every side.
        """
        return 1.0 - region_affinities(bins, _in_margin(transforms), self.points, self.starts, self.references)

    def log_likelihood(self, transforms: FloatArray, bins: NDArray[np.uint8]) -> FloatArray:
        """``(N,)``: minus ``strength`` times the squared distance; arguments as there."""
        return -self.strength * self.squared_distance(transforms, bins)

    def with_noise(self, factor: float) -> HistogramLikelihood:
        return replace(self, strength=self.strength / factor**2)


@dataclass(frozen=True)
class MotionLikelihood:
    """The implicit motion of Odobez et al. (2006): from frame to frame an object keeps its look.

    ``p(y_t | x_t, y_{t-1}, x_{t-1}) ∝ exp(-strength (1 - c))``, where c is the normalised correlation of the grey patch
    that the hypothesis covers with that covered in the frame before. The lecture takes the particle's own history for
    x_{t-1}; here it is the estimate of the frame before, the same for all, so that the likelihood remains a function of
    the innovation alone (Assumption D), which history sampling needs.

    Attributes:
        points: ``(M, 2)``, about the outline's centre, in frame pixels.
        strength: the lambda above.
    """

    points: FloatArray
    strength: float

    @classmethod
    def around(cls, contour: Contour, strength: float, points: int = 144) -> MotionLikelihood:
        """Points spread evenly inside ``contour``."""
        return cls(readonly(_interior_points(contour, points, 0.05 * contour.size)), strength)

    def patch(self, transform: FloatArray, grey: NDArray[np.uint8]) -> FloatArray:
        """``(M,)``: what the outline covers, put by ``transform (2, 3)`` into the image ``grey (h, w)``; normalised."""
        return readonly(normalised(patch_values(grey, transform, self.points)))

    def log_likelihood(self, transforms: FloatArray, grey: NDArray[np.uint8], before: FloatArray) -> FloatArray:
        """``(N,)``: for outlines put by ``transforms (N, 2, 3)`` into the image ``grey (h, w)``.

        ``before (M,)`` is the patch of the frame before.
        """
        return -self.strength * (1.0 - patch_correlations(grey, transforms, self.points, before))

    def with_noise(self, factor: float) -> MotionLikelihood:
        return replace(self, strength=self.strength / factor**2)


def _in_margin(transforms: FloatArray) -> FloatArray:
    """``(N, 2, 3)``: the same transforms into an image with a margin of one pixel."""
    moved = np.array(transforms)
    moved[:, :, 2] += 1.0
    return moved


def _interior_points(contour: Contour, count: int, margin: float) -> FloatArray:
    """About ``count`` points of a square lattice that lie at least ``margin`` inside ``contour``."""
    outline = contour.outline().astype(np.float32)
    spacing = contour.size / np.sqrt(count)
    low, high = outline.min(axis=0), outline.max(axis=0)
    axes = [np.arange(a + spacing / 2, b, spacing) for a, b in zip(low, high, strict=True)]
    lattice = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    depth = [cv2.pointPolygonTest(outline, (float(x), float(y)), True) for x, y in lattice]
    inside = lattice[np.array(depth) >= margin]
    return inside if len(inside) else np.zeros((1, 2))
