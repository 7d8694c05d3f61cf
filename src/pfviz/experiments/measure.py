"""One run of a filter, on a toy world or on video, and what is measured in it."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from time import thread_time
from typing import Any

import numpy as np

from pfviz.exact import Gaussian, GridDensity
from pfviz.filters import Filter, make_filter
from pfviz.particles import FloatArray
from pfviz.randomness import step_rng
from pfviz.record import Stage, StepRecord
from pfviz.worlds import Recording, ToyModel, get_world

Measured = dict[str, Any]


def toy_run(
    world: str,
    filter_name: str,
    particles: int,
    seed: int,
    steps: int = 60,
    system: float = 1.0,
    observation: float = 1.0,
    proposal: float = 1.0,
    matched: bool = False,
) -> Measured:
    """A filter over the recording ``seed`` of a toy world, believing in noise multiplied by the factors.

    Args:
        world: its name.
        filter_name: as on the command line.
        particles: how many.
        seed: of recording and filter.
        steps: how many.
        system: what the system noise is multiplied by.
        observation: the observation noise.
        proposal: the proposal's width.
        matched: whether the recording is drawn with the same noise, so that the filter is right about it.

    Returns:
        ``distances`` of the estimate from the truth by step; ``error``, their root mean square; ``exact_error``, the
        same of the exact posterior mean; ``excess``, root mean square of estimate minus exact mean in exact standard
        deviations; ``tracked``, 1 where one of the last estimates is within a quarter of the world's half-width of the
        truth; ``ess_share``, the mean ESS over N; ``sharpness`` of the likelihood; ``log_evidence_ratio`` against the
        exact one; ``milliseconds`` of processor time a step.
    """
    recording, model, exact = exact_run(world, seed, steps, (system, observation, proposal), matched)
    filter_ = make_filter(filter_name, particles)
    records, milliseconds = _timed_run(filter_, model, recording, seed)
    estimates = np.array([record.estimate for record in records])
    misses = np.linalg.norm(estimates - recording.truth, axis=1)
    measured: Measured = {
        "error": _root_mean_square(misses),
        "distances": [round(float(value), 3) for value in misses],
        "tracked": int(misses[-5:].min() < 0.25 * get_world(world).extent),
        "ess_share": mean_ess_share(records),
        "sharpness": _mean([sharpness(record) for record in records]),
        "milliseconds": milliseconds,
    }
    if exact is not None:
        measured["exact_error"] = _root_mean_square(np.linalg.norm(exact.means - recording.truth, axis=1))
        measured["excess"] = _root_mean_square((estimates - exact.means) / exact.deviations)
        measured["log_evidence_ratio"] = log_evidence(records, exact.log_evidence)
    return measured


class ExactRun:
    """The exact posterior of a recording under a model.

    Attributes:
        means: ``(T, k)``.
        deviations: ``(T, k)``, standard deviations.
        log_evidence: of the whole recording.
    """

    def __init__(self, model: ToyModel, recording: Recording) -> None:
        state: Gaussian | GridDensity = model.prior
        means, deviations, self.log_evidence = [], [], 0.0
        for observation in recording.observations:
            step = model.exact_step(state, observation)
            assert step is not None
            state = step.posterior
            marginal = step.posterior.leading(model.dynamics.dimension)
            means.append(marginal.mean)
            deviations.append(np.sqrt(np.diag(np.atleast_2d(marginal.covariance))))
            self.log_evidence += step.log_evidence
        self.means, self.deviations = np.array(means), np.array(deviations)


@lru_cache(maxsize=512)
def exact_run(
    world: str, seed: int, steps: int, factors: tuple[float, float, float], matched: bool
) -> tuple[Recording, ToyModel, ExactRun | None]:
    """A recording, the model as it is believed, and the exact posterior where there is one."""
    place = get_world(world)
    model = place.model.with_noise(*factors)
    recording = (replace(place, model=model, actual=None) if matched else place).record(seed, steps)
    return recording, model, ExactRun(model, recording) if model.exact is not None else None


def _timed_run(filter_: Filter, model: ToyModel, recording: Recording, seed: int) -> tuple[list[StepRecord], float]:
    """The records, and the processor time of a step in milliseconds."""
    records: list[StepRecord] = []
    particles = filter_.initial(step_rng(seed, 0), model)
    began = thread_time()
    for t, observation in enumerate(recording.observations, start=1):
        records.append(filter_.step(step_rng(seed, t), model, particles, observation))
        particles = records[-1].posterior
    return records, 1000.0 * (thread_time() - began) / len(records)


def log_evidence(records: list[StepRecord], exact: float) -> float | None:
    """The logarithm of the estimated evidence over the exact one; None where the filter has none or it is zero."""
    parts = [record.log_evidence for record in records]
    if any(part is None or not np.isfinite(part) for part in parts):
        return None
    return float(sum(part for part in parts if part is not None) - exact)


def mean_ess_share(records: list[StepRecord]) -> float:
    """The mean over time of the ESS over N."""
    return _mean([record.effective_sample_size / len(record.posterior) for record in records]) or 0.0


def weighed_stage(record: StepRecord) -> Stage | None:
    """The last stage in which the likelihood came into the weights."""
    return next((stage for stage in reversed(record.stages) if "likelihood" in stage.log_factors), None)


def sharpness(record: StepRecord) -> float | None:
    """How much the likelihood tells the proposed particles apart: the standard deviation of its logarithm."""
    stage = weighed_stage(record)
    if stage is None:
        return None
    values = stage.log_factors["likelihood"]
    finite = values[np.isfinite(values)]
    return float(finite.std()) if len(finite) else None


def spread(positions: FloatArray) -> float:
    """The root mean square distance of ``positions (N, d)`` from their mean."""
    return float(np.sqrt(positions.var(axis=0).sum()))


def _root_mean_square(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _mean(values: list[float | None] | list[float]) -> float | None:
    present = [value for value in values if value is not None]
    return float(np.mean(present)) if present else None
