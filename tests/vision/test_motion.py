"""Dynamics of outlines by name, by coefficients, and learnt."""

from __future__ import annotations

import numpy as np
import pytest

from pfviz.dynamics import Autoregression, learn_dynamics
from pfviz.filters import make_filter
from pfviz.names import UnknownName
from pfviz.vision.motion import DYNAMICS, MotionScale, joined_motion, make_motion
from pfviz.vision.restart import Restarting
from pfviz.vision.scenes import Scene
from pfviz.vision.shapes import SHAPES
from pfviz.vision.track import track
from pfviz.vision.tracker import learn_tracker

PLACE = {2: np.array([90.0, 60.0]), 4: np.array([90.0, 60.0, 0.0, 0.0]), 6: np.array([90.0, 60.0, 0, 0, 0, 0])}


def motion(name: str, dimension: int = 4) -> Autoregression:
    return make_motion(name, MotionScale((240, 180), 30.0, 30.0, dimension), PLACE[dimension])


def ahead(dynamics: Autoregression, before: np.ndarray, now: np.ndarray, steps: int) -> np.ndarray:
    """Where the mean goes: ``(steps, k)``."""
    states = np.stack([now, before] + [before] * (dynamics.order - 2))[None, : dynamics.order]
    path = []
    for _ in range(steps):
        new = dynamics.predict(states)
        states = np.concatenate([new[:, None], states[:, :-1]], axis=1)
        path.append(new[0])
    return np.array(path)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene(0)


MOVING = np.array([3.0, -2.0, 0.1, 0.02])


@pytest.mark.parametrize(
    ("name", "first", "last"),
    [
        ("constant-position", [0, 0, 0], [0, 0, 0]),
        ("constant-velocity", [3, -2, 0.1], [3, -2, 0.1]),
        ("hand-held", [2.7, -1.8, 0.08], [0, 0, 0]),
    ],
)
def test_velocities_are_kept_as_the_name_says(name, first, last):
    now = PLACE[4] + [20.0, 10.0, 0.3, 0.1]
    path = np.vstack([now, ahead(motion(name), now - MOVING, now, 200)])
    velocity = np.diff(path, axis=0)
    np.testing.assert_allclose(velocity[0, :3], first, atol=1e-9)
    np.testing.assert_allclose(velocity[-1, :3], last, atol=1e-6)


def test_what_is_constrained_returns_to_the_start_and_the_rest_does_not():
    now = PLACE[4] + [20.0, 10.0, 0.3, 0.1]
    for name in DYNAMICS:
        end = ahead(motion(name), now, now, 1500)[-1]
        np.testing.assert_allclose(end[3], 0.0, atol=0.01)
        position = PLACE[4][:3] if name == "constrained" else now[:3]
        np.testing.assert_allclose(end[:3], position, atol=1e-3)


def test_the_constrained_process_is_that_of_the_lecture():
    """(x_t - m) is an autoregression of (x_{t-1} - m) and (x_{t-2} - m): the mean's own path stays at the mean."""
    dynamics = motion("constrained")
    np.testing.assert_allclose(ahead(dynamics, PLACE[4], PLACE[4], 5), np.tile(PLACE[4], (5, 1)), atol=1e-9)
    np.testing.assert_allclose(np.asarray(dynamics.mean), PLACE[4])


@pytest.mark.parametrize("shape", sorted(SHAPES))
@pytest.mark.parametrize("name", sorted(DYNAMICS))
def test_every_dynamics_goes_with_every_shape_space(scene, shape, name):
    model = learn_tracker(scene.read(140), scene.box(140), shape=shape, dynamics=name)
    k, order = SHAPES[shape], 1 if name == "constant-position" else 2
    assert model.dynamics.dimension == len(model.start) == k
    assert model.dynamics.order == order
    assert model.sample_prior(np.random.default_rng(0), 7).shape == (7, order, k)
    filter_ = Restarting(make_filter("rb-ss-hs-sir", n_particles=120))
    items = list(track(scene, model, filter_, 1, 140))
    x, y, *_ = scene.truth(149)
    assert np.hypot(items[-1].estimate.x - x, items[-1].estimate.y - y) < 15.0
    assert items[-1].record.posterior.states.shape == (120, order, k)


def test_any_autoregression_can_be_given(scene):
    third = Autoregression(np.stack([np.diag([a] * 4) for a in (2.5, -2.0, 0.5)]), np.diag([4.0, 4.0, 1e-3, 1e-4]))
    model = learn_tracker(scene.read(0), scene.box(0), dynamics=third)
    assert model.dynamics is third
    states = model.sample_prior(np.random.default_rng(0), 9)
    assert states.shape == (9, 3, 4)
    np.testing.assert_allclose(states[:, 0] - states[:, 1], states[:, 1] - states[:, 2], atol=1e-9)


def test_dynamics_of_positions_alone_leave_the_rest_hand_held(scene):
    truth = np.array([scene.truth(index)[:2] for index in range(scene.frame_count)])
    own = learn_dynamics(truth, 2)
    model = learn_tracker(scene.read(0), scene.box(0), dynamics=own)
    plain = learn_tracker(scene.read(0), scene.box(0))
    np.testing.assert_array_equal(model.dynamics.coefficients[:, :2, :2], own.coefficients)
    np.testing.assert_array_equal(model.dynamics.noise_covariance[:2, :2], own.noise_covariance)
    np.testing.assert_array_equal(model.dynamics.coefficients[:, 2:, 2:], plain.dynamics.coefficients[:, 2:, 2:])
    assert not model.dynamics.coefficients[:, :2, 2:].any()
    assert not model.dynamics.noise_covariance[:2, 2:].any()
    filter_ = Restarting(make_filter("rb-ss-hs-sir", n_particles=300))
    errors = []
    for item in track(scene, model, filter_, 0):
        errors.append(np.hypot(item.estimate.x - truth[item.frame, 0], item.estimate.y - truth[item.frame, 1]))
    assert np.median(errors) < 2.0


def test_orders_that_differ_are_joined_at_the_longer():
    first = Autoregression(0.5 * np.eye(2)[None], np.eye(2), np.array([1.0, 2.0]))
    joined = joined_motion(first, motion("hand-held"))
    assert joined.order == 2
    assert not joined.coefficients[1, :2].any()
    np.testing.assert_array_equal(joined.coefficients[0, :2, :2], 0.5 * np.eye(2))
    np.testing.assert_array_equal(np.asarray(joined.mean), [1.0, 2.0, 0.0, 0.0])


def test_what_does_not_fit_is_named(scene):
    with pytest.raises(ValueError, match="dynamics: of 4 components, but the shape space has 2"):
        learn_tracker(scene.read(0), scene.box(0), shape="translation", dynamics=motion("hand-held"))
    with pytest.raises(UnknownName, match="unknown dynamics 'konstant'"):
        learn_tracker(scene.read(0), scene.box(0), dynamics="konstant")
    with pytest.raises(UnknownName, match="unknown shape 'afine': did you mean 'affine'"):
        learn_tracker(scene.read(0), scene.box(0), shape="afine")
