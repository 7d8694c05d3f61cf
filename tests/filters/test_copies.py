"""Copies that resampling has made are drawn as one history with the sum of their weights, and nothing else changes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_one_step import SEEDS, one_step_z, setting

from pfviz.filters import FILTERS, make_filter, steps
from pfviz.particles import ParticleSet
from pfviz.randomness import step_rng

SAMPLING = [name for name in FILTERS if FILTERS[name].unbiased and "hs-sir" in name]


@given(st.lists(st.tuples(st.integers(0, 3), st.floats(0.0, 1.0)), min_size=1, max_size=30))
def test_neighbours_of_equal_state_are_merged(rows):
    weights = np.array([weight for _, weight in rows]) + 1e-6
    values = np.array([value for value, _ in rows], dtype=float)
    particles = ParticleSet(np.stack([values, 2 * values], axis=1)[:, :, None], np.log(weights / weights.sum()))
    first, log_weights = steps.merged_copies(particles)
    runs = [i for i in range(len(rows)) if i == 0 or rows[i][0] != rows[i - 1][0]]
    assert first.tolist() == runs
    ends = [*runs[1:], len(rows)]
    expected = [particles.weights[start:end].sum() for start, end in zip(runs, ends, strict=True)]
    np.testing.assert_allclose(np.exp(log_weights), expected, rtol=1e-9)


def copied(seed=0):
    """The particles of ``setting``, resampled: many copies side by side."""
    model, particles, observation = setting(2, 2, (1,))
    chosen = np.sort(
        np.random.default_rng(seed).choice(
            len(particles), len(particles), p=particles.weights**2 / (particles.weights**2).sum()
        )
    )
    return model, particles.take(chosen), observation


@pytest.mark.parametrize("name", SAMPLING)
def test_a_step_from_copies_is_unbiased(name):
    z = one_step_z(name, *copied(), seeds=SEEDS // 2)
    assert max(map(abs, z.values())) < 5, z


def test_the_mixture_is_that_of_all_copies():
    model, particles, observation = copied()
    record = make_filter("rb-ss-hs-sir", len(particles)).step(step_rng(0, 1), model, particles, observation)
    association = record.association
    expected = np.logaddexp.reduce(association.log_joint(np.arange(len(particles))), axis=1)
    np.testing.assert_allclose(record.stage("weight").log_factors["mixture"], expected, atol=1e-3)
    first, _ = steps.merged_copies(particles)
    assert len(first) < 0.8 * len(particles)
    assert not set(association.chosen.tolist()) <= set(first.tolist()), "any of the copies may be drawn"


def test_a_copy_is_drawn_by_its_weight():
    weights = np.array([0.1, 0.3, 0.0, 0.2, 0.4])
    first, chosen = np.array([0, 1, 4]), np.repeat([1, 0, 2], 4000)
    drawn = steps.one_of_copies(weights, first, chosen, np.random.default_rng(0).random(len(chosen)))
    counts = np.bincount(drawn, minlength=5)
    assert counts[[0, 2, 4]].tolist() == [4000, 0, 4000]
    assert abs(counts[1] - 2400) < 5 * np.sqrt(4000 * 0.6 * 0.4)
