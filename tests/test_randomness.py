"""Random streams: replayable, and independent of one another."""

from itertools import product
from typing import get_args

import numpy as np
import pytest

from pfviz.randomness import Purpose, Streams, step_rng

PURPOSES = get_args(Purpose)


@pytest.mark.parametrize("purpose", PURPOSES)
def test_equal_seeds_give_equal_streams(purpose):
    first = Streams(step_rng(3, 7))
    second = Streams(step_rng(3, 7))
    assert first.of(purpose).bytes(64) == second.of(purpose).bytes(64)
    assert first.seed(purpose) == second.seed(purpose)


def test_a_stream_begins_anew_every_time():
    streams = Streams(step_rng(0, 1))
    streams.of("resample").random(100)
    assert streams.of("propose").bytes(8) == Streams(step_rng(0, 1)).of("propose").bytes(8)
    assert streams.of("propose").bytes(8) == streams.of("propose").bytes(8)


def test_every_seed_time_and_purpose_has_a_stream_of_its_own():
    keys = list(product(range(4), range(4), PURPOSES))
    draws = {Streams(step_rng(seed, t)).of(purpose).bytes(16) for seed, t, purpose in keys}
    seeds = {Streams(step_rng(seed, t)).seed(purpose) for seed, t, purpose in keys}
    assert len(draws) == len(seeds) == len(keys)


def test_streams_of_one_step_are_uncorrelated():
    streams = Streams(step_rng(1, 1))
    draws = np.array([streams.of(purpose).standard_normal(20_000) for purpose in PURPOSES])
    correlations = np.corrcoef(draws)[~np.eye(len(PURPOSES), dtype=bool)]
    assert np.abs(correlations).max() * np.sqrt(20_000) < 5.0


def test_neighbouring_steps_are_uncorrelated():
    draws = np.array([Streams(step_rng(1, t)).of("propose").standard_normal(20_000) for t in range(5)])
    correlations = np.corrcoef(draws)[~np.eye(5, dtype=bool)]
    assert np.abs(correlations).max() * np.sqrt(20_000) < 5.0


def test_a_generator_without_a_seed_sequence_serves_too():
    def legacy() -> np.random.Generator:
        return np.random.Generator(np.random.RandomState(5)._bit_generator)

    assert Streams(legacy()).of("prior").bytes(16) == Streams(legacy()).of("prior").bytes(16)


def test_two_sets_of_streams_from_one_generator_differ():
    rng = step_rng(0, 0)
    assert Streams(rng).of("propose").bytes(16) != Streams(rng).of("propose").bytes(16)
