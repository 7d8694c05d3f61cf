"""Measurements of the region inside an outline, at points that move with it.

Point q of particle n lies in the pixel that holds ``A q + b``; what is outside of the image counts as the nearest pixel
of its border, so an image with a margin of a neutral value has that value all around. The cost is that of the points:
it does not depend on how many pixels the region covers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pfviz.kernels.arrays import checked
from pfviz.kernels.backend import compiled

FloatArray = NDArray[np.float64]

NO_BIN = 255


def weighted_sums(image: ArrayLike, transforms: ArrayLike, points: ArrayLike, weights: ArrayLike) -> FloatArray:
    """``(N,)``: for each particle the weighted sum of the pixels under its points.

    Args:
        image: ``(H, W)`` uint8.
        transforms: ``(N, 2, 3)``, [A | b] of each particle, in pixels; the first pixel covers 0 to 1.
        points: ``(M, 2)``, in the outline's own coordinates.
        weights: ``(M,)``.

    Raises:
        ValueError: if shapes disagree.
    """
    kernels = compiled()
    if kernels is None:
        return weighted_sums_numpy(image, transforms, points, weights)
    pixels, matrices, q = _checked(image, transforms, points)
    sums = np.empty(len(matrices))
    kernels.weighted_sums(pixels, matrices, q, checked("weights", weights, (len(q),)), sums)
    return sums


def weighted_sums_numpy(image: ArrayLike, transforms: ArrayLike, points: ArrayLike, weights: ArrayLike) -> FloatArray:
    """As ``weighted_sums``, in plain NumPy."""
    pixels, matrices, q = _checked(image, transforms, points)
    return _values(pixels, matrices, q).astype(float) @ checked("weights", weights, (len(q),))


def region_affinities(
    bins: ArrayLike, transforms: ArrayLike, points: ArrayLike, starts: ArrayLike, references: ArrayLike
) -> FloatArray:
    """``(N,)``: how alike the histograms of a particle's regions and the reference histograms are, from 0 to 1.

    The Bhattacharyya coefficient ``sum_b sqrt(q_b q*_b)``, averaged over the regions.

    Args:
        bins: ``(H, W)`` uint8, the bin that each pixel's colour falls into; ``NO_BIN`` for one that belongs to none,
            which is like nothing.
        transforms: ``(N, 2, 3)``, [A | b] of each particle, in pixels; the first pixel covers 0 to 1.
        points: ``(M, 2)``, in the outline's own coordinates, region by region.
        starts: ``(R + 1,)``, where in ``points`` each region starts; last, M.
        references: ``(R, B)``, the histogram of each region, summing to one at the most; B at most 255.

    Raises:
        ValueError: if shapes disagree, a region is empty or a reference is negative.
    """
    kernels = compiled()
    if kernels is None:
        return region_affinities_numpy(bins, transforms, points, starts, references)
    pixels, matrices, q = _checked(bins, transforms, points)
    edges, roots = _checked_regions(starts, references, len(q))
    affinities = np.empty(len(matrices))
    kernels.region_affinities(pixels, matrices, q, edges, roots, affinities)
    return affinities


def region_affinities_numpy(
    bins: ArrayLike, transforms: ArrayLike, points: ArrayLike, starts: ArrayLike, references: ArrayLike
) -> FloatArray:
    """As ``region_affinities``, in plain NumPy."""
    pixels, matrices, q = _checked(bins, transforms, points)
    edges, roots = _checked_regions(starts, references, len(q))
    values = _values(pixels, matrices, q)
    total = np.zeros(len(matrices))
    for start, stop, root in zip(edges[:-1], edges[1:], roots, strict=True):
        part = values[:, start:stop] + 256 * np.arange(len(matrices))[:, None]
        histograms = np.bincount(part.ravel(), minlength=256 * len(matrices)).reshape(-1, 256)
        total += np.sqrt(histograms[:, : len(root)] / (stop - start)) @ root
    return total / len(roots)


def patch_correlations(image: ArrayLike, transforms: ArrayLike, points: ArrayLike, template: ArrayLike) -> FloatArray:
    """``(N,)``: the normalised correlation coefficient of the pixels under a particle's points with a template.

    Args:
        image: ``(H, W)`` uint8.
        transforms: ``(N, 2, 3)``, [A | b] of each particle, in pixels; the first pixel covers 0 to 1.
        points: ``(M, 2)``, in the outline's own coordinates.
        template: ``(M,)``, what the pixels are compared with; of zero mean and unit length (see ``normalised``).

    Returns:
        Between -1 and 1; 0 where all the pixels are equal.

    Raises:
        ValueError: if shapes disagree.
    """
    kernels = compiled()
    if kernels is None:
        return patch_correlations_numpy(image, transforms, points, template)
    pixels, matrices, q = _checked(image, transforms, points)
    correlations = np.empty(len(matrices))
    kernels.patch_correlations(pixels, matrices, q, checked("template", template, (len(q),)), correlations)
    return correlations


def patch_correlations_numpy(
    image: ArrayLike, transforms: ArrayLike, points: ArrayLike, template: ArrayLike
) -> FloatArray:
    """As ``patch_correlations``, in plain NumPy."""
    pixels, matrices, q = _checked(image, transforms, points)
    values = _values(pixels, matrices, q).astype(float)
    centred = values - values.mean(axis=1, keepdims=True)
    length = np.sqrt(np.sum(centred**2, axis=1))
    product = centred @ checked("template", template, (len(q),))
    return np.divide(product, length, out=np.zeros(len(values)), where=length**2 > 0.5)


def patch_values(image: ArrayLike, transform: ArrayLike, points: ArrayLike) -> NDArray[np.uint8]:
    """``(M,)``: the pixels under ``points (M, 2)``, put into the ``image (H, W)`` by one ``transform (2, 3)``."""
    pixels, matrices, q = _checked(image, np.asarray(transform)[None], points)
    return _values(pixels, matrices, q)[0]


def normalised(values: ArrayLike) -> FloatArray:
    """``(M,)``: the ``values (M,)`` with zero mean and unit length; zeros where they are all equal."""
    plain = np.asarray(values, dtype=float)
    centred = plain - plain.mean()
    length = np.linalg.norm(centred)
    return centred / length if length > 0.0 else centred


def _checked(image: ArrayLike, transforms: ArrayLike, points: ArrayLike) -> tuple[NDArray, FloatArray, FloatArray]:
    pixels = checked("image", image, (None, None), np.uint8)
    if pixels.size == 0:
        raise ValueError(f"image must have pixels, got shape {pixels.shape}")
    return pixels, checked("transforms", transforms, (None, 2, 3)), checked("points", points, (None, 2))


def _checked_regions(starts: ArrayLike, references: ArrayLike, count: int) -> tuple[NDArray[np.int64], FloatArray]:
    roots = checked("references", references, (None, None))
    if roots.shape[1] > NO_BIN or not (roots >= 0.0).all():
        raise ValueError(f"references must be at most {NO_BIN} numbers of at least 0 a region, got {roots.shape}")
    edges = checked("starts", starts, (len(roots) + 1,), np.int64)
    if edges[0] != 0 or edges[-1] != count or not (np.diff(edges) > 0).all():
        raise ValueError(f"starts must rise from 0 to {count}, got {edges.tolist()}")
    return edges, checked("references", np.sqrt(roots), (None, None))


def _values(pixels: NDArray, matrices: FloatArray, points: FloatArray) -> NDArray[np.uint8]:
    """``(N, M)``: the pixel under every point."""
    height, width = pixels.shape
    (a, b, c), (d, e, f) = matrices.transpose(1, 2, 0)[..., None]
    x, y = points.T
    with np.errstate(all="ignore"):
        columns = np.clip(np.nan_to_num(a * x + b * y + c, nan=0.0), 0, width - 1).astype(np.intp)
        rows = np.clip(np.nan_to_num(d * x + e * y + f, nan=0.0), 0, height - 1).astype(np.intp)
    return pixels.ravel().take(rows * width + columns)
