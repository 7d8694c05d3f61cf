"""The likelihoods against slow and obvious twins."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pfviz.kernels import pad_edges
from pfviz.vision.colour import CODE_ZERO, decode
from pfviz.vision.likelihoods import ColourLikelihood, ContourLikelihood
from pfviz.vision.shapes import Contour, contour_from_box, transforms


def some_states(rng: np.random.Generator, count: int) -> np.ndarray:
    low, high = [-10, -10, -3, -0.5], [70, 60, 3, 0.5]
    return rng.uniform(low, high, (count, 4))


def placed(state: np.ndarray, point: np.ndarray) -> tuple[float, float]:
    x, y, rotation, log_scale = state
    scale = math.exp(log_scale)
    return (
        x + scale * (math.cos(rotation) * point[0] - math.sin(rotation) * point[1]),
        y + scale * (math.sin(rotation) * point[0] + math.cos(rotation) * point[1]),
    )


def turned(state: np.ndarray, direction: np.ndarray) -> tuple[float, float]:
    cosine, sine = math.cos(state[2]), math.sin(state[2])
    return cosine * direction[0] - sine * direction[1], sine * direction[0] + cosine * direction[1]


def slow_contour_likelihood(likelihood: ContourLikelihood, state: np.ndarray, edges: np.ndarray) -> float:
    """The sum over normals of -temper d^2 / 2 sigma^2, by walking outward pixel by pixel."""
    total = 0.0
    for point, normal in zip(likelihood.points, likelihood.normals, strict=True):
        x, y = placed(state, point)
        dx, dy = turned(state, normal)
        nearest = likelihood.search
        for s in range(-likelihood.search, likelihood.search + 1):
            column, row = math.floor(x + s * dx), math.floor(y + s * dy)
            within = 0 <= row < edges.shape[0] and 0 <= column < edges.shape[1]
            if within and edges[row, column]:
                nearest = min(nearest, abs(s))
        total -= likelihood.temper * nearest**2 / (2 * likelihood.sigma**2)
    return total


def slow_colour_likelihood(likelihood: ColourLikelihood, state: np.ndarray, values: np.ndarray) -> float:
    """The strength times (mean inside - mean outside), looking up one point after the other."""
    sums = {True: [], False: []}
    for point, weight in zip(likelihood.points, likelihood.weights, strict=True):
        x, y = placed(state, point)
        row, column = math.floor(y), math.floor(x)
        within = 0 <= row < values.shape[0] and 0 <= column < values.shape[1]
        sums[bool(weight > 0)].append(values[row, column] if within else 0.0)
    return likelihood.strength * (np.mean(sums[True]) - np.mean(sums[False]))


@pytest.fixture
def contour() -> Contour:
    return contour_from_box(24.0, 16.0, count=20)


@pytest.fixture
def contour_likelihood(contour) -> ContourLikelihood:
    return ContourLikelihood(contour.points, contour.normals, search=5, sigma=2.0, temper=0.3)


@pytest.mark.parametrize("density", [0.0, 0.02, 0.2, 1.0])
def test_the_contour_likelihood_is_that_of_its_definition(contour_likelihood, density):
    rng = np.random.default_rng(0)
    edges = (rng.random((50, 60)) < density).astype(np.uint8)
    states = some_states(rng, 40)
    expected = [slow_contour_likelihood(contour_likelihood, state, edges) for state in states]
    measured = contour_likelihood.log_likelihood(transforms(states), pad_edges(edges, 5))
    np.testing.assert_allclose(measured, expected, atol=1e-9)


def test_the_colour_likelihood_is_that_of_its_definition(contour):
    rng = np.random.default_rng(1)
    likelihood = ColourLikelihood.around(contour, 3.0)
    codes = rng.integers(8, 249, (50, 60)).astype(np.uint8)
    states = some_states(rng, 40)
    expected = [slow_colour_likelihood(likelihood, state, decode(codes)) for state in states]
    padded = np.pad(codes, 1, constant_values=CODE_ZERO)
    np.testing.assert_allclose(likelihood.log_likelihood(transforms(states), padded), expected, atol=1e-9)


def test_points_of_the_colour_likelihood_lie_where_they_should(contour):
    import cv2

    likelihood = ColourLikelihood.around(contour, 1.0)
    outline = contour.outline(20).astype(np.float32)
    for point, weight in zip(likelihood.points, likelihood.weights, strict=True):
        assert (cv2.pointPolygonTest(outline, tuple(map(float, point)), False) > 0) == (weight > 0)
    assert likelihood.weights[likelihood.weights > 0].sum() == pytest.approx(1.0)
    assert likelihood.weights.sum() == pytest.approx(0.0, abs=1e-12)


def test_a_normal_without_an_edge_costs_as_much_as_the_farthest(contour_likelihood):
    cost = contour_likelihood.cost
    assert len(cost) == 7
    assert cost[-1] == cost[-2] == pytest.approx(-0.3 * 25 / 8)
    assert cost[0] == 0.0


def test_more_observation_noise_flattens_both(contour, contour_likelihood):
    np.testing.assert_allclose(contour_likelihood.with_noise(2.0).cost, contour_likelihood.cost / 4)
    assert ColourLikelihood.around(contour, 3.0).with_noise(2.0).strength == pytest.approx(3.0 / 4)


def test_edge_offsets_tell_outward_from_inward(contour):
    likelihood = ContourLikelihood(contour.points, contour.normals, search=5, sigma=2.0, temper=1.0)
    state = np.array([[30.0, 25.0, 0.0, 0.0]])
    edges = np.zeros((50, 60), np.uint8)
    edges[:, 45] = 1  # the right side of the outline is at 42
    offsets = likelihood.edge_offsets(transforms(state), pad_edges(edges, 5))[0]
    rightmost = int(np.argmax(contour.points[:, 0]))
    assert offsets[rightmost] == 3
    assert (offsets == likelihood.search + 1).sum() > 10
