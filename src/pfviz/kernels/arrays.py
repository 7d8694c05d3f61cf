"""What every kernel's caller does with its arguments."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Scalar = TypeVar("Scalar", bound=np.generic)


def frozen(array: NDArray[Scalar]) -> NDArray[Scalar]:
    """A read-only view. The compiled kernels have one signature each, and take what they read as
    read-only."""
    view = array.view()
    view.flags.writeable = False
    return view


def checked(name: str, values: ArrayLike, shape: tuple[int | None, ...], dtype: Any = np.float64) -> NDArray[Any]:
    """A C-contiguous, read-only array of the shape, where None stands for any length.

    Raises:
        ValueError: naming the argument, if it has another shape.
    """
    array = np.ascontiguousarray(values, dtype=dtype)
    if len(array.shape) != len(shape) or any(n is not None and n != m for n, m in zip(shape, array.shape, strict=True)):
        wanted = ", ".join("any" if n is None else str(n) for n in shape)
        raise ValueError(f"{name} must have shape ({wanted}), got {array.shape}")
    return frozen(array)
