"""The arrows that are drawn, against all of them worked out one by one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pfviz_app.stage.links import made_links, possible_links, sample_evenly
from pfviz_app.stage.seen import Seen
from scipy.stats import multivariate_normal

from pfviz.filters import FILTERS, make_filter
from pfviz.running import run
from pfviz.worlds import WORLDS

SAMPLING = ["rb-hs-sir", "rb-ss-hs-sir"]


def third_record(filter_name, world, n_particles=30):
    model = WORLDS[world].model
    observations = WORLDS[world].record(4, 3).observations
    return model, list(run(make_filter(filter_name, n_particles), model, observations, seed=2))[-1]


def proposed_of(record):
    stage = record.stage("propose") or record.stage("predict")
    return stage.particles.innovation


@pytest.mark.parametrize("world", ["figure-1", "plane"])
@pytest.mark.parametrize("filter_name", FILTERS)
def test_every_join_that_was_made_is_an_arrow(filter_name, world):
    """Each new particle is the innovation at the tip of its arrow on the history at the foot of it."""
    _, record = third_record(filter_name, world)
    sources, targets, _ = Seen(record).joins()
    made = made_links(record, 1000)
    np.testing.assert_array_equal(made.sources, sources[sources >= 0])
    np.testing.assert_array_equal(made.targets, targets[sources >= 0])
    assert ((made.strengths >= 0) & (made.strengths <= 1)).all()
    states = (record.stage("complete") or record.stage("predict")).particles.states
    assert len(states) == len(sources) == 30
    np.testing.assert_array_equal(states[:, 0], proposed_of(record)[targets])
    kept = sources >= 0
    np.testing.assert_array_equal(states[kept, 1:], record.previous.states[sources[kept], :-1])


@pytest.mark.parametrize("filter_name", FILTERS)
def test_a_new_particle_is_traced_to_the_one_that_was_weighed(filter_name):
    _, record = third_record(filter_name, "figure-1")
    after = Seen(record).after()
    weighed = record.stage("weight").particles
    np.testing.assert_array_equal(after.particles.innovation, weighed.innovation[after.weighed])


@pytest.mark.parametrize("world", ["figure-1", "plane"])
@pytest.mark.parametrize("filter_name", ["basic-sir", *SAMPLING])
def test_an_arrow_is_as_strong_as_its_history_explains_the_innovation(filter_name, world):
    model, record = third_record(filter_name, world)
    made = made_links(record, 1000)
    proposed, dynamics = proposed_of(record), model.dynamics
    for source, target, strength in zip(made.sources, made.targets, made.strengths, strict=True):
        mean = dynamics.predict(record.previous.states[[source]])[0]
        density = multivariate_normal(mean, dynamics.noise_covariance)
        assert strength == pytest.approx(density.pdf(proposed[target]) / density.pdf(mean), abs=1e-12)


@pytest.mark.parametrize("world", ["figure-1", "plane"])
@pytest.mark.parametrize("filter_name", SAMPLING)
@pytest.mark.parametrize("count", [1, 17, 90])
def test_the_most_probable_joins_are_those_of_the_whole_matrix(filter_name, world, count):
    model, record = third_record(filter_name, world)
    previous, proposed = record.previous, proposed_of(record)
    possible = possible_links(record, count)
    rows = sample_evenly(len(proposed), max(count // 3, 8))
    means = model.dynamics.predict(previous.states)
    density = multivariate_normal(np.zeros(means.shape[1]), model.dynamics.noise_covariance)
    matrix = np.array(
        [[w * density.pdf(proposed[i] - m) for w, m in zip(previous.weights, means, strict=True)] for i in rows]
    )
    strongest = np.sort(matrix.ravel())[::-1][: len(possible.sources)]
    assert len(possible.sources) == min(count, matrix.size)
    np.testing.assert_allclose(possible.strengths, strongest / strongest[0], rtol=1e-6, atol=1e-12)
    place = {int(row): i for i, row in enumerate(rows)}
    drawn = [matrix[place[int(t)], s] for s, t in zip(possible.sources, possible.targets, strict=True)]
    np.testing.assert_allclose(drawn, strongest, rtol=1e-6, atol=1e-300)
    pairs = set(zip(possible.sources.tolist(), possible.targets.tolist(), strict=True))
    assert len(pairs) == len(possible.sources)


@pytest.mark.parametrize("filter_name", ["condensation", "basic-sir"])
def test_where_histories_are_not_sampled_no_join_is_merely_possible(filter_name):
    _, record = third_record(filter_name, "figure-1")
    assert len(possible_links(record, 100).sources) == 0


def test_where_nothing_was_associated_no_histories_could_be_chosen():
    _, record = third_record("condensation", "figure-1")
    with pytest.raises(ValueError, match="nothing was associated"):
        _ = record.origins


@pytest.mark.parametrize("filter_name", FILTERS)
def test_no_arrows_where_none_are_wanted(filter_name):
    _, record = third_record(filter_name, "figure-1")
    assert len(made_links(record, 0).sources) == len(possible_links(record, 0).sources) == 0


@pytest.mark.parametrize("filter_name", FILTERS)
@pytest.mark.parametrize("count", [1, 7, 29])
def test_fewer_arrows_are_some_of_all(filter_name, count):
    _, record = third_record(filter_name, "figure-1")
    everything, some = made_links(record, 1000), made_links(record, count)
    assert 0 < len(some.sources) <= count
    arrows = dict(zip(zip(everything.sources, everything.targets, strict=True), everything.strengths, strict=True))
    for source, target, strength in zip(some.sources, some.targets, some.strengths, strict=True):
        assert strength == pytest.approx(arrows[source, target], rel=1e-9, abs=1e-12)


@given(st.integers(0, 500), st.integers(1, 500))
def test_an_even_sample_spans_the_whole(total, count):
    some = sample_evenly(total, count)
    assert len(some) == min(total, count)
    assert (np.diff(some) > 0).all()
    if total and count > 1:
        assert some[0] == 0 and some[-1] == total - 1
        assert np.ptp(np.diff(some)) <= 1 if len(some) > 1 else True
