"""The tracker from end to end: it follows objects whose place is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from vision_clips import clip

from pfviz.filters import make_filter
from pfviz.model import Model, Proposal
from pfviz.particles import ParticleSet
from pfviz.randomness import step_rng
from pfviz.vision.motion import hand_held_motion
from pfviz.vision.presence import AT_START, NOT_YET_FOUND
from pfviz.vision.scenes import Scene
from pfviz.vision.shapes import transforms
from pfviz.vision.track import track
from pfviz.vision.tracker import (
    MODELS,
    TrackerModel,
    TrackerOptions,
    dominant_mean,
    learn_tracker,
)
from pfviz.vision.video import open_source


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene(0)


@pytest.fixture(scope="module")
def model(scene) -> TrackerModel:
    return learn_tracker(scene.read(0), scene.box(0), frame_rate=scene.frame_rate)


def true_state(scene: Scene, index: int) -> np.ndarray:
    x, y, rotation, scale = scene.truth(index)
    return np.array([x, y, rotation, np.log(scale)])


@pytest.mark.parametrize("name", ["rb-ss-hs-sir", "condensation"])
def test_the_object_in_the_scene_is_followed_past_its_twin(scene, model, name):
    errors = []
    for item in track(scene, model, make_filter(name, n_particles=400), seed=1):
        x, y, rotation, scale = scene.truth(item.frame)
        estimate = item.estimate
        errors.append((np.hypot(estimate.x - x, estimate.y - y), estimate.rotation - rotation, estimate.scale / scale))
    distance, turn, ratio = np.array(errors).T
    assert (distance < 50.0).all()
    assert np.median(distance) < 2.0
    assert np.median(np.abs(turn)) < 0.15
    assert np.median(ratio) == pytest.approx(1.0, abs=0.08)


@pytest.mark.parametrize("name", sorted(MODELS))
def test_every_measurement_prefers_the_truth(scene, name):
    model = learn_tracker(scene.read(0), scene.box(0), model=name)
    for index in (0, 20, 40):
        features = model.observe(scene.read(index))
        truth = true_state(scene, index)
        away = truth + np.random.default_rng(index).normal(0.0, [12.0, 12.0, 0.5, 0.3], (300, 4))
        away = away[np.hypot(*(away - truth)[:, :2].T) > 6.0]
        at_truth = model.log_likelihood(truth[None], features)[0]
        assert (model.log_likelihood(away, features) < at_truth).mean() > 0.98


def test_the_parts_of_the_likelihood_are_those_of_the_models_name(scene):
    image, later = scene.read(0), scene.read(1)
    for name in MODELS:
        model = learn_tracker(image, scene.box(0), model=name)
        filter_ = make_filter("rb-ss-hs-sir", n_particles=50)
        particles = filter_.initial(np.random.default_rng(0), model)
        record = filter_.step(np.random.default_rng(1), model, particles, model.observe(image))
        following = model.given(model.presence(AT_START, record))
        features = following.observe(later)
        states = record.posterior.innovation
        parts = following.log_likelihood_parts(states, features)
        assert set(parts) == set(name.split("+"))
        np.testing.assert_allclose(sum(parts.values()), following.log_likelihood(states, features))
        assert set(model.log_likelihood_parts(states, features)) == set(name.split("+")) - {"motion"}


def test_implicit_motion_compares_with_the_estimate_before_unless_that_was_lost(scene):
    model = learn_tracker(scene.read(140), scene.box(140), model="contour+motion")
    filter_ = make_filter("rb-ss-hs-sir", n_particles=100)
    *_, before, item = list(track(scene, model, filter_, 0, 140))
    assert before.presence.patch is not None
    following = model.given(before.presence)
    motion = model.motion_likelihood
    expected = motion.patch(
        transforms(before.estimate.state[None], model.extractor.working_scale)[0], before.record.observation.grey
    )
    np.testing.assert_array_equal(following.patch_before, expected)
    again = filter_.step(step_rng(0, 10), following, item.record.previous, item.record.observation)
    np.testing.assert_array_equal(again.posterior.log_weights, item.record.posterior.log_weights)
    lost = replace(before.presence, tracked=False)
    assert model.presence_rule.after(lost, -1e9).patch is None
    assert model.given(NOT_YET_FOUND).patch_before is None


def test_the_model_is_a_model(scene, model):
    assert isinstance(model, Model)
    features = model.observe(scene.read(0))
    assert isinstance(model.proposal(features), Proposal)
    assert features.nbytes > 10_000
    assert features.edges.shape == (180, 240)
    assert set(np.unique(features.edges)) == {0, 1}


def test_the_prior_arrives_at_the_box(scene, model):
    rng = np.random.default_rng(0)
    states = model.sample_prior(rng, 20_000)
    assert states.shape == (20_000, 2, 4)
    arriving = 2 * states[:, 0] - states[:, 1]
    spread = arriving.std(axis=0)
    assert (np.abs(arriving.mean(axis=0) - model.start) < 5 * spread / np.sqrt(20_000)).all()
    np.testing.assert_allclose(spread, model.prior_deviation[0], rtol=0.05)


def test_the_box_of_the_start_is_the_box_that_was_given(scene, model):
    assert model.estimate_of(model.start).box == pytest.approx(scene.box(0), abs=3.0)


def test_a_clicked_outline_is_used_as_it_is(scene):
    model = learn_tracker(scene.read(0), polygon=scene.outline(0)[::8])
    np.testing.assert_allclose(model.start[:2], scene.truth(0)[:2], atol=0.5)
    assert model.estimate_of(model.start).box == pytest.approx(scene.box(0), abs=1.5)


def test_noise_factors_reach_their_places(scene, model):
    noisy = model.with_noise(system=2.0, observation=3.0, proposal=1.5)
    np.testing.assert_allclose(noisy.dynamics.noise_covariance, 4.0 * model.dynamics.noise_covariance)
    features = model.observe(scene.read(0))
    states = model.start + np.random.default_rng(0).normal(0.0, [9, 9, 0.3, 0.1], (50, 4))
    np.testing.assert_allclose(noisy.log_likelihood(states, features), model.log_likelihood(states, features) / 9.0)
    flatter = noisy.observe(scene.read(0)).proposal.probabilities
    assert flatter.max() < features.proposal.probabilities.max()
    same = model.with_noise()
    np.testing.assert_array_equal(same.dynamics.noise_covariance, model.dynamics.noise_covariance)


def test_motion_is_scaled_to_frame_object_and_rate():
    small, large = hand_held_motion((240, 180), 30.0, 30.0), hand_held_motion((480, 360), 60.0, 30.0)
    ratio = np.sqrt(np.diag(large.noise_covariance) / np.diag(small.noise_covariance))
    np.testing.assert_allclose(ratio, [2.0, 2.0, 1.0, 1.0])
    slow = hand_held_motion((240, 180), 30.0, 15.0)
    np.testing.assert_allclose(np.diag(slow.noise_covariance), 4.0 * np.diag(small.noise_covariance))
    np.testing.assert_allclose(np.diag(slow.coefficients[1]), -(np.diag(small.coefficients[1]) ** 2))


def test_the_log_scale_returns_to_its_mean_and_the_rest_does_not():
    motion = hand_held_motion((240, 180), 30.0, 30.0, TrackerOptions(scale_spring=0.05))
    state = np.full((1, 2, 4), 1.0)
    for _ in range(300):
        state = np.stack([motion.predict(state), state[:, 0]], axis=1)
    np.testing.assert_allclose(state[0, 0], [1.0, 1.0, 1.0, 0.0], atol=1e-3)


def test_the_mean_of_one_mode_is_the_mean():
    rng = np.random.default_rng(0)
    log_weights = np.log(rng.dirichlet(np.ones(200)))
    particles = ParticleSet(rng.normal([100, 80, 0, 0], [2, 2, 0.1, 0.1], (200, 1, 4)), log_weights)
    np.testing.assert_allclose(dominant_mean(particles, 40.0), particles.mean)


@pytest.mark.parametrize("away", [160.0, 1.6e9])
@pytest.mark.parametrize("share", [0.6, 0.9])
def test_of_two_modes_the_heavier_is_reported(share, away):
    rng = np.random.default_rng(1)
    centres = np.array([[60.0, 60.0, 0.5, 0.0], [away, 0.6 * away, -0.5, 0.1]])
    states = np.concatenate([rng.normal(c, [2, 2, 0.05, 0.02], (100, 4)) for c in centres])
    weights = np.repeat([1.0 - share, share], 100) / 100
    found = dominant_mean(ParticleSet(states[:, None], np.log(weights)), 30.0)
    np.testing.assert_allclose(found, states[100:].mean(axis=0))


def test_grey_video_of_any_size_can_be_tracked():
    rng = np.random.default_rng(2)
    y, x = np.mgrid[0:90, 0:130]

    def frame(index: int) -> np.ndarray:
        disc = np.hypot(x - 40 - 1.5 * index, y - 45) < 12
        grey = np.where(disc, 190, 70) + rng.normal(0, 5, disc.shape)
        return np.repeat(np.clip(grey, 0, 255).astype(np.uint8)[..., None], 3, axis=2)

    pictures = [frame(index) for index in range(25)]
    model = learn_tracker(pictures[0], (28, 33, 24, 24), frame_rate=25.0)
    filter = make_filter("rb-ss-hs-sir", n_particles=200)
    particles = filter.initial(np.random.default_rng(0), model)
    for t, picture in enumerate(pictures):
        record = filter.step(np.random.default_rng([0, t]), model, particles, model.observe(picture))
        particles = record.posterior
    estimate = model.estimate(record)
    assert np.hypot(estimate.x - 76.5, estimate.y - 45.5) < 3.0


def test_a_frame_of_another_size_is_refused(model):
    with pytest.raises(ValueError, match=r"expected a frame of \(240, 180\), got \(64, 48\)"):
        model.observe(np.zeros((48, 64, 3), np.uint8))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"box": (300, 10, 20, 20)}, r"box 300,10,20,20: its centre lies outside the frame of 240 x 180"),
        ({"box": (10, 10, 0, 20)}, r"box 10,10,0,20: width and height must be positive"),
        ({}, "box or an outline"),
        ({"box": (50, 50, 20, 20), "model": "contuor"}, "did you mean 'contour'"),
    ],
)
def test_what_cannot_be_learnt_is_explained(scene, settings, message):
    with pytest.raises(ValueError, match=message):
        learn_tracker(scene.read(0), **settings)


@pytest.mark.parametrize(
    ("name", "start", "box", "frames"),
    [("flask", 0, (308, 124, 107, 259), 70), ("greenball", 50, (515, 223, 54, 52), 70)],
)
def test_a_real_object_is_followed(name, start, box, frames):
    real = clip(name, start, box)
    near = []
    with open_source(real.path) as source:
        model = learn_tracker(source.read(start), box, frame_rate=source.frame_rate)
        for item in track(source, model, make_filter("rb-ss-hs-sir", n_particles=400), 0, start):
            if item.frame in real.centres:
                near.append(real.distance(item.frame, item.estimate.x, item.estimate.y) <= 15.0)
            if item.frame >= start + frames:
                break
    assert len(near) > 40
    assert np.mean(near) >= 0.95
