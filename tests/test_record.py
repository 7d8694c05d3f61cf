"""Records: associations on demand, stages in order, a trace that forgets the oldest."""

import numpy as np
import pytest
from oracles import random_covariance
from scipy.stats import multivariate_normal

from pfviz.particles import ParticleSet
from pfviz.record import Association, Stage, StepRecord, Trace


def association(n: int = 5, m: int = 7, d: int = 2) -> Association:
    rng = np.random.default_rng(0)
    histories = ParticleSet(rng.standard_normal((m, 2, d)), np.log(rng.dirichlet(np.ones(m))))
    chosen = rng.integers(m, size=n)
    return Association(
        histories,
        rng.standard_normal((n, d)),
        chosen,
        rng.standard_normal((m, d)),
        random_covariance(rng, d),
    )


def brute_force(a: Association) -> np.ndarray:
    """``(N, M)``: w_l p(u_i | x_l), entry by entry."""
    return np.array(
        [
            [w * multivariate_normal(m, a.covariance).pdf(u) for w, m in zip(a.histories.weights, a.means, strict=True)]
            for u in a.innovations
        ]
    )


@pytest.mark.parametrize("d", [1, 2, 3])
def test_rows_are_the_normalised_products(d):
    a = association(d=d)
    joint = brute_force(a)
    np.testing.assert_allclose(np.exp(a.log_joint(np.arange(5))), joint, rtol=1e-9)
    for i in range(5):
        np.testing.assert_allclose(a.row(i), joint[i] / joint[i].sum(), rtol=1e-9)
        assert a.row(i).sum() == pytest.approx(1.0)


def test_a_row_far_from_every_history_still_sums_to_one():
    a = association()
    far = Association(a.histories, a.innovations + 1e4, a.chosen, a.means, a.covariance)
    assert far.row(0).sum() == pytest.approx(1.0)


def test_strongest_of_a_row():
    a = association()
    indices, probabilities = a.strongest(2, 3)
    assert indices.tolist() == np.argsort(-a.row(2))[:3].tolist()
    np.testing.assert_allclose(probabilities, a.row(2)[indices])
    assert len(a.strongest(2, 99)[0]) == 7


@pytest.mark.parametrize("count", [1, 6, 99])
@pytest.mark.parametrize("rows", [None, np.array([4, 1])])
def test_strongest_pairs(count, rows):
    a = association()
    joint = brute_force(a)
    if rows is not None:
        joint[[i for i in range(5) if i not in rows]] = 0
    innovations, histories, log_joint = a.strongest_pairs(count, rows)
    best = np.sort(joint[joint > 0])[::-1][:count]
    np.testing.assert_allclose(np.exp(log_joint), best)
    np.testing.assert_allclose(joint[innovations, histories], best)


def test_an_association_counts_its_memory():
    a = association(n=5, m=7, d=2)
    assert a.nbytes == 8 * (5 * 2 + 5 + 7 * 2)
    particles = ParticleSet.uniform(np.zeros((5, 1, 2)))
    without, with_one = (
        StepRecord(None, particles, (Stage("associate", particles, association=joined),), None) for joined in (None, a)
    )
    assert with_one.nbytes == without.nbytes + a.nbytes


def record(n: int = 3, value: float = 0.0) -> StepRecord:
    before = ParticleSet.uniform(np.zeros((n, 1, 1)))
    after = ParticleSet.uniform(np.full((n, 1, 1), value))
    stages = (
        Stage("resample", before, np.arange(n), np.arange(n)),
        Stage("weight", after, np.arange(n), np.arange(n), {"likelihood": np.zeros(n)}),
    )
    return StepRecord(np.zeros(1), before, stages, 0.0)


def test_the_last_stage_is_the_posterior():
    step = record(value=2.0)
    assert step.posterior is step.stages[-1].particles
    assert step.estimate.tolist() == [2.0]
    assert step.stage("resample") is step.stages[0]
    assert step.stage("propose") is None
    assert step.association is None


def test_factors_cannot_be_written_to():
    with pytest.raises(ValueError, match="read-only"):
        record().stages[-1].log_factors["likelihood"][0] = 1.0


def test_effective_sample_size_is_that_of_the_weights_before_resampling():
    lonely = ParticleSet(np.zeros((2, 1, 1)), np.array([0.0, -np.inf]))
    resampled = lonely.take(np.zeros(2, dtype=int))
    step = StepRecord(None, lonely, (Stage("weight", lonely), Stage("resample", resampled)), None)
    assert step.effective_sample_size == pytest.approx(1.0)
    assert step.histories.tolist() == [-1, -1]


def test_a_trace_is_addressed_by_time():
    trace = Trace(ParticleSet.uniform(np.zeros((3, 1, 1))))
    assert trace.last == 0 and trace.particles is trace.initial
    for t in range(1, 6):
        trace.append(record(value=t))
    assert (trace.first, trace.last, len(trace)) == (1, 5, 5)
    assert trace[2].estimate.item() == 2.0
    trace.truncate(3)
    assert trace.last == 3 and trace.particles.mean.item() == 3.0
    with pytest.raises(IndexError, match="there are 1 to 3"):
        trace[4]


def test_a_trace_forgets_the_oldest_but_never_the_newest():
    one = record(n=1000)
    trace = Trace(one.previous, limit_bytes=3 * one.nbytes)
    for t in range(1, 11):
        trace.append(record(n=1000, value=t))
    assert (trace.first, trace.last) == (8, 10)
    assert [step.posterior.states.max() for step in trace] == [8.0, 9.0, 10.0]
    with pytest.raises(IndexError):
        trace[7]
    small = Trace(one.previous, limit_bytes=1)
    small.append(one)
    small.append(one)
    assert (small.first, small.last) == (2, 2)
    small.truncate(0)
    assert len(small) == 0 and small.particles is small.initial
