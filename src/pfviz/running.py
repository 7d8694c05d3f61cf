"""Running a filter over a sequence of observations."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from pfviz.filters import Filter
from pfviz.model import Model
from pfviz.randomness import step_rng
from pfviz.record import StepRecord


def run(filter_: Filter, model: Model, observations: Iterable[Any], seed: int = 0) -> Iterator[StepRecord]:
    """The record of each step, the first being that of time 1. Equal arguments, equal records, byte for byte."""
    particles = filter_.initial(step_rng(seed, 0), model)
    for t, observation in enumerate(observations, start=1):
        record = filter_.step(step_rng(seed, t), model, particles, observation)
        particles = record.posterior
        yield record
