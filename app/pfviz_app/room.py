"""A room: one filter on one film, recorded. Knows nothing of screens or threads."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from hashlib import blake2b
from time import perf_counter
from typing import Generic, TypeVar

import numpy as np

from pfviz.filters import make_filter
from pfviz.model import Model
from pfviz.particles import ParticleSet
from pfviz.randomness import Streams, step_rng
from pfviz.record import StepRecord, Trace
from pfviz.resampling import RESAMPLERS
from pfviz.vision.presence import Presence
from pfviz_app.exact_answer import Known
from pfviz_app.films import Film
from pfviz_app.shelf import Shelf

F = TypeVar("F", bound=Film)
_TRACE_BYTES = 128 * 2**20
_OVERHEAD = 2000
"""Roughly what a run takes beside its arrays, in bytes."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What is kept of a step beside its record.

    Attributes:
        filter_name: of the filter that ran.
        model: that the filter believed in.
        error: distance of the estimate from the truth; NaN where the truth is not known.
        log_evidence: the estimate of log p(y_1:t) so far; NaN from where the filter defines none.
        effective_sample_size: of the weights as computed.
        milliseconds: what the step took, observation included.
        presence: whether the object is there, where the film knows how to tell.
    """

    filter_name: str
    model: Model
    error: float
    log_evidence: float
    effective_sample_size: float
    milliseconds: float
    presence: Presence | None = None

    @property
    def lost(self) -> bool:
        """Whether the object is not where the estimate is."""
        return self.presence is not None and not self.presence.tracked


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """A step that was run.

    Attributes:
        record: of it.
        outcome: what is kept beside the record.
        exact: what the exact answer found, where there is one.
    """

    record: StepRecord
    outcome: Outcome
    exact: Known | None

    @property
    def nbytes(self) -> int:
        """Roughly how much memory it keeps alive."""
        return self.record.nbytes + (self.exact[0].nbytes if self.exact else 0) + _OVERHEAD


class Room(Generic[F]):
    """A film, the filter and model that are run on it, and the trace of what they did.

    Args:
        film: what the filter sees.
        filter_name: of the filter.
        model: that the filter believes in.
        n_particles: how many.
        seed: of all random numbers.
        belief: equal for equal models of the same film, and for nothing else.
        runs: steps that others have run. All of a step's random numbers come from the seed, so it need be run only
            once; without it every step is run here.
    """

    def __init__(
        self,
        film: F,
        filter_name: str,
        model: Model,
        n_particles: int,
        seed: int,
        belief: str = "",
        runs: Shelf[Run] | None = None,
    ) -> None:
        self.film = film
        self._seed, self._runs = seed, runs
        self._outcomes: list[Outcome] = []
        self._courses = [_digest(b"", (film.sign(0), seed))]
        self.configure(filter_name, model, n_particles, belief)
        self.trace = Trace(self._filter.initial(step_rng(seed, 0), model), _TRACE_BYTES)
        self.exact = film.exact()

    def configure(self, filter_name: str, model: Model, n_particles: int, belief: str = "") -> None:
        """Use another filter or model from the next step on."""
        self._filter_name, self._filter = filter_name, self.film.looking(make_filter(filter_name, n_particles))
        self._model, self._n_particles, self._belief = model, n_particles, belief

    def course(self, t: int) -> bytes:
        """What tells apart all that happened up to time ``t``: the film, the seed, and how each step was run."""
        return self._courses[t]

    def step(self) -> StepRecord:
        """Run the filter on the next observation and record it.

        The first step draws its particles from the prior once more: it may be under other settings by now.

        Raises:
            EndOfVideo: when the film is over.
        """
        t = self.trace.last + 1
        course = _digest(self._courses[-1], (self.film.sign(t), self._filter_name, self._n_particles, self._belief))
        run = self._run(t) if self._runs is None else self._runs.get(course, lambda: self._run(t))
        if t == 1:
            self.trace.initial = run.record.previous
        if self.exact is not None:
            self.exact.step(t, self._model, run.record.observation, run.exact)
        self.trace.append(run.record)
        self._outcomes.append(run.outcome)
        self._courses.append(course)
        return run.record

    def _run(self, t: int) -> Run:
        particles = self._filter.initial(step_rng(self._seed, 0), self._model) if t == 1 else self.trace.particles
        particles = self._resized(particles, t)
        presence = self._outcomes[-1].presence if self._outcomes else self.film.presence
        model = self.film.given(self._model, presence)
        began = perf_counter()
        observation = self.film.observe(t, model)
        record = self._filter.step(step_rng(self._seed, t), model, particles, observation)
        presence = self.film.presence_after(model, presence, record)
        elapsed = 1000.0 * (perf_counter() - began)
        so_far = self._outcomes[-1].log_evidence if self._outcomes else 0.0
        log_evidence = so_far + (np.nan if record.log_evidence is None else record.log_evidence)
        error, size = self.film.error(t, record), record.effective_sample_size
        outcome = Outcome(self._filter_name, self._model, error, log_evidence, size, elapsed, presence)
        return Run(record, outcome, self.exact and self.exact.step(t, self._model, observation))

    def outcome(self, t: int) -> Outcome:
        """What is known of the step at time ``t`` beside its record."""
        return self._outcomes[t - 1]

    def rewind(self, t: int) -> None:
        """Forget what came after time ``t``."""
        self.trace.truncate(t)
        del self._outcomes[t:], self._courses[t + 1 :]
        if self.exact is not None:
            self.exact.rewind(t)

    def fork(self, t: int) -> Room[F]:
        """A room with the same records up to time ``t``, which goes its own way from there."""
        other = copy(self)
        other.trace, other._outcomes, other._courses = self.trace.copy(), list(self._outcomes), list(self._courses)
        other.exact = self.exact and self.exact.copy()
        other.rewind(t)
        return other

    def _resized(self, particles: ParticleSet, t: int) -> ParticleSet:
        """As many particles as are wanted now, drawn from those there are."""
        if len(particles) == self._n_particles:
            return particles
        rng = Streams(step_rng(self._seed, t)).of("choose")
        return particles.take(RESAMPLERS["systematic"](rng, particles.weights, self._n_particles))

    @property
    def times(self) -> np.ndarray:
        """The times recorded, as the x-axis of a plot."""
        return np.arange(self.trace.first, self.trace.last + 1, dtype=float)

    @property
    def errors(self) -> np.ndarray:
        return np.array([outcome.error for outcome in self._outcomes[self.trace.first - 1 :]])

    @property
    def effective_sample_sizes(self) -> np.ndarray:
        return np.array([outcome.effective_sample_size for outcome in self._outcomes[self.trace.first - 1 :]])

    @property
    def log_evidences(self) -> np.ndarray:
        """log p(y_1:t), as the filter estimates it, at the times recorded; NaN from where it defines none."""
        return np.array([outcome.log_evidence for outcome in self._outcomes[self.trace.first - 1 :]])


def _digest(before: bytes, step: tuple[object, ...]) -> bytes:
    return blake2b(before + repr(step).encode(), digest_size=16).digest()
