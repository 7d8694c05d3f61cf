"""Who descends from whom: the lines of ancestors of particles, read from the records of a run.

A particle's parent is the particle of the step before whose history it continues. What happened in between, resampling
before the prediction or a draw of histories after the proposal, makes no difference here.
"""

from __future__ import annotations

import numpy as np

from pfviz.particles import IntArray, ParticleSet
from pfviz.record import Trace


def particles_at(trace: Trace, t: int) -> ParticleSet:
    """The posterior particles of time ``t``; those of time 0 are drawn from the prior.

    Raises:
        IndexError: if that time is not recorded.
    """
    if trace.first <= t <= trace.last:
        return trace[t].posterior
    if t == 0 and trace.first == 1:
        return trace.initial
    if t == trace.first - 1 and len(trace):
        return trace[trace.first].previous
    raise IndexError(f"no particles of time {t}: there are those of {trace.first - 1} to {trace.last}")


def parents(trace: Trace, t: int) -> IntArray:
    """``(N,)``: for each posterior particle of time ``t``, its parent's index at time t - 1; -1 where it has none.

    Where the number of particles was changed between two steps, the particles that the step began with are copies of
    those before; each goes back to the first one that it equals.

    Raises:
        IndexError: if the step of time ``t`` is not recorded.
    """
    record = trace[t]
    earlier, histories = particles_at(trace, t - 1), record.histories
    if record.previous is earlier:
        return histories
    originals = first_of_equals(record.previous, earlier)
    return np.where(histories >= 0, originals[histories], -1)


def first_of_equals(particles: ParticleSet, among: ParticleSet | None = None) -> IntArray:
    """``(N,)``: for each particle the index of the first one of equal state; -1 where there is none.

    Args:
        particles: N of them.
        among: where equals are looked for; ``particles`` itself by default.
    """
    first: dict[bytes, int] = {}
    for index, state in enumerate((particles if among is None else among).states):
        first.setdefault(state.tobytes(), index)
    return np.array([first.get(state.tobytes(), -1) for state in particles.states], dtype=np.int64)


def lineages(trace: Trace, t: int, depth: int) -> IntArray:
    """``(d + 1, N)``: row k holds the index at time t - k of each particle's ancestor; -1 where its line began later.

    d is ``depth``, or as many steps as are recorded before ``t``.

    Raises:
        IndexError: if time ``t`` is not recorded.
        ValueError: if ``depth`` is negative.
    """
    if depth < 0:
        raise ValueError(f"depth must be at least 0, got {depth}")
    rows = [np.arange(len(particles_at(trace, t)))]
    for time in range(t, max(t - depth, trace.first - 1), -1):
        above = rows[-1]
        rows.append(np.where(above >= 0, parents(trace, time)[above], -1))
    return np.stack(rows)


def ancestry(trace: Trace, t: int, index: int) -> list[tuple[int, int]]:
    """The line of ancestors of the posterior particle ``index`` of time ``t``: times and indices, itself first.

    The line ends at the oldest time recorded, or where a particle has no parent (ICondensation starts some anew).

    Raises:
        IndexError: if there is no such particle.
    """
    count = len(particles_at(trace, t))
    if not 0 <= index < count:
        raise IndexError(f"no particle {index} at time {t}: there are 0 to {count - 1}")
    line = [(t, index)]
    for time in range(t, trace.first - 1, -1):
        index = int(parents(trace, time)[index])
        if index < 0:
            break
        line.append((time - 1, index))
    return line


def ancestor_counts(trace: Trace, t: int, depth: int) -> IntArray:
    """``(d + 1,)``: how many different ancestors the particles of time ``t`` have at t, t - 1, ..., t - d.

    Copies, that is particles of equal state, count once, so that filters that copy before and after a step can be
    compared. d is ``depth``, or as many steps as are recorded before ``t``.

    Raises:
        IndexError: if time ``t`` is not recorded.
        ValueError: if ``depth`` is negative.
    """
    rows = lineages(trace, t, depth)
    counts = [_different(particles_at(trace, t - k), row[row >= 0]) for k, row in enumerate(rows)]
    return np.array(counts, dtype=np.int64)


def _different(particles: ParticleSet, indices: IntArray) -> int:
    states = particles.states[np.unique(indices)]
    return len(np.unique(states.reshape(len(states), particles.order * particles.dimension), axis=0))


def unique_ancestors(trace: Trace, t: int, depth: int) -> int:
    """How many different ancestors the particles of time ``t`` have ``depth`` steps earlier; see ``ancestor_counts``.

    Where fewer steps are recorded, at the oldest time there is.

    Raises:
        IndexError: if time ``t`` is not recorded.
        ValueError: if ``depth`` is negative.
    """
    rows = lineages(trace, t, depth)
    return _different(particles_at(trace, t - len(rows) + 1), rows[-1][rows[-1] >= 0])
