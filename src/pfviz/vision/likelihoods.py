"""How well an outline fits a frame: edges found along its normals, and the colours on either side of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from pfviz.kernels import EdgeMap, scan_contours, scan_offsets_numpy, weighted_sums
from pfviz.particles import FloatArray, readonly
from pfviz.vision.colour import CODE_STEPS, CODE_ZERO
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

    @property
    def cost(self) -> FloatArray:
        """``(search + 2,)``: the log-likelihood of a normal by its edge's distance; last, that of no edge."""
        distances = np.arange(self.search + 2).clip(max=self.search)
        return -self.temper * 0.5 * np.square(distances / self.sigma)

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
        with_margin = np.array(transforms)
        with_margin[:, :, 2] += 1.0
        sums = weighted_sums(ratio, with_margin, self.points, self.weights)
        return self.strength / CODE_STEPS * (sums - CODE_ZERO * self.weights.sum())

    def with_noise(self, factor: float) -> ColourLikelihood:
        return replace(self, strength=self.strength / factor**2)


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
