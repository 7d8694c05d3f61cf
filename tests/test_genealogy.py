"""Lines of ancestors. The oracle: a state of order 6 remembers the innovations of its own line."""

from dataclasses import replace

import numpy as np
import pytest

from pfviz.dynamics import Autoregression
from pfviz.exact import Gaussian
from pfviz.filters import FILTERS, make_filter
from pfviz.genealogy import ancestor_counts, ancestry, lineages, parents, particles_at, unique_ancestors
from pfviz.observations import GaussianObservation
from pfviz.particles import ParticleSet
from pfviz.randomness import step_rng
from pfviz.record import StepRecord, Trace
from pfviz.worlds import Detector, ToyModel

MEMORY = 6
every_filter = pytest.mark.parametrize("name", FILTERS)
SHARED_INNOVATIONS = "hs-sir", "innovation-sir"  # where particles of different histories may have one innovation


def remembering_model() -> ToyModel:
    """Of second order, written as one of order 6 whose older coefficients are zero."""
    dynamics = Autoregression.scalar([1.5, -0.56, 0.0, 0.0, 0.0, 0.0], noise=0.3)
    detector = Detector(0.6, np.zeros((1, 1)), np.ones(1))
    prior = Gaussian(np.zeros(MEMORY), dynamics.stationary_covariance())
    return ToyModel(dynamics, GaussianObservation(np.array([[0.25]])), detector, prior)


def traced(name: str, sizes: list[int], seed: int = 0, limit: int = 2**30) -> Trace:
    """A run with ``sizes[0]`` particles at first, ``sizes[t]`` in step t; the third observation is missing."""
    model = remembering_model()
    filters = [make_filter(name, size) for size in sizes]
    trace = Trace(filters[0].initial(step_rng(seed, 0), model), limit)
    rng = np.random.default_rng(seed + 100)
    for t, filter_ in enumerate(filters[1:], start=1):
        particles = trace.particles
        if len(particles) != sizes[t]:
            particles = particles.take(rng.choice(len(particles), sizes[t], p=particles.weights))
        observation = np.array([np.nan if t == 3 else 0.3 * t])
        trace.append(filter_.step(step_rng(seed, t), model, particles, observation))
    return trace


def check_lines(trace: Trace) -> None:
    """Every line visits, at every time that the state remembers, the innovation that it remembers."""
    for t in range(trace.first - 1, trace.last + 1):
        states = particles_at(trace, t).states
        for index, state in enumerate(states):
            line = ancestry(trace, t, index)
            assert [time for time, _ in line] == list(range(t, t - len(line), -1))
            for (time, ancestor), remembered in zip(line, state, strict=False):
                assert particles_at(trace, time).innovation[ancestor] == remembered


@every_filter
@pytest.mark.parametrize("count", [1, 2, 12])
def test_lines_are_what_the_states_remember(name, count):
    for seed in range(3):
        trace = traced(name, [count] * 7, seed)
        check_lines(trace)
        if name != "icondensation":
            assert all(len(ancestry(trace, 6, index)) == 7 for index in range(count))


@every_filter
def test_lines_go_through_a_change_of_the_number_of_particles(name):
    trace = traced(name, [9, 9, 14, 14, 5, 5])
    check_lines(trace)
    if name != "icondensation":
        assert all(len(ancestry(trace, 5, index)) == 6 for index in range(5))


def test_a_line_ends_where_a_particle_was_started_anew():
    trace = traced("icondensation", [30] * 7)
    lengths = []
    for index in range(30):
        line = ancestry(trace, 6, index)
        time, last = line[-1]
        lengths.append(len(line))
        assert (parents(trace, time)[last] == -1) if time else len(line) == 7
    assert min(lengths) < 7


@every_filter
def test_lineages_hold_the_lines(name):
    trace = traced(name, [12] * 7)
    table = lineages(trace, 6, 6)
    assert table.shape == (7, 12)
    for index in range(12):
        expected = [ancestor for _, ancestor in ancestry(trace, 6, index)]
        assert table[:, index].tolist() == expected + [-1] * (7 - len(expected))
    assert (lineages(trace, 6, 2) == table[:3]).all()


@every_filter
def test_counts_are_of_different_innovations(name):
    """Drawn from continuous densities, ancestors are different where the innovations remembered are."""
    trace = traced(name, [25] * 7)
    states = particles_at(trace, 6).states
    table, counts = lineages(trace, 6, 5), ancestor_counts(trace, 6, 5)
    for k in range(6):
        alive = states[table[k] >= 0]
        assert len(np.unique(alive[:, k])) <= counts[k] <= len(alive)
        assert counts[k] == len(np.unique(alive[:, k])) or name in SHARED_INNOVATIONS
        assert counts[k] == unique_ancestors(trace, 6, k)
    assert counts[-1] < counts[0] and counts[-1] >= 1


def test_copies_count_once():
    """HS-SIR ends its step with copies, where others begin the next with them."""
    states = np.array([[[1.0]], [[1.0]], [[2.0]]])
    assert unique_ancestors(Trace(ParticleSet.uniform(states)), 0, 0) == 2


def test_what_is_forgotten_ends_the_lines():
    trace = traced("rb-hs-sir", [12] * 7, limit=3 * traced("rb-hs-sir", [12] * 2)[1].nbytes)
    assert trace.first > 1
    check_lines(trace)
    assert len(ancestry(trace, 6, 0)) == len(trace) + 1
    assert lineages(trace, 6, 99).shape == (len(trace) + 1, 12)
    with pytest.raises(IndexError, match="no particles of time 0"):
        particles_at(trace, 0)


def test_what_there_is_not_is_said():
    trace = traced("condensation", [4] * 3)
    with pytest.raises(IndexError, match="no particle 4 at time 2: there are 0 to 3"):
        ancestry(trace, 2, 4)
    with pytest.raises(IndexError, match="no particles of time 3"):
        ancestry(trace, 3, 0)
    with pytest.raises(ValueError, match="depth must be at least 0, got -1"):
        lineages(trace, 2, -1)


def test_a_particle_without_an_equal_before_has_no_parent():
    trace = traced("condensation", [4] * 3)
    strange = ParticleSet.uniform(trace[2].previous.states + 1.0)
    trace.truncate(1)
    record: StepRecord = traced("condensation", [4] * 3)[2]
    trace.append(replace(record, previous=strange))
    assert (parents(trace, 2) == -1).all()


def test_where_all_were_started_anew_there_are_no_ancestors():
    trace = traced("condensation", [4] * 3)
    record = trace[2]
    orphans = replace(record.stages[-1], histories=np.full(4, -1))
    trace.truncate(1)
    trace.append(replace(record, stages=(*record.stages[:-1], orphans)))
    assert ancestor_counts(trace, 2, 2).tolist() == [4, 0, 0]
    assert ancestry(trace, 2, 3) == [(2, 3)]
