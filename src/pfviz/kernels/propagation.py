"""Propagation: one step of an autoregression for every particle, with normals from a generator of its own.

The generator is *counter-based*: a normal is a function of the seed, the particle's index and the component
alone, so that order, threads and vector width do not matter, and NumPy can compute the very same stream.
Random bits are the counter times a Weyl constant, mixed by the finaliser of SplitMix64 (Steele, Lea & Flood
2014) and by one more round under a second key; normals come in pairs by Box & Muller (1958), with 53 bits in
the radius and 53 in the angle.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pfviz.kernels.arrays import checked, frozen
from pfviz.kernels.backend import compiled

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
UIntArray = NDArray[np.uint64]

# As in the compiled module: particles are served in blocks, the first half of a block by the cosines of its
# pairs.
_NORMALS_BLOCK = 256
_WEYL = np.uint64(0x9E3779B97F4A7C15)
_MIX1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX2 = np.uint64(0x94D049BB133111EB)
_MIX3 = np.uint64(0xD6E8FEB86659FD93)
_SECOND_KEY = 0xA0761D6478BD642F

_ALL_BITS = 2**64 - 1

_EVERYONE = frozen(np.empty(0, dtype=np.int64))


def propagate(
    states: ArrayLike,
    ancestors: ArrayLike | None,
    coefficients: ArrayLike,
    mean: ArrayLike,
    cholesky: ArrayLike,
    seed: int,
) -> FloatArray:
    """Draw the next state of each particle: x1' = mean + sum_j A_j (x_j - mean) + L z, over the shifted
    history.

    Args:
        states: ``(N, p, k)``, newest block first.
        ancestors: ``(M,)``, which state each new one continues; None for every one its own.
        coefficients: ``(p, k, k)``, A_1 ... A_p.
        mean: ``(k,)``.
        cholesky: ``(k, k)``, L with the noise covariance ``L L^T``.
        seed: from 0 to 2**64 - 1. Equal seeds give equal bytes on one backend and machine, and equal values
            but for the last digits elsewhere.

    Returns:
        ``(M, p, k)`` (M = N without ancestors).

    Raises:
        ValueError: if shapes disagree, an ancestor does not exist, or the seed is out of range.
    """
    x, parents, a, mu, factor = _checked_model(states, ancestors, coefficients, mean, cholesky)
    keys = _keys(seed)
    kernels = compiled()
    if kernels is None:
        count = len(x) if parents is None else len(parents)
        return _advance(x, parents, a, mu, factor, standard_normals_numpy(seed, count, x.shape[2]))
    n, p, k = x.shape
    result = np.empty((n if parents is None else len(parents), p * k))
    kernels.propagate(
        x.reshape(n, p * k),
        _EVERYONE if parents is None else parents,
        frozen(np.ascontiguousarray(a.transpose(1, 0, 2).reshape(k, p * k))),
        frozen(mu - a.sum(axis=0) @ mu),
        factor,
        *keys,
        result,
    )
    return result.reshape(-1, p, k)


def propagate_numpy(
    states: ArrayLike,
    ancestors: ArrayLike | None,
    coefficients: ArrayLike,
    mean: ArrayLike,
    cholesky: ArrayLike,
    seed: int,
) -> FloatArray:
    """As ``propagate``, in plain NumPy."""
    x, parents, a, mu, factor = _checked_model(states, ancestors, coefficients, mean, cholesky)
    count = len(x) if parents is None else len(parents)
    return _advance(x, parents, a, mu, factor, standard_normals_numpy(seed, count, x.shape[2]))


def standard_normals_numpy(seed: int, count: int, dimension: int) -> FloatArray:
    """``(count, dimension)``: the standard normals z that ``propagate`` uses, particle by particle."""
    blocks, half = -(-count // _NORMALS_BLOCK), _NORMALS_BLOCK // 2
    counters = np.arange(blocks * dimension * half, dtype=np.uint64) * np.uint64(2)
    keys = _keys(seed)
    radius_bits, angle_bits = _random_bits(counters, *keys), _random_bits(counters + np.uint64(1), *keys)
    radius = np.sqrt(-2.0 * np.log(((radius_bits >> np.uint64(12)) + 0.5) * 2.0**-52))
    angle = 2.0 * np.pi * ((angle_bits >> np.uint64(12)) * 2.0**-53 - 0.25)
    side = np.where(angle_bits & np.uint64(1), 1.0, -1.0)
    pairs = np.stack([side * radius * np.cos(angle), radius * np.sin(angle)])
    in_blocks = pairs.reshape(2, blocks, dimension, half).transpose(1, 0, 3, 2)
    return np.ascontiguousarray(in_blocks.reshape(-1, dimension)[:count])


def _keys(seed: int) -> tuple[np.uint64, np.uint64]:
    """Two keys that differ in half of their bits between any two seeds."""
    if not 0 <= seed < 2**64:
        raise ValueError(f"seed must be from 0 to 2**64 - 1, got {seed}")
    return np.uint64(_mix(int(seed))), np.uint64(_mix(int(seed) + _SECOND_KEY))


def _mix(value: int) -> int:
    """The finaliser of SplitMix64."""
    h = value & _ALL_BITS
    h = (h ^ (h >> 30)) * 0xBF58476D1CE4E5B9 & _ALL_BITS
    h = (h ^ (h >> 27)) * 0x94D049BB133111EB & _ALL_BITS
    return h ^ (h >> 31)


def _random_bits(counters: UIntArray, key0: np.uint64, key1: np.uint64) -> UIntArray:
    h = counters * _WEYL + key0
    h = (h ^ (h >> np.uint64(30))) * _MIX1
    h = (h ^ (h >> np.uint64(27))) * _MIX2
    h = ((h ^ (h >> np.uint64(31))) ^ key1) * _MIX3
    return h ^ (h >> np.uint64(32))


def _advance(
    states: FloatArray,
    ancestors: IntArray | None,
    coefficients: FloatArray,
    mean: FloatArray,
    factor: FloatArray,
    normals: FloatArray,
) -> FloatArray:
    """The deterministic part of ``propagate``, given its normals ``(M, k)``."""
    parents = states if ancestors is None else states[ancestors]
    k = len(mean)
    side_by_side = coefficients.transpose(0, 2, 1).reshape(-1, k)
    innovation = mean + (parents - mean).reshape(len(parents), -1) @ side_by_side + normals @ factor.T
    return np.concatenate([innovation[:, None], parents[:, :-1]], axis=1)


def _checked_model(
    states: ArrayLike,
    ancestors: ArrayLike | None,
    coefficients: ArrayLike,
    mean: ArrayLike,
    cholesky: ArrayLike,
) -> tuple[FloatArray, IntArray | None, FloatArray, FloatArray, FloatArray]:
    x = checked("states", states, (None, None, None))
    n, p, k = x.shape
    if x.size == 0:
        raise ValueError(f"states must have shape (N, p, k), none of them zero, got {x.shape}")
    a = checked("coefficients", coefficients, (p, k, k))
    mu, factor = checked("mean", mean, (k,)), checked("cholesky", cholesky, (k, k))
    if ancestors is None:
        return x, None, a, mu, factor
    parents = checked("ancestors", ancestors, (None,), np.int64)
    if len(parents) and parents.view(np.uint64).max() >= n:  # a negative one is larger than any N
        raise ValueError(f"ancestors must be from 0 to {n - 1}, got {parents.min()} to {parents.max()}")
    return x, parents, a, mu, factor
