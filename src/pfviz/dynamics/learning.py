"""Learning an autoregression from what was seen: maximum likelihood, as in Odobez' lecture and Blake & Isard 1998."""

from __future__ import annotations

import csv
import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pfviz.dynamics.autoregressive import Autoregression
from pfviz.particles import FloatArray


@dataclass(frozen=True)
class FittedDynamics:
    """Dynamics of largest likelihood, and how well they are known.

    Attributes:
        dynamics: the autoregression.
        standard_errors: ``(p, k, k)``, of its coefficients, by the usual asymptotics of least squares.
        log_likelihood: of the states given the first p of each sequence.
        transitions: how many were learnt from.
    """

    dynamics: Autoregression
    standard_errors: FloatArray
    log_likelihood: float
    transitions: int


def learn_dynamics(states: ArrayLike | Sequence[ArrayLike], order: int = 2, intercept: bool = True) -> Autoregression:
    """The autoregression under which ``states`` are most probable; arguments and errors as ``fit_dynamics``."""
    return fit_dynamics(states, order, intercept).dynamics


def fit_dynamics(states: ArrayLike | Sequence[ArrayLike], order: int = 2, intercept: bool = True) -> FittedDynamics:
    """Maximum likelihood for ``x_t - m = sum_j A_j (x_{t-j} - m) + e_t``, given the first states.

    With Gaussian noise this is least squares for the coefficients, and the mean square of what they leave for the
    covariance (which is therefore a little too small: divided by the number of transitions, not less). A component that
    never changes leaves nothing; its noise is then given the smallest variance that can be inverted.

    Args:
        states: ``(T, k)`` or ``(T,)``, evenly spaced in time, in any units; or several such sequences, where some
            frames are missing in between.
        order: p.
        intercept: whether a mean is learnt; otherwise it is zero.

    Raises:
        ValueError: if the order is not positive, a state is not finite, sequences differ in dimension, or there are too
            few transitions to learn from.
    """
    if order < 1:
        raise ValueError(f"order must be at least 1, got {order}")
    sequences = _sequences(states)
    k = sequences[0].shape[1]
    centre = np.concatenate(sequences).mean(axis=0) if intercept else np.zeros(k)
    long_enough = [x - centre for x in sequences if len(x) > order]
    past = [np.hstack([x[order - j - 1 : len(x) - j - 1] for j in range(order)]) for x in long_enough]
    count, unknown = sum(len(x) for x in past), order * k + intercept
    if count <= unknown:
        raise ValueError(f"too few states: {count} transitions for {unknown} coefficients a component of order {order}")
    design, target = np.vstack(past), np.vstack([x[order:] for x in long_enough])
    if intercept:
        design = np.hstack([design, np.ones((count, 1))])
    solution, *_ = np.linalg.lstsq(design, target, rcond=None)
    residuals = target - design @ solution
    covariance = _invertible(residuals.T @ residuals / count, target)
    coefficients = np.asarray(solution[: order * k].T.reshape(k, order, k).transpose(1, 0, 2), dtype=np.float64)
    mean = centre + _mean(coefficients, solution[-1]) if intercept else None
    dynamics = Autoregression(coefficients, covariance, mean)
    spread = np.diag(np.linalg.pinv(design.T @ design))[: order * k]
    errors = np.sqrt(np.outer(np.diag(covariance), spread)).reshape(k, order, k).transpose(1, 0, 2)
    _, log_determinant = np.linalg.slogdet(covariance)
    squares = float(np.sum(residuals @ np.linalg.inv(covariance) * residuals))
    log_likelihood = -0.5 * (count * (k * np.log(2.0 * np.pi) + log_determinant) + squares)
    return FittedDynamics(dynamics, errors, float(log_likelihood), count)


def read_states(path: str | os.PathLike[str]) -> list[FloatArray]:
    """The positions in a CSV file, as sequences ``(T, 2)`` of consecutive frames, to learn dynamics from.

    Columns ``cx`` and ``cy`` are taken for the centre where there are any; otherwise ``x`` and ``y``, of the centre,
    or, where there are columns ``w`` and ``h`` too, of the upper left corner of a box. A run's own track has ``x`` and
    ``y`` of the centre. Frames are numbered in a column ``frame``; without one, rows follow each other. Rows that lack
    a number are left out.

    Raises:
        ValueError: if the columns or rows needed are missing, or a number cannot be read.
        OSError: if the file cannot be read.
    """
    with open(path, newline="", encoding="utf-8") as stream:
        reader = csv.DictReader(stream)
        columns = reader.fieldnames or []
        rows = list(reader)
    names = ("cx", "cy") if {"cx", "cy"} <= set(columns) else ("x", "y")
    if not set(names) <= set(columns):
        raise ValueError(f"{path}: expected columns frame,cx,cy or frame,x,y[,w,h], got {','.join(columns) or 'none'}")
    corner = names == ("x", "y") and {"w", "h"} <= set(columns)
    wanted = [*names, "w", "h"] if corner else list(names)
    try:
        table = [
            (int(float(row.get("frame") or number)), *(float(row[name]) for name in wanted))
            for number, row in enumerate(rows)
            if all(row[name] for name in wanted)
        ]
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: not a number in one of the columns {','.join(wanted)} ({error})") from None
    if not table:
        raise ValueError(f"{path}: no rows with {' and '.join(names)}")
    numbers = np.array(sorted(table))
    positions = numbers[:, 1:3] + (0.5 * numbers[:, 3:5] if corner else 0.0)
    return np.split(positions, np.flatnonzero(np.diff(numbers[:, 0]) != 1.0) + 1)


def _sequences(states: ArrayLike | Sequence[ArrayLike]) -> list[FloatArray]:
    several = isinstance(states, (list, tuple)) and len(states) > 0 and np.ndim(states[0]) == 2
    arrays = [np.asarray(one, dtype=float) for one in (states if several else [states])]  # type: ignore[list-item]
    arrays = [one[:, None] if one.ndim == 1 else one for one in arrays]
    shapes = sorted({one.shape[1:] for one in arrays})
    if len(shapes) != 1 or len(shapes[0]) != 1 or shapes[0][0] < 1:
        raise ValueError(f"states must be (T, k), the same k throughout, got {[one.shape for one in arrays]}")
    if not all(np.isfinite(one).all() for one in arrays):
        raise ValueError("states must be finite, got NaN or infinity")
    return arrays


def _invertible(covariance: FloatArray, states: FloatArray) -> FloatArray:
    """The covariance with enough on its diagonal that it can be inverted."""
    scale = np.maximum(np.square(states).max(axis=0), 1e-12)
    return covariance + np.diag(1e-12 * scale)


def _mean(coefficients: FloatArray, constant: FloatArray) -> FloatArray:
    """The m of ``(I - sum_j A_j) m = constant``; the smallest that comes closest where there is a unit root."""
    rest = np.eye(len(constant)) - coefficients.sum(axis=0)
    return np.linalg.lstsq(rest, constant, rcond=None)[0]
