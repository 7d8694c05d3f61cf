"""The moves that the filters are made of. Each takes particle sets and returns the stage that it adds to the record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pfviz import kernels
from pfviz.dynamics import Autoregression
from pfviz.model import Components, Dynamics, Model, Proposal, shift
from pfviz.particles import FloatArray, IntArray, ParticleSet
from pfviz.randomness import Streams
from pfviz.record import Association, Condition, Stage, StepRecord
from pfviz.resampling import RESAMPLERS


class FilterError(ValueError):
    """A model or a setting that a filter cannot work with."""


def check_settings(n_particles: int, resampling: str = "systematic", ess_threshold: float = 1.0) -> None:
    """Raise a ``FilterError`` that names the setting, its value and what was expected."""
    if not isinstance(n_particles, (int, np.integer)) or isinstance(n_particles, bool) or n_particles < 1:
        raise FilterError(f"n_particles must be a whole number of at least 1, got {n_particles!r}")
    if resampling not in RESAMPLERS:
        raise FilterError(f"resampling must be one of {', '.join(RESAMPLERS)}, got {resampling!r}")
    check_share("ess_threshold", ess_threshold)


def check_share(name: str, value: float) -> None:
    """Raise a ``FilterError`` unless ``value`` is a number between 0 and 1."""
    if not isinstance(value, (int, float, np.number)) or not 0.0 <= value <= 1.0:
        raise FilterError(f"{name} must be between 0 and 1, got {value!r}")


def check_log_factor(name: str, values: FloatArray, count: int) -> None:
    """Raise a ``FilterError`` unless ``values`` are ``count`` numbers, minus infinity among them."""
    if np.shape(values) != (count,):
        raise FilterError(f"the log {name} must have shape ({count},), got {np.shape(values)}")
    if not np.max(values) < np.inf:
        raise FilterError(f"the log {name} of a particle is NaN or infinite; it must be a number or -inf")


def sample_prior(rng: np.random.Generator, model: Model, n_particles: int) -> ParticleSet:
    """Equally weighted draws of the prior: the particle set at time 0 of every filter."""
    return ParticleSet.uniform(model.sample_prior(Streams(rng).of("prior"), n_particles))


def resample(streams: Streams, particles: ParticleSet, scheme: str, ess_threshold: float = 1.0) -> Stage:
    """Multiply the heavy and drop the light, unless the ESS is at or above ``ess_threshold`` of N.

    A threshold of 1 resamples always.
    """
    everyone = np.arange(len(particles))
    if ess_threshold < 1.0 and particles.effective_sample_size >= ess_threshold * len(particles):
        return Stage("resample", particles, ancestors=everyone, histories=everyone)
    ancestors = draw_ancestors(streams.of("resample"), particles.weights, scheme)
    return Stage("resample", particles.take(ancestors), ancestors=ancestors, histories=ancestors)


def draw_ancestors(rng: np.random.Generator, weights: FloatArray, scheme: str, count: int | None = None) -> IntArray:
    """``(count,)``: indices drawn in proportion to ``weights (N,)``; N of them by default."""
    if scheme == "systematic":
        return kernels.systematic_ancestors(weights, rng.random(), count)
    return RESAMPLERS[scheme](rng, weights, count)


def select(streams: Streams, before: Stage, scheme: str, count: int | None = None) -> Stage:
    """Draw particles of the stage before by their weights, after which they weigh the same; histories go with them."""
    chosen = draw_ancestors(streams.of("choose"), before.particles.weights, scheme, count)
    histories = None if before.histories is None else before.histories[chosen]
    return Stage("resample", before.particles.take(chosen), chosen, histories)


def predict(streams: Streams, dynamics: Dynamics, before: Stage) -> Stage:
    """Draw each particle's innovation from p(x1' | x): the proposal of CONDENSATION."""
    particles = before.particles
    states = next_states(streams, dynamics, particles.states)
    everyone = np.arange(len(particles))
    return Stage("predict", ParticleSet(states, particles.log_weights), everyone, before.histories)


def next_states(streams: Streams, dynamics: Dynamics, states: FloatArray) -> FloatArray:
    """``(N, p, k)``: a draw of the state that follows each of ``states (N, p, k)``."""
    if type(dynamics) is Autoregression:  # a subclass may draw in another way
        mean = np.asarray(dynamics.mean)
        seed = streams.seed("predict")
        return kernels.propagate(states, None, dynamics.coefficients, mean, dynamics.noise_factor, seed)
    return shift(states, dynamics.sample(streams.of("predict"), states))


def propose(streams: Streams, proposal: Proposal, count: int) -> Stage:
    """Draw innovations from pi(u | y): particles of order 1 that have no history yet."""
    proposed = proposal.sample(streams.of("propose"), count)
    return Stage("propose", ParticleSet.uniform(proposed[:, None, :]), proposal=proposal)


@dataclass(frozen=True, slots=True)
class Associated:
    """The outcome of history sampling: the stage, and log sum_l w_l p(u_i | x_l) for each innovation."""

    stage: Stage
    log_mixture: FloatArray


def restricted(dynamics: Dynamics, states: FloatArray, components: Components) -> tuple[FloatArray, FloatArray]:
    """Means ``(N, d)`` and covariance ``(d, d)`` of p(u | x) for the proposed ``components``."""
    chosen = list(components)
    return dynamics.predict(states)[:, chosen], dynamics.noise_covariance[np.ix_(chosen, chosen)]


def sample_histories(
    streams: Streams, dynamics: Dynamics, histories: ParticleSet, proposed: Stage, components: Components
) -> Associated:
    """Draw for each innovation u_i a history I_i with probability proportional to w_l p(u_i | x_l).

    Neighbours of equal state, the copies that resampling makes, are drawn as one with the sum of their weights, and
    then one of them by its weight: the same distribution for less work.
    """
    innovations = proposed.particles.innovation
    means, covariance = restricted(dynamics, histories.states, components)
    rng = streams.of("associate")
    uniforms = rng.random(len(innovations))
    first, log_weights = merged_copies(histories)
    log_mixture, chosen = kernels.sample_histories(innovations, means[first], log_weights, covariance, uniforms)
    if len(first) < len(histories):
        chosen = one_of_copies(histories.weights, first, chosen, rng.random(len(chosen)))
    association = Association(histories, innovations, chosen, means, covariance)
    everyone = np.arange(len(innovations))
    stage = Stage("associate", proposed.particles, everyone, chosen, association=association)
    return Associated(stage, log_mixture)


def merged_copies(particles: ParticleSet) -> tuple[IntArray, FloatArray]:
    """The index of the first of each run of neighbours of equal state, and the log of their summed weights."""
    flat = particles.states.reshape(len(particles), -1)
    first = np.flatnonzero(np.concatenate([[True], (flat[1:] != flat[:-1]).any(axis=1)]))
    if len(first) == len(particles):
        return first, particles.log_weights
    with np.errstate(divide="ignore"):
        return first, np.log(np.add.reduceat(particles.weights, first))


def one_of_copies(weights: FloatArray, first: IntArray, chosen: IntArray, uniforms: FloatArray) -> IntArray:
    """For each of the ``chosen`` runs of copies one of its members, drawn by weight.

    Args:
        weights: ``(N,)``, of all particles.
        first: ``(R,)``, where the runs begin.
        chosen: ``(M,)``, indices of runs.
        uniforms: ``(M,)``, in [0, 1).

    Returns:
        ``(M,)``, indices of particles.
    """
    edges = np.concatenate([first, [len(weights)]])
    cumulative = np.concatenate([[0.0], np.cumsum(weights)])
    low, high = cumulative[edges[chosen]], cumulative[edges[chosen + 1]]
    found = np.searchsorted(cumulative, low + uniforms * (high - low), side="right") - 1
    return np.clip(found, edges[chosen], edges[chosen + 1] - 1)


def log_mixture(
    dynamics: Dynamics, histories: ParticleSet, innovations: FloatArray, components: Components
) -> FloatArray:
    """``(N,)``: log sum_l w_l p(u_i | x_l) for ``innovations (N, d)``, the density that the histories predict."""
    means, covariance = restricted(dynamics, histories.states, components)
    return kernels.log_mixture_density(innovations, means, histories.log_weights, covariance)


def join_by_index(dynamics: Dynamics, histories: Stage, proposed: Stage, components: Components) -> Stage:
    """Join innovation i to history i, as Basic-SIR does: an arbitrary association."""
    innovations = proposed.particles.innovation
    everyone = np.arange(len(innovations))
    means, covariance = restricted(dynamics, histories.particles.states, components)
    association = Association(histories.particles, innovations, everyone, means, covariance, arbitrary=True)
    return Stage("associate", proposed.particles, everyone, histories.histories, association=association)


def complete(
    streams: Streams,
    dynamics: Dynamics,
    histories: ParticleSet,
    chosen: IntArray,
    before: Stage,
    components: Components,
    log_weights: FloatArray | None = None,
) -> Stage:
    """Give innovation i the history ``chosen[i]`` and draw its other components v from p(v | u, x) (Table 4, step 3).

    The new particles carry ``log_weights``, or equal weights.
    """
    states = histories.states[chosen]
    innovation = dynamics.complete(streams.of("complete"), before.particles.innovation, states, components)
    particles = ParticleSet.uniform(shift(states, innovation))
    if log_weights is not None:
        particles = particles.reweighted(log_weights)
    return Stage("complete", particles, np.arange(len(chosen)), before.histories)


@dataclass(frozen=True, slots=True)
class Weighed:
    """The stage after weighting, the log of the summed weights, and whether they were all zero."""

    stage: Stage
    log_evidence: float
    condition: Condition | None = None


def weigh(before: Stage, log_factors: Mapping[str, FloatArray]) -> Weighed:
    """Multiply factors into the weights: w_i becomes w_i * product of factors, normalised.

    Where every weight would be zero there is nothing to prefer: the weights stay as they were, the evidence is zero
    (its logarithm minus infinity) and the condition is "degenerate". The filter goes on from the particles it has
    drawn: a filter that proposes from pi(u | y) is then where the detector pointed, one that predicts is where the
    dynamics led.

    Raises:
        FilterError: if a factor is NaN or plus infinity.
    """
    particles = before.particles
    for name, values in log_factors.items():
        check_log_factor(name, values, len(particles))
    everyone = np.arange(len(particles))
    total = sum(log_factors.values(), start=particles.log_weights)
    peak = float(total.max())
    if np.isneginf(peak):
        stage = Stage("weight", particles, everyone, before.histories, log_factors)
        return Weighed(stage, -np.inf, "degenerate")
    # Relative to the largest, so that no digits are lost where all are far below zero.
    normalised = kernels.normalise_log_weights(total - peak)
    weighted = particles.reweighted(normalised.log_weights)
    stage = Stage("weight", weighted, everyone, before.histories, log_factors)
    return Weighed(stage, peak + normalised.log_sum)


def extend(record: StepRecord, stage: Stage) -> StepRecord:
    """The record with one more stage."""
    return replace(record, stages=(*record.stages, stage))


def with_cost(record: StepRecord, likelihoods: int, transitions: int) -> StepRecord:
    """The record with evaluations added that were made before its first stage."""
    return replace(
        record,
        likelihood_evaluations=record.likelihood_evaluations + likelihoods,
        transition_evaluations=record.transition_evaluations + transitions,
    )


def predict_only(streams: Streams, model: Model, particles: ParticleSet, observation: Any) -> StepRecord:
    """The step of every filter when the observation is missing: dynamics only, weights and evidence unchanged."""
    everyone = np.arange(len(particles))
    stage = predict(streams, model.dynamics, Stage("resample", particles, everyone, everyone))
    return StepRecord(observation, particles, (stage,), 0.0, 0, len(particles), "missing")
