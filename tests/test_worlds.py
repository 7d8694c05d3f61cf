"""The toy worlds: seeded, described, and showing what they say."""

import numpy as np
import pytest

from pfviz.dynamics import Autoregression
from pfviz.exact import Gaussian, GridStep, KalmanStep
from pfviz.filters import FILTERS, make_filter
from pfviz.model import Model
from pfviz.names import UnknownName
from pfviz.observations import GaussianObservation, SquaredObservation
from pfviz.running import run
from pfviz.worlds import WORLDS, Detector, Jumps, RootDetector, ToyModel, World, get_world

every_world = pytest.mark.parametrize("world", WORLDS.values(), ids=list(WORLDS))


@every_world
def test_a_world_is_a_model_with_a_sentence_on_what_to_look_for(world: World):
    assert isinstance(world.model, Model)
    assert WORLDS[world.name] is world
    assert world.title and len(world.look_for.split()) > 8 and world.look_for[-1] in ".?"


@every_world
def test_a_seed_gives_one_recording(world: World):
    first, again, other = world.record(1, 10), world.record(1, 10), world.record(2, 10)
    assert len(first) == 10 and first.truth.shape == (10, world.model.dynamics.dimension)
    assert first.truth.tobytes() == again.truth.tobytes()
    assert all(a.tobytes() == b.tobytes() for a, b in zip(first.observations, again.observations, strict=True))
    assert first.truth.tobytes() != other.truth.tobytes()
    longer = world.record(1, 20)
    assert longer.truth[:10].tobytes() == first.truth.tobytes()


@every_world
def test_the_truth_stays_in_the_picture(world: World):
    outside = [np.abs(world.record(seed, 100).truth) > world.extent for seed in range(20)]
    assert np.mean(outside) < 0.02


@every_world
def test_the_proposal_covers_the_observation(world: World):
    recording = world.record(0, 20)
    for truth, observation in zip(recording.truth, recording.observations, strict=True):
        log_density = world.model.proposal(observation).log_density(truth[None])
        assert np.isfinite(log_density).all()


@pytest.mark.parametrize("filter_name", FILTERS)
@every_world
def test_every_filter_runs_in_every_world(world: World, filter_name: str):
    recording = world.record(0, 5)
    for record in run(make_filter(filter_name, 50), world.model, recording.observations):
        assert np.isfinite(record.estimate).all()


@every_world
def test_noises_are_scaled(world: World):
    model = world.model.with_noise(system=2.0, observation=3.0, proposal=0.5)
    np.testing.assert_allclose(model.dynamics.noise_covariance, 4.0 * world.model.dynamics.noise_covariance)
    observation = world.record(0, 1).observations[0]
    narrow, wide = model.proposal(observation), world.model.proposal(observation)
    np.testing.assert_allclose(4.0 * narrow.covariance, wide.covariance)


def test_a_detector_answers_around_what_it_detects():
    detector = Detector(0.5, np.array([[-1.0, 0.0], [1.0, 0.0]]), np.array([3.0, 1.0]), gain=0.5)
    one = detector(np.array([2.0, 4.0]))
    np.testing.assert_allclose(one.means, [[0.0, 2.0], [2.0, 2.0]])
    np.testing.assert_allclose(one.weights, [0.75, 0.25])
    two = detector(np.array([[2.0, 4.0], [0.0, 0.0]]))
    np.testing.assert_allclose(two.means, [[0.0, 2.0], [2.0, 2.0], [-1.0, 0.0], [1.0, 0.0]])
    np.testing.assert_allclose(two.weights, [0.375, 0.125, 0.375, 0.125])


def test_basic_sir_wastes_its_particles_where_history_sampling_does_not():
    """The world of Figures 1 and 2: the mean ESS over a recording, as a share of N."""
    world = get_world("figure-1")
    share = {}
    for name in ("basic-sir", "rb-hs-sir"):
        sizes = [
            record.effective_sample_size / world.n_particles
            for seed in range(5)
            for record in run(
                make_filter(name, world.n_particles), world.model, world.record(seed, 30).observations, seed
            )
        ]
        share[name] = np.mean(sizes)
    assert share["basic-sir"] < 0.25
    assert share["rb-hs-sir"] > 2 * share["basic-sir"]


def records_of(world: World, name: str, seeds: int, steps: int):
    """Every record of a filter in a world, with the truth."""
    for seed in range(seeds):
        recording = world.record(seed, steps)
        records = run(make_filter(name, world.n_particles), world.model, recording.observations, seed)
        yield list(zip(records, recording.truth, strict=True))


def rms_error(world: World, name: str, seeds: int, steps: int) -> float:
    squares = [
        float(np.sum((record.estimate - truth) ** 2))
        for film in records_of(world, name, seeds, steps)
        for record, truth in film
    ]
    return float(np.sqrt(np.mean(squares)))


def test_recovery_the_detector_finds_the_target_again():
    """Steps from the jump until the estimate is within two deviations of the observation noise."""
    world = get_world("recovery")
    steps = {}
    for name in ("condensation", "rb-hs-sir"):
        lost = []
        for film in records_of(world, name, seeds=6, steps=45):
            errors = np.array([abs((record.estimate - truth).item()) for record, truth in film])[24:]
            lost.append(int(np.argmax(errors < 0.6)) if (errors < 0.6).any() else len(errors))
        steps[name] = np.mean(lost)
    assert steps["rb-hs-sir"] < 2.5 and steps["condensation"] > 2 * steps["rb-hs-sir"] + 1


def test_wrong_noise_hurts_condensation_and_not_history_sampling():
    world = get_world("wrong-noise")
    assert world.actual is not None
    condensation, history = (rms_error(world, name, 8, 50) for name in ("condensation", "rb-hs-sir"))
    assert condensation > 1.15 * history
    exact = []
    for seed in range(8):
        recording, state = world.record(seed, 50), world.model.prior
        for truth, observation in zip(recording.truth, recording.observations, strict=True):
            step = world.model.exact_step(state, observation)
            assert isinstance(step, KalmanStep)
            state = step.posterior
            exact.append(float((state.mean[0] - truth[0]) ** 2))
    assert history < 1.1 * np.sqrt(np.mean(exact))


def test_two_modes_die_sooner_in_condensation():
    """The share of steps in which both signs have more than a twentieth of the weight; exactly, each has a half."""
    world = get_world("two-modes")
    alive = {}
    for name in ("condensation", "rb-hs-sir"):
        positive = np.array(
            [
                record.posterior.weights[record.posterior.innovation[:, 0] > 0].sum()
                for film in records_of(world, name, seeds=15, steps=40)
                for record, _ in film
            ]
        )
        alive[name] = np.mean(np.minimum(positive, 1 - positive) > 0.05)
    assert alive["rb-hs-sir"] > alive["condensation"] + 0.05


def test_two_modes_are_equal_in_the_exact_posterior():
    world = get_world("two-modes")
    state = world.model.prior
    for observation in world.record(0, 10).observations:
        step = world.model.exact_step(state, observation)
        assert isinstance(step, GridStep) and step.error < 1e-5
        state = step.posterior
        assert abs(state.mean.item()) < 1e-8


def test_jumps_go_to_the_other_side_velocity_and_all():
    jumps = Jumps(25, np.array([3.0]))
    moved = jumps.displace(np.array([[[1.0], [0.5]]]), np.zeros(1))
    assert moved.tolist() == [[[-2.0], [-2.5]]]
    truth = get_world("recovery").record(0, 60).truth[:, 0]
    steps = np.abs(np.diff(truth))
    assert set(np.flatnonzero(steps > 1.5) + 2) == {25, 50}


def test_nothing_is_seen_of_a_hidden_target():
    world = get_world("occlusion")
    missing = [bool(np.isnan(seen).all()) for seen in world.record(0, 130).observations]
    hidden = [*range(51, 63), *range(113, 125)]
    assert [t for t, nothing in enumerate(missing, start=1) if nothing] == hidden
    conditions = [record.condition for record, _ in next(records_of(world, "condensation", 1, 70))]
    assert [t for t, condition in enumerate(conditions, start=1) if condition == "missing"] == hidden[:12]


def test_the_cloud_spreads_while_the_target_is_hidden_as_the_exact_posterior_does():
    world = get_world("occlusion")
    assert world.occlusion is not None
    spread = np.array(
        [
            [np.sqrt(film[t - 1][0].posterior.covariance[0, 0]) for t in (50, 62, 63)]
            for film in records_of(world, "rb-hs-sir", seeds=20, steps=63)
        ]
    )
    state, exact = world.model.prior, []
    for observation in world.record(0, 63).observations:
        step = world.model.exact_step(state, observation)
        assert isinstance(step, KalmanStep)
        state = step.posterior
        exact.append(np.sqrt(state.covariance[0, 0]))
    standard_error = spread.std(axis=0, ddof=1) / np.sqrt(len(spread))
    assert (np.abs(spread.mean(axis=0) - np.array(exact)[[49, 61, 62]]) < 5 * standard_error + 0.003).all()
    assert exact[61] > 10 * exact[49] and exact[62] < 1.5 * exact[49]


def test_a_peaked_likelihood_is_for_those_who_search_it():
    """The mean ESS as a share of N."""
    world = get_world("peaked")
    share = {
        name: np.mean([r.effective_sample_size for film in records_of(world, name, 4, 20) for r, _ in film]) / 100
        for name in ("condensation", "rb-hs-sir", "ls-hs-sir", "unscented")
    }
    assert max(share["condensation"], share["rb-hs-sir"]) < 0.08
    assert share["ls-hs-sir"] > 1.5 * share["condensation"] and share["unscented"] > 0.7


def test_a_world_of_ones_own_in_a_few_lines():
    dynamics = Autoregression.scalar([0.9], noise=0.2)
    model = ToyModel(
        dynamics,
        SquaredObservation(np.array([[0.1]])),
        RootDetector(0.2),
        Gaussian(np.ones(1), np.eye(1)),
    )
    world = World("mine", "Mine", "Something to look for.", model, extent=3.0, n_particles=30)
    observations = world.record(0, 3).observations
    assert [record.condition for record in run(make_filter("rb-hs-sir", 30), model, observations)] == [None] * 3


@pytest.mark.parametrize(
    ("prior", "covariance", "message"),
    [
        (np.eye(3), np.eye(1), "prior must have 2 dimensions for order 2 in 1 dimensions, got 3"),
        (np.eye(2), np.eye(2), r"observation covariance must have shape \(1, 1\), got \(2, 2\)"),
    ],
)
def test_a_model_whose_parts_do_not_fit_is_refused(prior, covariance, message):
    with pytest.raises(ValueError, match=message):
        ToyModel(
            Autoregression.scalar([0.5, 0.1], noise=1.0),
            GaussianObservation(covariance),
            RootDetector(1.0),
            Gaussian(np.zeros(len(prior)), prior),
        )


@every_world
def test_which_exact_answer_there_is(world: World):
    expected = {"plane": None, "two-modes": "grid"}.get(world.name, "kalman")
    assert world.model.exact == expected
    step = world.model.exact_step(world.model.prior, world.record(0, 1).observations[0])
    assert {None: type(None), "kalman": KalmanStep, "grid": GridStep}[expected] is type(step)


def test_zero_steps_are_refused():
    with pytest.raises(ValueError, match="steps must be at least 1, got 0"):
        get_world("plane").record(0, 0)


def test_the_nearest_world_is_suggested():
    with pytest.raises(UnknownName, match="did you mean 'plane'"):
        get_world("plan")
