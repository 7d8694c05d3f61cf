"""The contour scan: how far each hypothesis's contour is from the nearest edges, along its normals.

For particle n with the affine map ``x -> A x + b``, contour point p and normal m: P = A p + b and m' = A^-T m
/ |A^-T m|. The pixels ``round(P + s m')`` are looked at for s = 0, then +1 and -1, then +2 and -2, up to the
*reach* S; the first edge, at distance |s|, contributes ``cost[|s|]``, and a point without one contributes
``cost[S + 1]``. With costs that are log-likelihoods this is the measurement density of contour trackers
(Isard & Blake 1998, CONDENSATION).

Halves round up. Nothing outside of the image is an edge. A particle may be anywhere: one whose transform is
singular or not finite has the log-likelihood minus infinity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pfviz.kernels.arrays import checked, frozen
from pfviz.kernels.backend import compiled

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Positions are in fixed point with this many bits after the point, as in the compiled module.
_FRACTION_BITS = 32
_ONE = 2.0**_FRACTION_BITS


@dataclass(frozen=True, slots=True, eq=False)
class EdgeMap:
    """The edges of a frame, with a margin so wide that a scan within ``reach`` never leaves the array.

    Attributes:
        padded: ``(H + 2 margin, W + 2 margin)`` uint8, nonzero where there is an edge.
        reach: the largest S it can be scanned with.
    """

    padded: NDArray[np.uint8]
    reach: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "padded", checked("padded", self.padded, (None, None), np.uint8))

    @property
    def margin(self) -> int:
        return 2 * self.reach + 2


def pad_edges(edges: ArrayLike, reach: int) -> EdgeMap:
    """Prepare the edges of a frame for scans, once a frame.

    Args:
        edges: ``(H, W)``, nonzero where there is an edge.
        reach: S, how many pixels to look to either side of the contour.

    Raises:
        ValueError: if ``edges`` is not a non-empty image or ``reach`` is negative.
    """
    image = np.asarray(edges)
    if image.ndim != 2 or image.size == 0:
        raise ValueError(f"edges must have shape (H, W), got {image.shape}")
    if reach < 0:
        raise ValueError(f"reach must be at least 0, got {reach}")
    margin = 2 * reach + 2
    height, width = image.shape
    padded = np.zeros((height + 2 * margin, width + 2 * margin), dtype=np.uint8)
    padded[margin : margin + height, margin : margin + width] = image != 0
    return EdgeMap(padded, reach)


@dataclass(frozen=True, slots=True, eq=False)
class _Scan:
    edges: EdgeMap
    transforms: FloatArray
    points: FloatArray
    normals: FloatArray
    reach: int


def scan_contours(
    edges: EdgeMap | ArrayLike,
    transforms: ArrayLike,
    points: ArrayLike,
    normals: ArrayLike,
    cost: ArrayLike,
) -> FloatArray:
    """The log-likelihood of each particle's contour.

    Args:
        edges: an ``EdgeMap`` whose reach is at least S, or an ``(H, W)`` image.
        transforms: ``(N, 2, 3)``, [A | b] of each particle, in pixels.
        points: ``(L, 2)``, (x, y) on the contour, in its own coordinates.
        normals: ``(L, 2)``, across the contour there; of any length but zero.
        cost: ``(S + 2,)``, the log-likelihood of an edge at distance 0, 1, ..., S, and of none.

    Returns:
        ``(N,)``, the sum of ``cost`` over the contour's points.

    Raises:
        ValueError: if shapes disagree, a point or normal is not finite, a normal is zero or a cost is NaN.
    """
    costs = _checked_costs(cost)
    scan = _prepare(edges, transforms, points, normals, len(costs) - 2)
    kernels = compiled()
    if kernels is None:
        return _scan_numpy(scan, costs)
    result = np.empty(len(scan.transforms))
    kernels.scan_contours(
        scan.edges.padded,
        scan.edges.margin,
        scan.transforms,
        frozen(np.ascontiguousarray(scan.points.T)),
        frozen(np.ascontiguousarray(scan.normals.T)),
        costs,
        result,
    )
    return result


def scan_contours_numpy(
    edges: EdgeMap | ArrayLike,
    transforms: ArrayLike,
    points: ArrayLike,
    normals: ArrayLike,
    cost: ArrayLike,
) -> FloatArray:
    """As ``scan_contours``, in plain NumPy."""
    costs = _checked_costs(cost)
    return _scan_numpy(_prepare(edges, transforms, points, normals, len(costs) - 2), costs)


def scan_offsets_numpy(
    edges: EdgeMap | ArrayLike,
    transforms: ArrayLike,
    points: ArrayLike,
    normals: ArrayLike,
    reach: int,
) -> IntArray:
    """Where along each normal the nearest edge lies: for drawing search normals, and as an oracle.

    Arguments and errors as ``scan_contours``, with ``reach`` S in place of the costs.

    Returns:
        ``(N, L)``, the signed s of the edge, the positive one of two at equal distance; S + 1 where there is
        none, or where the transform is singular or not finite.
    """
    return _offsets(_prepare(edges, transforms, points, normals, reach))[0]


def _checked_costs(cost: ArrayLike) -> FloatArray:
    costs = checked("cost", cost, (None,))
    if len(costs) < 2 or np.isnan(costs).any():
        raise ValueError(f"cost must have shape (S + 2,) with S >= 0 and no NaN, got {costs.tolist()}")
    return costs


def _prepare(
    edges: EdgeMap | ArrayLike, transforms: ArrayLike, points: ArrayLike, normals: ArrayLike, reach: int
) -> _Scan:
    edge_map = edges if isinstance(edges, EdgeMap) else pad_edges(edges, reach)
    if edge_map.reach < reach:
        raise ValueError(f"edges were padded for a reach of {edge_map.reach}, but the reach is {reach}")
    p, m = checked("points", points, (None, 2)), checked("normals", normals, (None, 2))
    if p.shape != m.shape:
        raise ValueError(f"normals must have shape {p.shape} as points have, got {m.shape}")
    if not (np.isfinite(p).all() and np.isfinite(m).all() and m.any(axis=1).all()):
        raise ValueError("points must be finite, and normals finite and not zero")
    return _Scan(edge_map, checked("transforms", transforms, (None, 2, 3)), p, m, reach)


def _placed(scan: _Scan) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, NDArray[np.bool_]]:
    """``(N, L)`` positions in the padded map plus a half, unit normals, and which particles are sound
    ``(N,)``."""
    (a, b, c), (d, e, f) = scan.transforms.transpose(1, 2, 0)[..., None]
    shift = scan.edges.margin + 0.5
    determinant = a * e - b * d
    sign = np.where(determinant > 0.0, 1.0, -1.0)
    (px, py), (mx, my) = scan.points.T, scan.normals.T
    x, y = (a * px + b * py + c) + shift, (d * px + e * py + f) + shift
    p, q = sign * (e * mx - d * my), sign * (a * my - b * mx)
    length = np.sqrt(p * p + q * q)
    sound = (np.abs(x) < np.inf) & (np.abs(y) < np.inf) & (length > 0.0) & (length < np.inf)
    return x, y, p / length, q / length, sound.all(axis=1) & (np.abs(determinant[:, 0]) > 0.0)


def _offsets(scan: _Scan) -> tuple[IntArray, NDArray[np.bool_]]:
    """The signed offsets, and which particles are sound."""
    reach, margin = scan.reach, scan.edges.margin
    height, width = scan.edges.padded.shape
    with np.errstate(all="ignore"):
        x, y, p, q, sound = _placed(scan)
        near = (x >= margin - reach - 0.5) & (x <= width - margin + reach + 0.5)
        near &= (y >= margin - reach - 0.5) & (y <= height - margin + reach + 0.5) & sound[:, None]
    x, y, p, q = (np.where(near, v, 0.0) for v in (x, y, p, q))
    offsets = np.full(x.shape, reach + 1)
    open_ = near
    x, y, p, q = ((v * _ONE).astype(np.int64) for v in (x, y, p, q))
    for s in sorted(range(-reach, reach + 1), key=lambda s: (abs(s), -s)):
        hit = open_ & (scan.edges.padded[(y + s * q) >> _FRACTION_BITS, (x + s * p) >> _FRACTION_BITS] != 0)
        offsets[hit] = s
        open_ = open_ & ~hit
    return offsets, sound


def _scan_numpy(scan: _Scan, costs: FloatArray) -> FloatArray:
    offsets, sound = _offsets(scan)
    return np.where(sound, costs[np.abs(offsets)].sum(axis=1), -np.inf)
