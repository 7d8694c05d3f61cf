"""One step from weighted histories, against the exact mixture of Gaussians that it estimates.

The sources call a filter unbiased if E[sum_i w_i h(x_i)] is right for every h, with weights that are not normalised.
For one step from a fixed particle set and a linear-Gaussian model the right answer is known in closed form, for any
number of particles. h looks at the innovation, at the history it was joined to, and at both together.
"""

import numpy as np
import pytest
from oracles import OneStep, measured, random_model, z_scores

from pfviz.filters import FILTERS, make_filter, steps
from pfviz.particles import ParticleSet
from pfviz.randomness import step_rng
from pfviz.worlds import ToyModel

N = 100
SEEDS = 300
UNBIASED = [name for name, info in FILTERS.items() if info.unbiased]
MODELS = {
    "order 1": (1, 1, None),
    "order 2": (2, 1, None),
    "plane": (2, 2, None),
    "subspace of two": (2, 2, (1,)),
    "subspace of three": (1, 3, (0, 2)),
}


def setting(order: int, dimension: int, components: tuple[int, ...] | None):
    """A random model, unevenly weighted histories about its mean, the first quarter apart, and an observation."""
    rng = np.random.default_rng([order, dimension, *(components or ())])
    model = random_model(rng, order, dimension, components)
    states = np.asarray(model.dynamics.mean) + rng.standard_normal((N, order, dimension))
    states[: N // 4] += 1.5
    weights = rng.random(N) * np.where(np.arange(N) < N // 4, 4.0, 1.0)
    particles = ParticleSet(states, np.log(weights / weights.sum()))
    return model, particles, np.asarray(model.dynamics.mean) + 0.5


def one_step_z(name: str, model: ToyModel, particles: ParticleSet, observation, seeds=SEEDS, **settings):
    """The z-score of each unnormalised estimate."""
    filter_ = make_filter(name, len(particles), **settings)
    estimates = [measured(filter_.step(step_rng(seed, 1), model, particles, observation)) for seed in range(seeds)]
    expected = OneStep.of(model, particles, observation).expectations()
    return {key: float(z_scores(np.array([e[key] for e in estimates]), value)) for key, value in expected.items()}


@pytest.mark.parametrize("case", MODELS)
@pytest.mark.parametrize("name", UNBIASED)
def test_unnormalised_estimates_are_unbiased(name, case):
    z = one_step_z(name, *setting(*MODELS[case]))
    assert max(map(abs, z.values())) < 5, z


def copied(seed=0):
    """The particles of ``setting``, resampled: many copies side by side."""
    model, particles, observation = setting(2, 2, (1,))
    chosen = np.sort(
        np.random.default_rng(seed).choice(
            len(particles), len(particles), p=particles.weights**2 / (particles.weights**2).sum()
        )
    )
    return model, particles.take(chosen), observation


@pytest.mark.parametrize("name", [name for name in UNBIASED if "hs-sir" in name])
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
