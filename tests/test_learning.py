"""Learning dynamics: known coefficients are found again, as surely as is said."""

from __future__ import annotations

import numpy as np
import pytest

from pfviz.dynamics import Autoregression, fit_dynamics, learn_dynamics, read_states

SPIRAL = np.array([[0.95, -0.2], [0.2, 0.95]])
PLANE = Autoregression(
    np.stack([1.6 * SPIRAL, -0.7 * SPIRAL @ SPIRAL]), np.array([[2.0, 0.8], [0.8, 1.0]]), np.array([30.0, -12.0])
)
LINE = Autoregression.scalar([1.5, -0.6], 2.0, mean=7.0)
FIRST = Autoregression(0.9 * SPIRAL[None], np.eye(2))


def a_run(dynamics: Autoregression, steps: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    state = np.repeat(np.asarray(dynamics.mean)[None, None], dynamics.order, axis=1)
    states = []
    for _ in range(steps + 200):
        new = dynamics.sample(rng, state)
        state = np.concatenate([new[:, None], state[:, :-1]], axis=1)
        states.append(new[0])
    return np.array(states[200:])


@pytest.mark.parametrize("truth", [PLANE, LINE, FIRST], ids=["plane", "line", "first order"])
def test_known_coefficients_are_found_within_their_standard_errors(truth):
    scores = []
    for seed in range(40):
        fitted = fit_dynamics(a_run(truth, 400, seed), truth.order)
        scores.append((fitted.dynamics.coefficients - truth.coefficients) / fitted.standard_errors)
    scores = np.array(scores)
    assert np.abs(scores).max() < 6.0
    assert np.square(scores).mean() == pytest.approx(1.0, abs=0.35)
    assert np.abs(scores.mean(axis=0)).max() < 5.0 / np.sqrt(40) + 0.3  # the small bias of any AR fit


@pytest.mark.parametrize("truth", [PLANE, LINE], ids=["plane", "line"])
def test_noise_and_mean_are_found(truth):
    fits = [learn_dynamics(a_run(truth, 3000, seed), truth.order) for seed in range(8)]
    covariance = np.array([fit.noise_covariance for fit in fits])
    mean = np.array([fit.mean for fit in fits])
    for found, known in ((covariance, truth.noise_covariance), (mean, np.asarray(truth.mean))):
        error = found.std(axis=0, ddof=1) / np.sqrt(len(fits))
        assert (np.abs(found.mean(axis=0) - known) < 5.5 * error).all()


def test_the_likelihood_is_that_of_the_states_and_the_largest():
    states = a_run(PLANE, 60, 0)
    fitted = fit_dynamics(states, 2)

    def log_likelihood(dynamics: Autoregression) -> float:
        pairs = np.stack([states[1:-1], states[:-2]], axis=1)
        return float(dynamics.log_transition(states[2:], pairs, (0, 1)).sum())

    assert fitted.transitions == 58
    assert fitted.log_likelihood == pytest.approx(log_likelihood(fitted.dynamics), rel=1e-6)
    assert log_likelihood(PLANE) < fitted.log_likelihood
    rng = np.random.default_rng(1)
    for _ in range(20):
        near = fitted.dynamics.coefficients + 0.01 * rng.normal(size=(2, 2, 2))
        other = Autoregression(near, fitted.dynamics.noise_covariance * rng.uniform(0.9, 1.1), fitted.dynamics.mean)
        assert log_likelihood(other) < fitted.log_likelihood


def test_gaps_are_not_transitions():
    states = a_run(LINE, 300, 3)
    pieces = [states[:100], states[150:151], states[180:]]
    fitted = fit_dynamics(pieces, 2)
    assert fitted.transitions == 98 + 0 + 118
    assert np.abs((fitted.dynamics.coefficients - LINE.coefficients) / fitted.standard_errors).max() < 5.0


def test_without_an_intercept_the_mean_is_zero():
    assert learn_dynamics(a_run(FIRST, 200, 1), 1, intercept=False).mean.tolist() == [0.0, 0.0]


def test_a_ramp_has_a_velocity_that_is_kept_and_a_component_at_rest_can_be_learnt():
    ramp = np.stack([3.0 * np.arange(50.0), np.full(50, 9.0)], axis=1)
    dynamics = learn_dynamics(ramp, 2, intercept=False)
    ahead = dynamics.predict(np.array([[[300.0, 9.0], [297.0, 9.0]]]))[0]
    np.testing.assert_allclose(ahead, [303.0, 9.0], atol=1e-3)


@pytest.mark.parametrize(
    ("states", "order", "message"),
    [
        (np.zeros((9, 2)), 0, "order must be at least 1, got 0"),
        (np.zeros((6, 2)), 2, "too few states: 4 transitions for 5 coefficients"),
        ([np.zeros((9, 2)), np.zeros((9, 3))], 1, "the same k throughout"),
        (np.full((30, 1), np.nan), 1, "states must be finite"),
    ],
)
def test_what_cannot_be_learnt_is_explained(states, order, message):
    with pytest.raises(ValueError, match=message):
        learn_dynamics(states, order)


@pytest.mark.parametrize(
    ("header", "rows", "expected"),
    [
        ("frame,cx,cy", ["0,1,2", "1,3,4", "5,5,6"], [[[1, 2], [3, 4]], [[5, 6]]]),
        ("frame,x,y,w,h", ["0,10,20,4,6", "1,11,21,4,6"], [[[12, 23], [13, 24]]]),
        ("frame,x,y,rotation,scale,box_x", ["7,1.5,2.5,0,1,9", "8,2,3,0,1,9"], [[[1.5, 2.5], [2, 3]]]),
        ("frame,x,y,w,h,cx,cy", ["3,0,0,9,9,1,2", "2,0,0,9,9,3,4"], [[[3, 4], [1, 2]]]),
        ("x,y", ["1,2", ",", "5,6"], [[[1, 2]], [[5, 6]]]),
    ],
)
def test_positions_are_read_from_the_usual_columns(tmp_path, header, rows, expected):
    path = tmp_path / "truth.csv"
    path.write_text("\n".join([header, *rows]) + "\n")
    found = read_states(path)
    assert [sequence.tolist() for sequence in found] == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [("a,b\n1,2\n", "expected columns"), ("", "got none"), ("x,y\n", "no rows"), ("x,y\n1,two\n", "not a number")],
)
def test_files_without_positions_are_explained(tmp_path, text, message):
    path = tmp_path / "truth.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=message):
        read_states(path)
