"""Copies that resampling has made are drawn as one history with the sum of their weights, and nothing else changes."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pfviz.filters import steps
from pfviz.particles import ParticleSet


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


def test_a_copy_is_drawn_by_its_weight():
    weights = np.array([0.1, 0.3, 0.0, 0.2, 0.4])
    first, chosen = np.array([0, 1, 4]), np.repeat([1, 0, 2], 4000)
    drawn = steps.one_of_copies(weights, first, chosen, np.random.default_rng(0).random(len(chosen)))
    counts = np.bincount(drawn, minlength=5)
    assert counts[[0, 2, 4]].tolist() == [4000, 0, 4000]
    assert abs(counts[1] - 2400) < 5 * np.sqrt(4000 * 0.6 * 0.4)
