"""Gradients of an image of two channels, pixel by pixel that of the channel where it is steeper."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pfviz.kernels.arrays import checked
from pfviz.kernels.backend import compiled

Gradient = NDArray[np.int16]


def steepest(dx: ArrayLike, dy: ArrayLike) -> tuple[Gradient, Gradient]:
    """``(H, W)`` each: the horizontal and vertical derivative in the channel whose gradient is longer; of two equally
    long ones, the first.

    Args:
        dx: ``(H, W, 2)`` int16, horizontal derivatives of two channels.
        dy: ``(H, W, 2)`` int16, vertical ones.

    Raises:
        ValueError: if shapes disagree.
    """
    kernels = compiled()
    if kernels is None:
        return steepest_numpy(dx, dy)
    across, down = _checked(dx, dy)
    strongest = np.empty(across.shape[:2], np.int16), np.empty(across.shape[:2], np.int16)
    kernels.steepest(across, down, *strongest)
    return strongest


def steepest_numpy(dx: ArrayLike, dy: ArrayLike) -> tuple[Gradient, Gradient]:
    """As ``steepest``, in plain NumPy."""
    across, down = _checked(dx, dy)
    squares = np.square(across, dtype=np.int64) + np.square(down, dtype=np.int64)
    second = squares[..., 1] > squares[..., 0]
    return np.where(second, across[..., 1], across[..., 0]), np.where(second, down[..., 1], down[..., 0])


def _checked(dx: ArrayLike, dy: ArrayLike) -> tuple[Gradient, Gradient]:
    across = checked("dx", dx, (None, None, 2), np.int16)
    return across, checked("dy", dy, across.shape, np.int16)
