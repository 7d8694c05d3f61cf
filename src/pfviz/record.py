"""What one iteration of a filter did, in order: the data that everything drawn or printed is read from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from pfviz.model import Proposal
from pfviz.particles import FloatArray, IntArray, ParticleSet, log_sum_exp, readonly

StageKind = Literal["resample", "predict", "propose", "search", "associate", "complete", "weight"]
Condition = Literal["missing", "degenerate"]


@dataclass(frozen=True, slots=True)
class Association:
    """Which history each proposed innovation was joined to, and how probable every other join was.

    Row i of the N x M matrix ``a[i, l] ∝ w_l p(u_i | x_l)`` is computed on demand; the matrix is never stored.

    Attributes:
        histories: the M particles whose histories could be chosen.
        innovations: ``(N, d)``, the proposed components u.
        chosen: ``(N,)``, indices into ``histories``.
        means: ``(M, d)``, the mean of p(u | x_l) for each history.
        covariance: ``(d, d)``, the covariance of p(u | x_l).
        arbitrary: whether the join was made by index, whatever the densities say (Basic-SIR).
        pool: ``(P, d)``, the innovations that could be chosen, where it was the histories that chose; else None.
        log_pool_weights: ``(P,)``, what each innovation of the pool counted for, whatever the history.
    """

    histories: ParticleSet
    innovations: FloatArray
    chosen: IntArray
    means: FloatArray
    covariance: FloatArray
    arbitrary: bool = False
    pool: FloatArray | None = None
    log_pool_weights: FloatArray | None = None

    @property
    def nbytes(self) -> int:
        """Of its own arrays; the histories are those of the record."""
        arrays = (self.innovations, self.chosen, self.means, self.pool, self.log_pool_weights)
        return sum(array.nbytes for array in arrays if array is not None)

    def log_joint(self, indices: IntArray) -> FloatArray:
        """``(len(indices), M)``: log w_l p(u_i | x_l) for the innovations at ``indices``."""
        return self.histories.log_weights + self._log_transition(self.innovations[indices], self.means)

    def _log_transition(self, innovations: FloatArray, means: FloatArray) -> FloatArray:
        """``(len(innovations), len(means))``: the log-density of every innovation about every mean."""
        factor = np.linalg.cholesky(self.covariance)
        u, m = np.linalg.solve(factor, innovations.T).T, np.linalg.solve(factor, means.T).T
        squares = np.sum((u[:, None] - m[None]) ** 2, axis=-1)
        constant = 0.5 * u.shape[1] * np.log(2.0 * np.pi) + np.log(np.diag(factor)).sum()
        return -0.5 * squares - constant

    def row(self, index: int) -> FloatArray:
        """``(M,)``: the probability with which history sampling joins innovation ``index`` to each history."""
        log_row = self.log_joint(np.array([index]))[0]
        return np.exp(log_row - log_sum_exp(log_row))

    def pool_row(self, index: int) -> FloatArray:
        """``(P,)``: the probability with which history ``index`` draws each innovation of the pool (Innovation-SIR).

        Raises:
            ValueError: if there is no pool: innovations drew histories, not the other way about.
        """
        if self.pool is None or self.log_pool_weights is None:
            raise ValueError("no innovations were drawn by histories here; see row()")
        log_row = self.log_pool_weights + self._log_transition(self.pool, self.means[[index]])[:, 0]
        return np.exp(log_row - log_sum_exp(log_row))

    def plausibility(self, indices: IntArray | slice = slice(None)) -> FloatArray:
        """``(n,)``: p(u | x) of the joins made at ``indices``, relative to its peak; 0 where there is no history."""
        chosen = self.chosen[indices]
        deviations = self.innovations[indices] - self.means[np.maximum(chosen, 0)]
        whitened = np.linalg.solve(np.linalg.cholesky(self.covariance), deviations.T)
        return np.where(chosen >= 0, np.exp(-0.5 * np.sum(whitened * whitened, axis=0)), 0.0)

    def strongest(self, index: int, count: int) -> tuple[IntArray, FloatArray]:
        """The ``count`` most probable histories of innovation ``index`` and their probabilities, strongest first."""
        row = self.row(index)
        order = np.argsort(-row, kind="stable")[:count]
        return order, row[order]

    def strongest_pairs(self, count: int, indices: IntArray | None = None) -> tuple[IntArray, IntArray, FloatArray]:
        """The ``count`` pairs of innovation and history with the largest w_l p(u_i | x_l).

        Args:
            count: how many pairs at the most.
            indices: the innovations to look at; all of them by default.

        Returns:
            Innovation indices, history indices and log w_l p(u_i | x_l), strongest first.
        """
        indices = np.arange(len(self.innovations)) if indices is None else indices
        log_joint = self.log_joint(indices)
        flat = log_joint.ravel()
        count = min(count, flat.size)
        top = np.argpartition(-flat, count - 1)[:count]
        top = top[np.argsort(-flat[top], kind="stable")]
        rows, columns = np.unravel_index(top, log_joint.shape)
        return indices[rows], columns, flat[top]


@dataclass(frozen=True, slots=True)
class Stage:
    """One stage of an iteration.

    Attributes:
        kind: what was done.
        particles: the particle set after it.
        ancestors: ``(N,)``, indices into the stage before (into ``StepRecord.previous`` for the first), or None where
            the particles were drawn anew.
        histories: ``(N,)``, the index in ``StepRecord.previous`` of the particle whose history each one continues, -1
            for a particle without one; None before histories are assigned.
        log_factors: the log-factors by name, each ``(N,)``, that this stage multiplied into the weights; their sum is
            the unnormalised log-weight. Division by the proposal is the factor ``proposal``, with its sign.
        association: how innovations and histories were joined, where they were joined here.
        proposal: the density that the innovations were drawn from, where they were drawn here and it is the same one
            for all.
    """

    kind: StageKind
    particles: ParticleSet
    ancestors: IntArray | None = None
    histories: IntArray | None = None
    log_factors: Mapping[str, FloatArray] = field(default_factory=dict)
    association: Association | None = None
    proposal: Proposal | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "log_factors", {name: readonly(v) for name, v in self.log_factors.items()})


@dataclass(frozen=True, slots=True)
class StepRecord:
    """One iteration: everything that happened between two posteriors.

    Attributes:
        observation: what was observed.
        previous: the posterior that the iteration began with.
        stages: what was done, in order; the last one holds the new posterior.
        log_evidence: this step's increment of log p(y_1:t), an estimate; None where the filter defines none.
        likelihood_evaluations: how many times p(y | x) was evaluated.
        transition_evaluations: how many times p(u | x) was evaluated or sampled.
        condition: "missing" when there was no observation, "degenerate" when every weight was zero and the weights
            were therefore left as they were; None when all went well.
    """

    observation: Any
    previous: ParticleSet
    stages: tuple[Stage, ...]
    log_evidence: float | None
    likelihood_evaluations: int = 0
    transition_evaluations: int = 0
    condition: Condition | None = None

    @property
    def posterior(self) -> ParticleSet:
        return self.stages[-1].particles

    @property
    def estimate(self) -> FloatArray:
        """``(k,)``: the posterior mean of the innovation."""
        return self.posterior.mean

    @property
    def effective_sample_size(self) -> float:
        """That of the weights as computed, before any resampling that follows them in the same iteration."""
        weighted = self.stage("weight")
        return (weighted.particles if weighted else self.posterior).effective_sample_size

    @property
    def histories(self) -> IntArray:
        """``(N,)``: the index in ``previous`` of each posterior particle's history; -1 for none."""
        histories = self.stages[-1].histories
        return np.full(len(self.posterior), -1) if histories is None else histories

    @property
    def association(self) -> Association | None:
        """The association of innovations and histories made in this iteration, if any was."""
        return next((stage.association for stage in self.stages if stage.association is not None), None)

    @property
    def origins(self) -> IntArray:
        """``(M,)``: the index in ``previous`` of each history that the association could choose.

        Raises:
            ValueError: if innovations and histories were not associated in this iteration.
        """
        association = self.association
        if association is None:
            raise ValueError("nothing was associated in this iteration, so no histories could be chosen")
        if association.histories is self.previous:
            return np.arange(len(self.previous))
        resampled = next(stage for stage in self.stages if stage.particles is association.histories)
        assert resampled.histories is not None
        return resampled.histories

    def stage(self, kind: StageKind) -> Stage | None:
        """The last stage of the given kind, if there is one."""
        return next((stage for stage in reversed(self.stages) if stage.kind == kind), None)

    @property
    def nbytes(self) -> int:
        """Roughly how much memory the record keeps alive."""
        return int(getattr(self.observation, "nbytes", 0)) + sum(
            stage.particles.states.nbytes
            + 3 * stage.particles.log_weights.nbytes
            + sum(factor.nbytes for factor in stage.log_factors.values())
            + (stage.association.nbytes if stage.association is not None else 0)
            for stage in self.stages
        )


class Trace:
    """The records of a run so far, the oldest forgotten when they outgrow ``limit_bytes``.

    Records are addressed by time: ``trace[t]`` is the step at time t, which begins at 1; ``trace.initial`` is the
    particle set at time 0.
    """

    def __init__(self, initial: ParticleSet, limit_bytes: int = 256 * 2**20) -> None:
        self.initial = initial
        self._limit_bytes = limit_bytes
        self._records: list[StepRecord] = []
        self._first = 1
        self._nbytes = 0

    def __len__(self) -> int:
        return len(self._records)

    def __iter__(self) -> Iterator[StepRecord]:
        return iter(self._records)

    def __getitem__(self, t: int) -> StepRecord:
        if not self.first <= t <= self.last:
            raise IndexError(f"no record of time {t}: there are {self.first} to {self.last}")
        return self._records[t - self._first]

    @property
    def first(self) -> int:
        """The oldest time still recorded."""
        return self._first

    @property
    def last(self) -> int:
        """The newest time recorded; 0 before the first step."""
        return self._first + len(self._records) - 1

    @property
    def particles(self) -> ParticleSet:
        """The newest particle set: where the next step begins."""
        return self._records[-1].posterior if self._records else self.initial

    def append(self, record: StepRecord) -> None:
        self._records.append(record)
        self._nbytes += record.nbytes
        while self._nbytes > self._limit_bytes and len(self._records) > 1:
            self._nbytes -= self._records.pop(0).nbytes
            self._first += 1

    def copy(self) -> Trace:
        """A trace of the same records, which goes its own way from here."""
        other = Trace(self.initial, self._limit_bytes)
        other._records, other._first, other._nbytes = list(self._records), self._first, self._nbytes
        return other

    def truncate(self, t: int) -> None:
        """Forget every record after time ``t``, so that the run can go on from there in another way."""
        while self._records and self.last > t:
            self._nbytes -= self._records.pop().nbytes
