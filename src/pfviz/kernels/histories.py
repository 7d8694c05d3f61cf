"""History sampling: the mixture density of innovations over histories, and a history drawn for each
innovation.

``log S_i = log sum_l w_l N(u_i; m_l, covariance)`` and ``I_i ~ w_l N(u_i; m_l, covariance)``, the two N x N
operations of RB-HS-SIR (Table 3 of Torma & Szepesvari). Both come from one pass over the pairs that stores
none of them. Coordinates are centred and whitened, and constants folded into base-2 exponents.

The compiled kernel takes the innovations cell by cell. Most histories lie too far from a cell, or weigh too little, to
matter anywhere in it, and are left out for the whole cell. About its centre the squared distance is expanded,
``-|z - u|^2 = -|z|^2 + 2 z.u - |u|^2``: the first part is computed once a cell in double precision, the last once a
row, so that a pair costs two products and a polynomial, and single precision is enough even where the nearest history
is far away.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from threading import Thread
from types import ModuleType
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pfviz.kernels.arrays import frozen
from pfviz.kernels.backend import compiled
from pfviz.kernels.weights import checked_peak

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Precision = Literal["float32", "float64"]

_LOG_2 = math.log(2.0)

# Histories that fall short of the largest term by so many powers of two are left out of a row: a million of them would
# change its logarithm by 1e-6 in single precision, by less than rounding does in double precision.
_CUTOFF = {"float32": 40.0, "float64": 72.0}
# Single precision is used where its rounding cannot change a logarithm by 1e-4: in units of 2**-24 log 2.
_TOLERANCE = {"float32": 2000.0, "float64": -1.0}

_PAIRS_PER_CHUNK = 1 << 18
_PAIRS_WORTH_A_THREAD = 1_000_000


def sample_histories(
    innovations: ArrayLike,
    means: ArrayLike,
    log_weights: ArrayLike,
    covariance: ArrayLike,
    uniforms: ArrayLike,
    precision: Precision = "float32",
    threads: int = 1,
) -> tuple[FloatArray, IntArray]:
    """Mixture density at each innovation, and for each one draw of a history in proportion to its share of
    it.

    The draw inverts the cumulative shares, in the order of the histories, at ``uniforms[i]``. A history of
    weight zero is never drawn. Where an innovation is so far out that even the logarithm of its density
    overflows, the result is minus infinity and the history is drawn from the weights alone.

    Args:
        innovations: ``(M, d)``, u.
        means: ``(N, d)``, of p(u | x_l) for each history.
        log_weights: ``(N,)``; minus infinity is a weight of zero. They need not be normalised.
        covariance: ``(d, d)``, common to all histories.
        uniforms: ``(M,)``, in [0, 1).
        precision: of the pairwise terms. In single precision the log-density is within 1e-4 of that in double
            precision; innovations for which this could not be kept are done in double precision.
        threads: among which to share the rows where there are many; the results do not depend on it.

    Returns:
        ``log_mixture (M,)`` and ``ancestors (M,)``, indices into ``means``.

    Raises:
        ValueError: if shapes disagree, values are not finite, all weights are zero, the covariance is not
            positive definite, or a uniform lies outside [0, 1).
    """
    problem = _prepare(innovations, means, log_weights, covariance, precision)
    log_mixture, ancestors = _sample(problem, _checked_uniforms(uniforms, problem.count), precision, threads)
    return log_mixture, problem.original(ancestors)


def sample_histories_numpy(
    innovations: ArrayLike,
    means: ArrayLike,
    log_weights: ArrayLike,
    covariance: ArrayLike,
    uniforms: ArrayLike,
    precision: Precision = "float64",
    threads: int = 1,
) -> tuple[FloatArray, IntArray]:
    """As ``sample_histories``, in plain NumPy, always in double precision and one thread."""
    problem = _prepare(innovations, means, log_weights, covariance, precision)
    log_mixture, ancestors = _sample_numpy(problem, _checked_uniforms(uniforms, problem.count))
    return log_mixture, problem.original(ancestors)


def log_mixture_density(
    innovations: ArrayLike,
    means: ArrayLike,
    log_weights: ArrayLike,
    covariance: ArrayLike,
    precision: Precision = "float32",
    threads: int = 1,
) -> FloatArray:
    """``(M,)``: the log-density part of ``sample_histories``; arguments and errors as there."""
    problem = _prepare(innovations, means, log_weights, covariance, precision)
    return _sample(problem, np.empty(0), precision, threads)[0]


def log_mixture_density_numpy(
    innovations: ArrayLike,
    means: ArrayLike,
    log_weights: ArrayLike,
    covariance: ArrayLike,
    precision: Precision = "float64",
    threads: int = 1,
) -> FloatArray:
    """As ``log_mixture_density``, in plain NumPy, always in double precision and one thread."""
    problem = _prepare(innovations, means, log_weights, covariance, precision)
    return _sample_numpy(problem, np.empty(0))[0]


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    """Histories of positive weight, and innovations, in coordinates where ``term = 2**(base - |z - u|^2)``.

    Attributes:
        innovations: ``(d, M)``.
        histories: ``(d, L)``.
        base: ``(L,)``, base-2 logarithms of the weights relative to the largest.
        log_scale: what to add to the natural logarithm of a sum of terms.
        positive: ``(L,)`` indices of the histories in the caller's arrays, or None where that is all of them.
    """

    innovations: FloatArray
    histories: FloatArray
    base: FloatArray
    log_scale: float
    positive: IntArray | None

    @property
    def count(self) -> int:
        """M, the number of innovations."""
        return self.innovations.shape[1]

    def rows(self, chosen: IntArray) -> _Problem:
        return replace(self, innovations=self.innovations[:, chosen])

    def original(self, ancestors: IntArray) -> IntArray:
        return ancestors if self.positive is None else self.positive[ancestors]


def _prepare(
    innovations: ArrayLike,
    means: ArrayLike,
    log_weights: ArrayLike,
    covariance: ArrayLike,
    precision: str,
) -> _Problem:
    if precision not in get_args(Precision):
        raise ValueError(f"precision must be 'float32' or 'float64', got {precision!r}")
    u, m, lw, c = (np.asarray(a, dtype=np.float64) for a in (innovations, means, log_weights, covariance))
    _check_shapes(u, m, lw, c)
    heaviest = checked_peak(lw)
    inverse_factor, log_determinant = _inverse_cholesky(c.tobytes(), len(c))
    positive = None
    if np.isneginf(lw.min()):
        positive = np.flatnonzero(lw > -np.inf)
        m, lw = m[positive], lw[positive]
    with np.errstate(over="ignore", invalid="ignore"):
        columns = np.ascontiguousarray(m.T)
        centre = columns.mean(axis=1, keepdims=True)
        to_base_2 = inverse_factor * math.sqrt(0.5 / _LOG_2)
        histories = to_base_2 @ (columns - centre)
        whitened = to_base_2 @ (np.ascontiguousarray(u.T) - centre)
    log_scale = heaviest - 0.5 * (u.shape[1] * math.log(2.0 * math.pi) + log_determinant)
    return _Problem(whitened, histories, (lw - heaviest) / _LOG_2, log_scale, positive)


def _check_shapes(u: FloatArray, m: FloatArray, lw: FloatArray, c: FloatArray) -> None:
    if u.ndim != 2 or u.shape[1] == 0:
        raise ValueError(f"innovations must have shape (M, d) with d >= 1, got {u.shape}")
    d = u.shape[1]
    if m.ndim != 2 or m.shape[0] == 0 or m.shape[1] != d:
        raise ValueError(f"means must have shape (N, {d}) with N >= 1, got {m.shape}")
    if lw.shape != m.shape[:1]:
        raise ValueError(f"log_weights must have shape {m.shape[:1]}, got {lw.shape}")
    if c.shape != (d, d):
        raise ValueError(f"covariance must have shape {(d, d)}, got {c.shape}")
    for name, values in (("innovations", u), ("means", m), ("covariance", c)):
        if not np.isfinite(values).all():
            raise ValueError(f"{name} must be finite, got NaN or infinity")


@lru_cache(maxsize=64)
def _inverse_cholesky(values: bytes, d: int) -> tuple[NDArray[np.floating], float]:
    """The inverse of the Cholesky factor, and the log-determinant of the ``(d, d)`` covariance of these ``values``."""
    covariance = np.frombuffer(values).reshape(d, d)
    try:
        factor = np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        raise ValueError(f"covariance must be positive definite, got {covariance.tolist()}") from None
    if np.abs(covariance - covariance.T).max() > 1e-8 * np.abs(covariance).max():
        raise ValueError(f"covariance must be symmetric, got {covariance.tolist()}")
    return np.linalg.inv(factor), 2.0 * float(np.log(np.diagonal(factor)).sum())


def _checked_uniforms(uniforms: ArrayLike, count: int) -> FloatArray:
    array = np.ascontiguousarray(uniforms, dtype=np.float64)
    if array.shape != (count,):
        raise ValueError(f"uniforms must have shape ({count},), got {array.shape}")
    if count and not (array.min() >= 0.0 and array.max() < 1.0):
        raise ValueError(f"uniforms must lie in [0, 1), got values from {array.min()} to {array.max()}")
    return array


def _sample(problem: _Problem, uniforms: FloatArray, precision: str, threads: int) -> tuple[FloatArray, IntArray]:
    """Log-densities, and draws among the problem's own histories; no draws without uniforms."""
    kernels = compiled()
    if kernels is None:
        return _sample_numpy(problem, uniforms)
    return _sample_compiled(kernels, problem, uniforms, precision, threads)


def _invert(shares: FloatArray, uniforms: FloatArray) -> IntArray:
    """For each row of ``shares (M, L)`` the first l whose running sum exceeds the uniform's part of the
    total."""
    running = np.cumsum(shares, axis=1)
    return (running <= uniforms[:, None] * running[:, -1:]).sum(axis=1)


def _sample_numpy(problem: _Problem, uniforms: FloatArray) -> tuple[FloatArray, IntArray]:
    """Row by row with log-sum-exp, in chunks of rows that keep memory bounded."""
    count = problem.count
    log_mixture, ancestors = np.empty(count), np.zeros(count, dtype=np.int64)
    rows = max(1, _PAIRS_PER_CHUNK // len(problem.base))
    for start in range(0, count, rows):
        chunk = slice(start, start + rows)
        with np.errstate(over="ignore", invalid="ignore"):
            distances = problem.innovations[:, chunk, None] - problem.histories[:, None, :]
            exponents = problem.base - (distances * distances).sum(axis=0)
        peaks = exponents.max(axis=1)
        hopeless = ~(peaks > -np.inf)
        exponents[hopeless] = problem.base
        shares = np.exp2(exponents - np.where(hopeless, 0.0, peaks)[:, None])
        log_mixture[chunk] = np.log(shares.sum(axis=1)) + peaks * _LOG_2 + problem.log_scale
        log_mixture[chunk][hopeless] = -np.inf
        if len(uniforms):
            ancestors[chunk] = _invert(shares, uniforms[chunk])
    return log_mixture, ancestors


def _sample_compiled(
    kernels: ModuleType, problem: _Problem, uniforms: FloatArray, precision: str, threads: int
) -> tuple[FloatArray, IntArray]:
    """By the compiled kernel, cell by cell; the rows whose logarithms overflow by the twin."""
    count = problem.count
    innovations, histories = _in_two(problem.innovations), _in_two(problem.histories)
    base = frozen(problem.base)
    order, starts = np.empty(count, dtype=np.int64), np.empty(count + 1, dtype=np.int64)
    starts = starts[: kernels.group_rows(innovations, order, starts) + 1]
    logs, ancestors = np.empty(count), np.zeros(count, dtype=np.int64)

    def run(part: slice) -> None:
        groups = frozen(order), frozen(starts[part])
        limits = _CUTOFF[precision], _TOLERANCE[precision]
        kernels.sample_groups(histories, base, innovations, frozen(uniforms), *groups, *limits, logs, ancestors)

    _in_threads(run, starts, threads if count * len(base) >= _PAIRS_WORTH_A_THREAD else 1)
    log_mixture = logs * _LOG_2 + problem.log_scale
    lost = np.flatnonzero(~(logs > -np.inf) | (ancestors < 0))
    if len(lost):
        wanted = uniforms[lost] if len(uniforms) else uniforms
        log_mixture[lost], ancestors[lost] = _sample_numpy(problem.rows(lost), wanted)
    return log_mixture, ancestors


def _in_two(columns: FloatArray) -> FloatArray:
    """The ``columns (d, L)``, with a second coordinate of zero where there is only one."""
    return frozen(columns if len(columns) > 1 else np.concatenate([columns, np.zeros_like(columns)]))


def _in_threads(run: Callable[[slice], None], starts: IntArray, threads: int) -> None:
    """Call ``run`` with parts of the ``starts (G + 1,)`` of groups of about equally many rows, the last in this
    thread."""
    groups = len(starts) - 1
    shares = np.searchsorted(starts, [starts[-1] * i // threads for i in range(1, threads)])
    bounds = [0, *shares.tolist(), groups]
    parts = [slice(start, stop + 1) for start, stop in pairwise(bounds)]
    others = [Thread(target=run, args=(part,)) for part in parts[:-1]]
    for thread in others:
        thread.start()
    run(parts[-1])
    for thread in others:
        thread.join()
